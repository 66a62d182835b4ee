"""Simulates candidates in tables whose controllers do not know them: draws over the priors, then a local search.

A point (k + 1,) of the unit cube is a candidate's k numbers and, last, how long the table rests before the sequence:
an effect with its own time base, such as a vibration, then has another phase relative to the motions.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from design.validation import Validation
from models.machine import Machine, Published
from studies.paper_gap.candidates import (
    BESIDE_FRICTION,
    COMPENSATOR,
    Candidate,
    Table,
    beyond,
    both,
    every,
    wrong_friction,
)
from studies.paper_gap.compensators import slope_error
from studies.paper_gap.pattern import COARSE_SUBSTEPS, CONVERGED, Outcome, Pattern, by_scale, outcome_of

SEARCH_STEPS: Final = (0.15, 0.08, 0.03)  # Step of each round of the local search, as a fraction of the cube.
BEYOND_PRIOR_RATIO: Final = 10.0  # "Beyond" extends to this multiple of a prior's end.
ALONE, BESIDE, BEYOND = "alone", "beside", "beyond"


@dataclass(frozen=True)
class Case:
    """A candidate in one of three cases: alone, together with a wrong friction, beyond its prior."""

    name: str
    way: str = ALONE

    def candidate(self) -> Candidate:
        """The candidate with which the table is simulated."""
        one = every()[self.name]
        if self.way == BESIDE:
            return both(one, wrong_friction(BESIDE_FRICTION))
        return beyond(one, BEYOND_PRIOR_RATIO) if self.way == BEYOND else one


@dataclass(frozen=True)
class Draw:
    """One size of a case in one table, its outcome, and that outcome's distance [m] from the pattern.

    loose_distance [m]: from the pattern without its inching motions that miss. found: by the local search, so that it
    does not count in any share. without_off: the largest relative error [1] of the published figures without
    compensation; slopes_off: of the RFM's two slopes; both 0 where the loose pattern is not met.
    """

    case: Case
    table: int
    point: tuple[float, ...]
    values: tuple[float, ...]
    outcome: Outcome
    distance: float
    found: bool
    loose_distance: float = 0.0
    without_off: float = 0.0
    slopes_off: float = 0.0

    @property
    def shows(self) -> bool:
        """Whether it shows the pattern."""
        return self.distance == 0.0

    @property
    def disperses(self) -> bool:
        """Whether it has the pattern's 3 sigma and a reversal in time."""
        return self.loose_distance == 0.0

    def fits(self, share: float) -> bool:
        """Whether figures without compensation and slopes of the RFM are as published, too, within a share [1]."""
        return max(self.without_off, self.slopes_off) <= share


@dataclass(frozen=True)
class Effort:
    """draws: of a case, over all tables; kept: best draws that each round of the search begins from; near: points
    drawn near each of them; rounds: at most len(SEARCH_STEPS)."""

    draws: int
    kept: int
    near: int
    rounds: int

    @property
    def simulations(self) -> int:
        """Of one case."""
        return self.draws + self.rounds * self.kept * self.near


Place = tuple[int, tuple[float, ...]]  # a table and a point


def rest(machine: Machine, point: Sequence[float]) -> int:
    """Samples of rest before the sequence: up to the interval between motions."""
    return int(point[-1] * machine.specification.interval / machine.sample_time)


def simulated(table: Table, case: Case, point: Sequence[float], substeps: int = COARSE_SUBSTEPS) -> Validation:
    """The sequence, by the scale, of a table with a case at a point (k + 1,); substeps in a sample."""
    one = case.candidate()
    machine, controller = one.put(table, one.values(point[:-1]))
    return by_scale(machine, controller, rest(machine, point), substeps)


def without_compensation(table: Table, case: Case, point: Sequence[float]) -> Outcome:
    """The outcome of the same table without its compensation, at CONVERGED substeps."""
    one = case.candidate()
    machine, controller = one.put(table, one.values(point[:-1]))
    return outcome_of(by_scale(machine, controller.without_compensation(), rest(machine, point), CONVERGED))


def draw(tables: Sequence[Table], case: Case, pattern: Pattern, place: Place, found: bool) -> Draw:
    """The outcome of a case at a place: at COARSE_SUBSTEPS substeps where it is far from what was published, else
    CONVERGED."""
    table, point = place
    outcome = outcome_of(simulated(tables[table], case, point))
    if pattern.near(outcome):
        outcome = outcome_of(simulated(tables[table], case, point, CONVERGED))
    one = case.candidate()
    values, loose = one.values(point[:-1]), pattern.loose_distance(outcome)
    off = (0.0, 0.0) if loose else _beside_the_paper(tables[table], case, point)
    return Draw(case, table, point, values, outcome, pattern.distance(outcome), found, loose, *off)


def off_published(outcome: Outcome, published: Published) -> float:
    """The larger relative error [1] of an outcome without compensation: the reversal's settling time, and 3 sigma."""
    return max(
        abs(outcome.reversal_settling / published.reversal_settling_time - 1),
        abs(outcome.dispersion / published.dispersion_without - 1),
    )


def _beside_the_paper(table: Table, case: Case, point: Sequence[float]) -> tuple[float, float]:
    """Relative errors [1] of the figures without compensation, and of the slopes of an RFM by another design."""
    one, published = case.candidate(), table[0].published
    assert published is not None  # else there would be no pattern
    rfm = one.put(table, one.values(point[:-1]))[1].friction_compensation
    slopes = slope_error(table[0], rfm) if one.kind == COMPENSATOR and rfm is not None else 0.0
    return off_published(without_compensation(table, case, point), published), slopes


def explore(tables: Sequence[Table], case: Case, pattern: Pattern, effort: Effort, seed: int) -> list[Draw]:
    """The draws of a case: a Latin hypercube, spread evenly over the tables, then rounds near the best so far.

    The same for the same seed, whatever else is explored.
    """
    rng = np.random.default_rng([seed, zlib.crc32(f"{case.name} {case.way}".encode())])
    size = len(case.candidate().ranges) + 1
    cube = scipy.stats.qmc.LatinHypercube(size, seed=rng).random(effort.draws)
    draws = [
        draw(tables, case, pattern, (i % len(tables), tuple(map(float, point))), False) for i, point in enumerate(cube)
    ]
    for step in SEARCH_STEPS[: effort.rounds]:
        draws += [draw(tables, case, pattern, place, True) for place in _near(draws, effort, step, rng)]
    return draws


def _near(draws: Sequence[Draw], effort: Effort, step: float, rng: np.random.Generator) -> Iterator[Place]:
    """Places near the best draws, folded back into the cube."""
    for one in sorted(draws, key=lambda one: (one.distance, one.loose_distance))[: effort.kept]:
        for _ in range(effort.near):
            moved = np.abs(np.array(one.point) + step * rng.standard_normal(len(one.point)))
            yield one.table, tuple(map(float, np.clip(1.0 - np.abs(1.0 - moved), 0.0, 1.0)))


def explore_all(
    tables: Sequence[Table],
    cases: Sequence[Case],
    pattern: Pattern,
    effort: Effort,
    seed: int,
    pool: Executor | None,
    tell: Callable[[float, str], None],
) -> list[list[Draw]]:
    """`explore` of each case, by the pool's processes where there is one; `tell` reports each that is done."""
    mapped = (pool.map if pool else map)(_explored, ((tables, case, pattern, effort, seed) for case in cases))
    done = []
    for case, draws in zip(cases, mapped, strict=True):
        done.append(draws)
        tell(len(done) / len(cases), f"{case.name.replace('_', ' ')}, {case.way}: {sum(d.shows for d in draws)} shown")
    return done


def _explored(given: tuple[Sequence[Table], Case, Pattern, Effort, int]) -> list[Draw]:
    return explore(*given)
