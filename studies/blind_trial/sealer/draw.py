"""Which cases a pack has, and how large each effect is: drawn from a seed, balanced over the kinds for any number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from studies.blind_trial.sealer import nominal
from studies.blind_trial.sealer.distance import distance
from studies.blind_trial.sealer.effects import CATALOGUE, Change, Law, Shape
from studies.blind_trial.sealer.labels import PARAMETERS, REPLAYED, Told, body, near, nearest, next_size
from studies.blind_trial.sealer.nominal import Table
from studies.blind_trial.sealer.outsiders import OUTSIDERS
from studies.blind_trial.sealer.schedule import sequential, suite
from studies.blind_trial.sealer.simulate import simulate

# Share of each kind of case.
KINDS: Final = {
    "single": 0.52,
    "outsider": 0.12,
    "pair": 0.10,
    "disabled": 0.10,
    "parameters": 0.08,
    "clean": 0.08,
}
SEVERITIES: Final = {"low": 12.0, "middle": 40.0, "high": 120.0}  # distances that sizes are chosen for
PAIR: Final = 80.0  # distance of each of two
REPLAY_SIZES: Final = {"low": 0.01, "middle": 0.03, "high": 0.1}


@dataclass(frozen=True)
class Part:
    """One effect in a case: its law, size, shape, and its distance alone (None where only a replay shows it)."""

    name: str
    law: Law
    size: float
    shape: Shape
    distance: float | None

    @property
    def change(self) -> Change:
        """What it changes in the machine."""
        return self.law.change(self.size, self.shape)


@dataclass(frozen=True)
class Plan:
    """A case before it is simulated: its name in the pack, kind, severity, effects, nominal shift, seed."""

    case: str
    kind: str
    severity: str
    parts: tuple[Part, ...]
    shift: dict[str, Any]
    parameters: tuple[str, ...]
    seed: int

    def body(self) -> dict[str, Any]:
        """What is sealed: the label and what the scorer needs."""
        told = [
            Told(part.name, part.size, part.law.unit, dict(part.shape), part.law.form, part.distance)
            for part in self.parts
        ]
        return body(told, self.shift, self.parameters, {}, case=self.case, kind=self.kind, severity=self.severity)


def order(count: int, seed: int) -> list[tuple[str, str, int]]:
    """Kind, severity and turn within the kind of each case: at every number of cases the shares are met at best."""
    rng = np.random.default_rng([seed, 0])
    turns = dict.fromkeys(KINDS, 0)
    found = []
    for k in range(count):
        kind = max(KINDS, key=lambda name: KINDS[name] * (k + 1) - turns[name])
        found.append((kind, "", turns[kind]))
        turns[kind] += 1
    singles = [(name, severity) for name in CATALOGUE for severity in SEVERITIES]
    decks = {"single": rng.permutation(len(singles)), "outsider": rng.permutation(len(OUTSIDERS))}
    decks["disabled"] = rng.permutation(len(_disabling()))
    decks["parameters"] = rng.permutation(len(PARAMETERS))
    named = []
    for kind, _, turn in found:
        deck = decks.get(kind)
        entry = int(deck[turn % deck.size]) if deck is not None else turn
        severity = singles[entry][1] if kind == "single" else "high" if kind in ("outsider", "disabled") else ""
        named.append((kind, severity, entry // len(SEVERITIES) if kind == "single" else entry))
    shuffle = rng.permutation(count)  # the number of a case says nothing about its kind
    return [named[i] for i in shuffle]


def _disabling() -> list[str]:
    return [name for name in CATALOGUE if name != REPLAYED]


def plan(case: str, kind: str, severity: str, entry: int, seed: Sequence[int]) -> Plan:
    """The case of this kind; `entry` counts within the kind's list, `seed` belongs to the case alone."""
    rng = np.random.default_rng(list(seed))
    table, (shift, own) = nominal.load(), _begun(rng)
    parts: tuple[Part, ...] = ()
    parameters: tuple[str, ...] = ()
    if kind == "clean":
        shift = {name: np.zeros_like(number) for name, number in shift.items()}
    elif kind == "parameters":
        second = rng.choice([name for name in PARAMETERS if name != PARAMETERS[entry]])
        parameters = (PARAMETERS[entry], str(second)) if rng.random() < 0.5 else (PARAMETERS[entry],)
        for name in parameters:
            shift[name] = nominal.beyond(name, rng) * np.ones_like(shift[name])
    elif kind == "pair":
        names = rng.choice(_disabling(), size=2, replace=False)
        parts = tuple(sized(table, str(name), CATALOGUE[str(name)], PAIR, rng, own) for name in names)
    elif kind == "outsider":
        name = list(OUTSIDERS)[entry]
        parts = (sized(table, name, OUTSIDERS[name], SEVERITIES[severity], rng, own),)
    else:
        name = (_disabling() if kind == "disabled" else list(CATALOGUE))[entry]
        law = CATALOGUE[name]
        if name == REPLAYED:
            parts = (Part(name, law, REPLAY_SIZES[severity], law.shape(rng), None),)
        else:
            parts = (sized(table, name, law, SEVERITIES[severity], rng, own),)
    return Plan(case, kind, severity, parts, shift, parameters, own)


def _begun(rng: np.random.Generator) -> tuple[dict[str, Any], int]:
    """What is drawn first of every case: how its table deviates from the nominal one, and the seed of its records."""
    return nominal.shift_of(rng), int(rng.integers(2**31))


def seed_of(seed: Sequence[int]) -> int:
    """The seed of the records of the case whose own seed this is, without the rest of its draw, which takes time."""
    return _begun(np.random.default_rng(list(seed)))[1]


def sized(table: Table, name: str, law: Law, goal: float, rng: np.random.Generator, own: int, tries: int = 4) -> Part:
    """An effect whose distance is `goal` to a sixth, or as near as its range allows after `tries` simulations.

    own: the seed of the case's records. Whether a random event is visible depends on when it comes: one repeated
    reading shows at once in a fast move, and never at rest. So the distance is that of these very records, except for
    a random effect that comes second in a pair, where the first has already drawn from the generator.
    """
    shape = law.shape(rng)
    points: list[tuple[float, float]] = []
    size = float(np.clip(law.middle * goal / SEVERITIES["middle"], law.low, law.high))
    for _ in range(tries):
        change = law.change(size, shape)
        logs = [
            simulate(table, schedule(), own + i, change.fields, change.signals, exact=True)
            for i, schedule in enumerate((sequential, suite))
        ]
        points.append((size, distance(table, logs)))
        if near(points[-1][1], goal):
            break
        points.sort()
        following = next_size(points, goal, law.low, law.high)
        if following is None:
            break
        size = following
    size, found = nearest(points, goal)
    return Part(name, law, size, shape, found)
