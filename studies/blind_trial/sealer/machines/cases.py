"""Which cases a pack of drawn machines has: nothing of a case depends on how many there are.

Cases come in groups of GROUP machines with EACH cases a machine, neighbours on different machines. Every twenty cases
hold the kinds in fixed shares, in a drawn order; effects, forms and strangers are dealt from shuffled decks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.labels import PARAMETERS, REPLAYED, Told, body, near, nearest, next_size
from studies.blind_trial.sealer.loop import Log
from studies.blind_trial.sealer.machines.axis import Axis, beyond, shift_of, shifted
from studies.blind_trial.sealer.machines.drawing import draw_axis, stable
from studies.blind_trial.sealer.machines.forms import Form, Shape, Units
from studies.blind_trial.sealer.machines.laws import EFFECTS, LAWS, laws_of
from studies.blind_trial.sealer.machines.motions import Schedule, experiment
from studies.blind_trial.sealer.machines.simulation import Change, simulate
from studies.blind_trial.sealer.machines.strangers import STRANGERS
from studies.blind_trial.sealer.machines.visibility import Reference, distance, reference

Array = NDArray[np.float64]

GROUP: Final = 8  # machines whose cases are interleaved
EACH: Final = 6  # cases of a machine
KINDS: Final = {"single": 9, "outsider": 3, "pair": 2, "disabled": 2, "parameters": 2, "clean": 2}  # of twenty
BLOCK: Final = sum(KINDS.values())
SEVERITIES: Final = {"low": 12.0, "middle": 45.0, "high": 130.0}  # distances that sizes are chosen for
OFTEN: Final = {"low": 0.15, "middle": 0.4, "high": 0.45}
PAIR: Final = 90.0  # distance of each of two
TRIES: Final = 5
START: Final = 7  # seed of the friction's state in which sizes are chosen
RESERVE: Final = 0.7  # of the rated thrust, which the nominal machine may need in its experiment
FOLLOWS: Final = 0.3  # of the span, by which the nominal machine may be behind its reference


@dataclass(frozen=True)
class Bench:
    """A machine with its experiment: what its cases share, and how many draws were rejected for what reason."""

    number: int
    axis: Axis
    schedules: tuple[Schedule, Schedule]
    units: Units
    known: Reference
    rejected: Counter[str]

    def features(self) -> dict[str, Any]:
        """What machines may have in common, for the scorer."""
        axis = self.axis
        stiff = float(np.sqrt(axis.stiffness.sum() / axis.mass) / (2 * np.pi))
        return {
            "mass_kg": axis.mass,
            "friction_N": axis.friction,
            "reach_m": axis.reach,
            "elements": int(axis.limit.size),
            "modes": int(axis.gain.size - 1),
            "negative_modes": int(np.sum(axis.gain < 0)),
            "lowest_mode_Hz": float(axis.frequency[1:].min()) if axis.gain.size > 1 else None,
            "presliding_Hz": stiff,
            "sample_time_s": axis.sample_time,
            "dead_time_samples": axis.dead_time / axis.sample_time,
            "resolution_m": axis.resolution,
            "readings_in_reach": axis.reach / axis.read,
            "noise_force_N": float(axis.stiffness.sum() * axis.read),
            "noise_force_share": float(axis.stiffness.sum() * axis.read / axis.friction),
            "controller": axis.style,
            "crossover_Hz": axis.crossover,
            "off": 2 * axis.known.mass,
            "span_m": self.units.span,
            "peak_over_friction": self.units.peak / axis.friction,
            "samples": int(sum(one.target.size for one in self.schedules)),
            "seconds": self.units.lasts,
            "pieces": int(sum(len(one.parts) for one in self.schedules)),
            "kinds_of_pieces": len({name for one in self.schedules for name in one.parts}),
        }


@dataclass(frozen=True)
class Part:
    """One effect in a case; distance: alone, None where only a replay of the controller shows it."""

    name: str
    form: Form
    size: float
    shape: Shape
    distance: float | None

    def change(self, units: Units) -> Change:
        """What it changes in the machine."""
        return self.form.change(self.size, self.shape, units)


@dataclass(frozen=True)
class Plan:
    """A case before it is written."""

    case: str
    kind: str
    severity: str
    bench: Bench
    parts: tuple[Part, ...]
    shift: dict[str, Any]
    parameters: tuple[str, ...]
    seed: int

    def body(self) -> dict[str, Any]:
        """What is sealed: the label and what the scorer needs."""
        outside = self.parts[0].form.coordinates if self.kind == "outsider" else ()
        more = {
            "coordinates": list(outside),
            "machine": {"number": self.bench.number, **self.bench.features()},
            "rejected": dict(self.bench.rejected),
        }
        told = [
            Told(part.name, part.size, part.form.unit, dict(part.shape), part.form.text, part.distance)
            for part in self.parts
        ]
        return body(told, self.shift, self.parameters, more, case=self.case, kind=self.kind, severity=self.severity)

    def log(self, which: int) -> Log:
        """One of its two records."""
        return self.run(self.bench.schedules[which], self.seed + which)

    def run(
        self, schedule: Schedule, seed: int, gains: Mapping[str, float] | None = None, delay: int | None = None
    ) -> Log:
        """The log of a run of the true machine, with other gains of its controller and another delay of its reference
        [samples] where they are given: what is wrong with a gain is then as wrong with the new one. Raises
        ArithmeticError where the command leaves the drive's range."""
        true, change = shifted(self.bench.axis, self.shift), together(self.parts, self.bench.units)
        if gains is not None:
            old = true.control
            wrong = {
                name: gains.get(name, 0.0) * number / old[name] if old.get(name) else gains.get(name, 0.0) + number
                for name, number in change.control.items()
            }
            later = true.delay if delay is None else delay
            true, change = replace(true, control=gains, delay=later), replace(change, control=wrong)
        return simulate(true, schedule, seed, change)


def together(parts: Sequence[Part], units: Units) -> Change:
    """What is wrong with a machine, all of it together."""
    changes = [part.change(units) for part in parts]
    return Change(
        {name: number for one in changes for name, number in one.fields.items()},
        {name: signal for one in changes for name, signal in one.signals.items()},
        {name: number for one in changes for name, number in one.control.items()},
        sum(one.later for one in changes),
    )


def machine_of(k: int) -> int:
    """The number of the machine of the k-th case."""
    return GROUP * (k // (GROUP * EACH)) + k % GROUP


@lru_cache(maxsize=GROUP)
def bench(seed: int, number: int) -> Bench:
    """A machine that can do its experiment; a draw that can't is rejected, counted, and both are drawn again."""
    rng = np.random.default_rng([seed, 1, number])
    rejected: Counter[str] = Counter()
    while True:
        axis, why = draw_axis(rng)
        rejected += why
        schedules = experiment(axis, rng)
        try:
            logs = [simulate(axis, schedule, i, start=START + i, exact=True) for i, schedule in enumerate(schedules)]
        except ArithmeticError:
            rejected["the experiment is beyond the drive"] += 1
            continue
        span = max(float(np.ptp(one.reference)) for one in schedules)
        peak = max(float(np.abs(log.command).max()) for log in logs)
        behind = max(float(np.abs(log.reading - one.reference).max()) for log, one in zip(logs, schedules, strict=True))
        kinds = {name for one in schedules for name in one.parts}
        if peak > RESERVE * axis.rated:
            rejected["the experiment needs too much thrust"] += 1
        elif behind > FOLLOWS * span:
            rejected["the machine does not follow"] += 1
        elif len(kinds) < 4 or span < 10 * axis.reach:
            rejected["the experiment is too poor"] += 1
        else:
            break
    lasts = sum(one.target.size for one in schedules) * axis.sample_time
    units = Units(axis, span, lasts, peak)
    return Bench(number, axis, schedules, units, reference(axis, logs), rejected)


def kind_of(seed: int, k: int) -> tuple[str, int]:
    """The kind of the k-th case, and how many of that kind came before it."""
    block, place = divmod(k, BLOCK)
    order = np.random.default_rng([seed, 2, block]).permutation([name for name in KINDS for _ in range(KINDS[name])])
    kind = str(order[place])
    return kind, block * KINDS[kind] + int(np.sum(order[:place] == kind))


def dealt(seed: int, deck: int, count: int, turn: int) -> int:
    """The card at this turn from a deck of `count` that is shuffled anew whenever it is through."""
    again, place = divmod(turn, count)
    return int(np.random.default_rng([seed, 3, deck, again]).permutation(count)[place])


def plan(seed: int, k: int, case: str) -> Plan:
    """The k-th case of a seed."""
    kind, turn = kind_of(seed, k)
    own = bench(seed, machine_of(k))
    rng = np.random.default_rng([seed, 4, k])
    record_seed = int(rng.integers(2**31))
    parts, parameters, severity = _contents(seed, kind, turn, own, rng, record_seed)
    while True:
        shift = shift_of(own.axis, rng)
        if kind == "clean":
            shift = {name: np.zeros_like(number) for name, number in shift.items()}
        for name in parameters:
            shift[name] = beyond(own.axis, name, rng) * np.ones_like(shift[name])
        found = Plan(case, kind, severity, own, parts, shift, parameters, record_seed)
        if _runs(found):
            return found


def _runs(found: Plan) -> bool:
    """Whether the true machine is stable, and within its drive in both records."""
    true = shifted(found.bench.axis, found.shift)
    if true.frequency.max() * true.sample_time > 0.48 or not (stable(true, 0.0) and stable(true, true.stiffness.sum())):
        return False
    try:
        for which in range(2):
            found.log(which)
    except ArithmeticError:
        return False
    return True


def _contents(
    seed: int, kind: str, turn: int, own: Bench, rng: np.random.Generator, record_seed: int
) -> tuple[tuple[Part, ...], tuple[str, ...], str]:
    """Effects, wrong parameters and severity of a case."""
    hidden = [name for name in EFFECTS if name != REPLAYED]
    if kind == "clean":
        return (), (), ""
    if kind == "parameters":
        known = [name for name in PARAMETERS if own.axis.gain.size > 1 or not name.startswith("mode_")]
        first = known[dealt(seed, 0, len(PARAMETERS), turn) % len(known)]
        second = str(rng.choice([name for name in known if name != first]))
        return (), ((first, second) if rng.random() < 0.4 else (first,)), ""
    if kind == "outsider":
        form = STRANGERS[dealt(seed, 1, len(STRANGERS), turn)]
        return (sized(own, form, SEVERITIES["high"], rng, record_seed),), (), "high"
    if kind == "disabled":
        choice = laws_of(hidden[dealt(seed, 2, len(hidden), turn)])
        return (sized(own, choice[int(rng.integers(len(choice)))], SEVERITIES["high"], rng, record_seed),), (), "high"
    if kind == "pair":
        names = rng.choice(hidden, size=2, replace=False)
        forms = [laws_of(str(name)) for name in names]
        chosen = [choice[int(rng.integers(len(choice)))] for choice in forms]
        return tuple(sized(own, form, PAIR, rng, record_seed) for form in chosen), (), ""
    severity = str(rng.choice(list(OFTEN), p=list(OFTEN.values())))
    form = LAWS[dealt(seed, 4, len(LAWS), turn)]
    return (sized(own, form, SEVERITIES[severity], rng, record_seed),), (), severity


REPLAY_SIZES: Final = {12.0: 0.01, 45.0: 0.03, 130.0: 0.1}


def sized(own: Bench, form: Form, goal: float, rng: np.random.Generator, seed: int) -> Part:
    """An effect whose distance is `goal` to a sixth, or as near as its range allows after some simulations."""
    shape = form.shape(own.units, rng)
    if form.effect == REPLAYED:
        return Part(form.effect, form, REPLAY_SIZES[goal], shape, None)
    low, size, high = form.sizes(own.units)
    size = float(np.clip(size * goal / SEVERITIES["middle"], low, high))
    points: list[tuple[float, float]] = []
    for _ in range(TRIES):
        found = _distance(own, form.change(size, shape, own.units), seed)
        if found is None:  # more than the drive has: much less of it
            high = size / 2
            size = float(np.clip(size / 4, low, high))
            continue
        points.append((size, max(found, 1e-3)))
        if near(points[-1][1], goal):
            break
        points.sort()
        following = next_size(points, goal, low, high)
        if following is None:
            break
        size = following
    if not points:
        return Part(form.effect, form, low, shape, _distance(own, form.change(low, shape, own.units), seed) or 0.0)
    size, best = nearest(points, goal)
    return Part(form.effect, form, size, shape, best)


def _distance(own: Bench, change: Change, seed: int) -> float | None:
    """The distance on this machine's experiment; None where the machine can't run it so."""
    try:
        logs = [
            simulate(own.axis, one, seed + i, change, start=START + i, exact=True)
            for i, one in enumerate(own.schedules)
        ]
    except ArithmeticError:
        return None
    return distance(own.known, logs)
