"""What to run next, and when to stop: pure functions of what experiments would tell and of what was found so far.

Nothing named: every effect is open. What is worth most is what makes most of their detection limits fall by most in a
second: the mean over the open questions of the nats that an experiment adds to log(1 + D / needed) / 2, what it tells
about a size whose prior is the usual one (D: squared distance of the effect at its usual size, from all records;
needed: from which on two effects can be distinguished). Something named, or several alike: the open questions are
whether it is there (the next record has to confirm it, see e_process.py) and whether it is another one that what was
run cannot tell from it; both at the size that was found. Experiments are put into a record one after another while its
time lasts, the best in a second first.

It ends where two looks one after another give the same names, every one is sure, and no other effect that could be told
from them is still alike; where nothing explains the records in LOOKS looks one after another; or where the machine's
time or its records are spent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.information import ExperimentInformation
from diagnosis.experiments.look import Found
from diagnosis.verdict import Outcome
from models.quantity import listed

Array = NDArray[np.float64]

LOOKS: Final = 3  # one after another in which no effect explains the records, until that is the answer
CHANCE: Final = 0.02  # of a false name, over all looks together
MIN_WORTH_NATS: Final = 1e-3  # nats of a question that are worth asking


class Stop(StrEnum):
    """How a diagnosis that asks for its records may end."""

    NAMED = "named"
    PARAMETERS = "parameters"
    NOTHING = "nothing_to_explain"
    NONE = "none_of_these"
    CANNOT_TELL = "cannot_tell"


@dataclass(frozen=True)
class Knowledge:
    """What is known when the next record is chosen.

    effects: by their place in the tables of the experiments; runs (M,): how often each experiment was run; found: by
    look; process: of all looks; seconds [s] and records that are left of the budget; barred: the places of experiments
    that the machine did not run; had (E, E) [1]: what the records that there were told, or nothing.
    """

    effects: tuple[str, ...]
    experiments: tuple[ExperimentInformation, ...]
    runs: tuple[int, ...]
    found: tuple[Found, ...]
    process: EProcess
    seconds: float
    records: int
    criteria: Criteria = Criteria()
    barred: frozenset[int] = frozenset()
    had: Array | float = 0.0

    def within(self, seconds: float) -> dict[int, ExperimentInformation]:
        """By place, the experiments that may be asked for and take no longer [s]."""
        places = enumerate(self.experiments)
        return {i: one for i, one in places if i not in self.barred and one.seconds <= seconds}

    @property
    def distance(self) -> Array:
        """(E, E) [1]: what the records so far tell of each effect and each pair at their usual sizes."""
        count = len(self.effects)
        told = [n * one.distance for n, one in zip(self.runs, self.experiments, strict=True)]
        return np.asarray(np.sum([np.zeros((count, count)), *told], axis=0) + self.had)


@dataclass(frozen=True)
class Choice:
    """The experiments of the next record by their place, and why they were chosen."""

    places: tuple[int, ...]
    why: str


Choose = Callable[[Knowledge], Choice | None]


def questions(known: Knowledge) -> tuple[Array, Array]:
    """What is open (E, E): the weight of each effect's presence (diagonal) and of each pair [1], the sum being 1; and
    the ratio of squared sizes, found over usual, by which the rows' distances are multiplied [1]."""
    last, count = known.found[-1], len(known.effects)
    weight, size = np.zeros((count, count)), np.ones((count, 1))
    place = {name: i for i, name in enumerate(known.effects)}
    named = [place[name] for name in last.names if name in place]
    groups = [[place[name] for name in group if name in place] for group in last.alike]
    if last.outcome in {Outcome.NOTHING, Outcome.PARAMETERS, Outcome.NONE} or not named:
        np.fill_diagonal(weight, 1.0)
        leading = sorted((name for name in last.gains if name in place), key=lambda name: -last.gains[name])[:4]
        if last.outcome is Outcome.NONE:
            groups = [[place[name] for name in leading]]
    have = known.distance
    for i in named:
        size[i] = max(last.gains.get(known.effects[i], 0.0), 1.0) / max(have[i, i], 1e-9)
        weight[i, i] = 1.0
        weight[i] += (size[i] * have[i] < known.criteria.distinguishable) & (np.arange(count) != i)
    for group in groups:
        for i in group:
            weight[i, [j for j in group if j != i]] += 1.0
    return weight / max(weight.sum(), 1e-12), size


def worth(known: Knowledge, more: Array, open_: tuple[Array, Array]) -> float:
    """Nats [1] that squared distances (E, E) beside those so far add to the open questions."""
    weight, size = open_
    before = np.log1p(size * known.distance / known.criteria.distinguishable)
    after = np.log1p(size * (known.distance + more) / known.criteria.distinguishable)
    return float(0.5 * np.sum(weight * np.where(weight > 0, after - before, 0.0)))


def active(known: Knowledge) -> Choice | None:
    """What tells most about the open questions in a second; None where nothing that still fits tells anything."""
    open_ = questions(known)

    def value(places: Sequence[int]) -> float:
        return worth(known, _total(known, places), open_)

    places = filled(known, value)
    return Choice(places, _why(known)) if places and value(places) > MIN_WORTH_NATS else None


def _total(known: Knowledge, places: Sequence[int]) -> Array:
    return np.asarray(np.sum([known.experiments[i].distance for i in places], axis=0))


def filled(known: Knowledge, value: Callable[[Sequence[int]], float]) -> tuple[int, ...]:
    """Experiments, by their place, for the next record's share of the time: each the one that adds most of `value` [1]
    in a second to those before it."""
    chosen, room = list[int](), share(known)
    here = 0.0
    while True:
        rates = {
            i: (value([*chosen, i]) - here) / one.seconds
            for i, one in known.within(room).items()
            if chosen.count(i) < 2
        }
        if not rates or max(rates.values()) <= 0:
            return tuple(chosen)
        best = max(rates, key=lambda i: rates[i])
        chosen.append(best)
        room -= known.experiments[best].seconds
        here = value(chosen)


def share(known: Knowledge) -> float:
    """The time [s] of the next record: as much as of each that is left, but no less than the shortest experiment takes
    if there is that much."""
    shortest = min((one.seconds for one in known.within(np.inf).values()), default=np.inf)
    return min(max(known.seconds / max(known.records, 1), shortest), known.seconds)


def _why(known: Knowledge) -> str:
    last = known.found[-1]
    if last.outcome is Outcome.AMBIGUOUS and last.alike:
        return f"to tell {_words(last.alike[0])} apart"
    if last.names and last.outcome is Outcome.ATTRIBUTED:
        return f"to confirm {_words(last.names)} on a new record, and to tell it from what is alike"
    if last.outcome is Outcome.NONE:
        return "as something is left that no effect explains: to see more of it, and effects that were hidden"
    return "to see effects that what was run could not show"


def _words(names: Sequence[str]) -> str:
    return listed(name.replace("_", " ") for name in names)


def ending(known: Knowledge, chance: float = CHANCE) -> tuple[Stop, str] | None:
    """How it ends, and the reason, where it has to end now; None where another record is worth it. chance [1]: that a
    false name comes up in any look."""
    if not known.found:
        return None
    if confirmed(known, chance) and not any(indistinguishable(known).values()):
        return Stop.NAMED, f"{_words(known.found[-1].names)}: confirmed by a record that did not choose it"
    recent = known.found[-LOOKS:]
    if len(recent) == LOOKS and all(one.outcome is Outcome.NONE for one in recent):
        return Stop.NONE, f"in {LOOKS} looks one after another no effect explained the records"
    return None


def confirmed(known: Knowledge, chance: float = CHANCE) -> bool:
    """Whether two looks one after another give the same names, and each of them is sure; chance as in `ending` [1]."""
    last, same = known.found[-1], {frozenset(one.names) for one in known.found[-2:]}
    named = last.outcome is Outcome.ATTRIBUTED and len(known.found) > 1 and len(same) == 1
    return named and all(known.process.is_confirmed(name, chance) for name in last.names)


def indistinguishable(known: Knowledge) -> dict[str, tuple[str, ...]]:
    """By name that was given last, other effects that the records cannot tell from it at the size that was found, and
    that some experiment which still fits would."""
    weight, size = questions(known)
    have, fits = known.distance, known.within(known.seconds)
    best = (
        np.max([one.distance for one in fits.values()], axis=0) if fits and known.records > 0 else np.zeros_like(have)
    )
    near = (weight > 0) & (size * (have + best) >= known.criteria.distinguishable) & ~np.eye(len(have), dtype=bool)
    names = np.array(known.effects)
    return {
        name: tuple(names[near[known.effects.index(name)]]) for name in known.found[-1].names if name in known.effects
    }


def ending_when_spent(
    known: Knowledge, chance: float = CHANCE, reason: str = "the machine's time is spent"
) -> tuple[Stop, str]:
    """How it ends, and why, where nothing more can be run; chance as in `ending` [1]."""
    last = known.found[-1]
    if last.outcome in {Outcome.PARAMETERS, Outcome.NOTHING}:
        return Stop(str(last.outcome)), reason
    if last.outcome is Outcome.NONE:
        return Stop.NONE, reason
    sure = [name for name in last.names if known.process.is_confirmed(name, chance)]
    if sure and last.outcome is Outcome.ATTRIBUTED:
        open_ = [name for name in last.names if name not in sure]
        return Stop.NAMED, reason + (f"; {_words(open_)}: not confirmed" if open_ else "")
    if last.outcome is Outcome.AMBIGUOUS:
        return Stop.CANNOT_TELL, f"{reason}, and {_words(last.alike[0] if last.alike else last.names)} are still alike"
    e = np.exp(min(*(known.process.of(name) for name in last.names), known.process.any))
    return Stop.CANNOT_TELL, f"{reason}, and {_words(last.names)} has an e-value of {e:.2g}, {1 / chance:.0f} needed"


def hidden(known: Knowledge) -> tuple[str, ...]:
    """Effects that at their usual size none of the records could show."""
    seen = np.diag(known.distance) >= known.criteria.distinguishable
    return tuple(name for name, there in zip(known.effects, seen, strict=True) if not there)


def in_turn(known: Knowledge) -> Choice | None:
    """The experiments in the menu's order, as a fixed suite has them; those that were run least come first."""
    rank = sorted(range(len(known.experiments)), key=lambda i: (known.runs[i], i))
    places = filled(known, lambda chosen: _ranked(chosen, rank, known))
    return Choice(places, "next in the suite") if places else None


def _ranked(chosen: Sequence[int], rank: Sequence[int], known: Knowledge) -> float:
    """A value by which `filled` takes experiments in the order of `rank`, whatever their time."""
    return float(sum(known.experiments[i].seconds * 2.0 ** -rank.index(i) for i in set(chosen)))


def at_random(seed: int) -> Choose:
    """Experiments in an order drawn anew for each record."""

    def choose(known: Knowledge) -> Choice | None:
        rank = np.random.default_rng([seed, len(known.found)]).permutation(len(known.experiments)).tolist()
        places = filled(known, lambda chosen: _ranked(chosen, rank, known))
        return Choice(places, "drawn at random") if places else None

    return choose


def d_optimal(known: Knowledge) -> Choice | None:
    """What makes the determinant of the nominal parameters' information, their priors included, grow most in a second
    (H. Wynn, Annals of Mathematical Statistics 41, 1970)."""
    have = np.sum([n * one.parameters for n, one in zip(known.runs, known.experiments, strict=True)], axis=0)
    have = have + np.eye(have.shape[0])

    def value(chosen: Sequence[int]) -> float:
        return float(np.linalg.slogdet(have + sum(known.experiments[i].parameters for i in chosen))[1])

    begin = value([])
    places = filled(known, lambda chosen: value(chosen) - begin)
    return Choice(places, "to know the nominal parameters best") if places else None
