"""The set of tables consistent with the paper: a seeded search over the parameters that it does not publish.

A table is a point theta in a box of unpublished parameters. It belongs to the set if it meets every published outcome
within TOLERANCE: the reversal's settling and the dispersion without compensation, the slopes K_e1 and K_e2, T_fc and
the modes (these by construction); if its loop has Ms <= LARGEST_MS on P_l, P_e1 and P_e2; if no thrust exceeds the
rating, and the deadbeat of III.A respects it without a limit, as the paper's has none; and if z^-2 are the whole
samples of its dead time.

The search is approximate Bayesian computation by population Monte Carlo, with a uniform prior on the logarithms
(T. Toni et al., J. R. Soc. Interface 6 (2009) 187-202), without its importance weights: a set is wanted, not a
posterior.
"""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.controller import usable_thrust
from design.deadbeat import DesignError
from design.loop import assess, controller_response, frequency_response, sensitivities, spectral_radius
from design.validation import Validation, validate_many
from models.controller import PID, Controller
from models.friction import elements
from models.machine import Machine
from models.plant import Plant, sampled
from studies.response_variation.conventions import CHOSEN, Convention, bare, three_sigma

Array = NDArray[np.float64]

TOLERANCE: Final = 0.03
LARGEST_MS: Final = 2.2
FREQUENCIES: Final = 400  # at which |S| of a table is looked at, evenly spread in their logarithm
POPULATION: Final = 160
BATCH: Final = 64
EMPTY: Final = 20  # So many batches without a table of the set end a search: each held some for the paper's table.
COARSE_SUBSTEPS: Final = 10  # substeps in a sample of the search
FINE_SUBSTEPS: Final = 40  # of its verification


@dataclass(frozen=True)
class Range:
    """One unpublished parameter: the search is uniform in its logarithm between low and high (SI)."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str


RANGES: Final = (
    Range("mass", 15.0, 80.0, "kg", "mass of table and flexible load"),
    Range("stand", 10.0, 80.0, "1", "stand's mass over the table's"),
    Range("load", 0.01, 0.08, "1", "flexible load's share of the mass"),
    Range("damping_1", 0.005, 0.04, "1", "damping ratio of the mode at 38 Hz"),
    Range("damping_2", 0.005, 0.04, "1", "damping ratio of the mode at 81 Hz"),
    # The paper's z^-2 are the whole samples of L; up to here they are the nearest whole number, too.
    Range("dead_time", 1.0e-3, 1.25e-3, "s", "equivalent dead time"),
    Range("bandwidth", 25.0, 60.0, "Hz", "w / 2 pi of the PID's rules: kd = a M w, kp = b kd w, ki = c kp w"),
    Range("a", 0.6, 1.3, "1", "derivative gain over M w"),
    Range("b", 0.25, 0.9, "1", "proportional gain over kd w"),
    Range("c", 0.03, 0.3, "1", "integral gain over kp w"),
    Range("derivative_filter", 0.1e-3, 0.8e-3, "s", "filter time of the derivative"),
    Range("slope_1", 776e3, 824e3, "N/m", "slope of Region 1"),
    Range("slope_2", 97e3, 103e3, "N/m", "slope of Region 2"),
    Range("smallest", 0.5e-6, 3e-6, "m", "smallest limit of the friction elements"),
    Range("largest", 8e-6, 16e-6, "m", "largest limit within Region 1"),
    Range("shape", 0.3, 3.0, "1", "exponent of the elements' forces"),
)
LOW: Final = np.log([one.low for one in RANGES])
HIGH: Final = np.log([one.high for one in RANGES])


class SearchError(ValueError):
    """A search that finds nothing; the message says what to change."""


@dataclass(frozen=True)
class Member:
    """One table of the set: its point theta (len(RANGES),), and the deviation of its outcomes in units of TOLERANCE."""

    theta: Array
    machine: Machine
    distance: float


def search(
    base: Machine,
    count: int,
    seed: int,
    *,
    workers: int,
    tell: Callable[[float, str], None],
    convention: Convention = CHOSEN,
    held: int | None = None,
) -> tuple[Member, ...]:
    """`count` tables of the set that differ as much as possible, in the order of their distance.

    held: so many tables are kept from step to step, and `count` of them at the end (default: POPULATION).

    `tell(share, text)` reports progress. The same seed gives the same tables for any number of workers. Raises
    SearchError where EMPTY batches in a row hold no table that could be of the set.
    """
    size = held or POPULATION
    rng = np.random.default_rng(seed)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        population: list[Member] = []
        empty = 0
        while len(population) < 2 * size:
            begun = len(population)

            def heard(found: int, begun: int = begun) -> None:
                number = min(begun + found, 2 * size)
                tell(0.2 * number / (2 * size), f"first tables: {number} of {2 * size}")

            population += _evaluated(base, _uniform(base, rng, 4 * BATCH, heard), convention, pool, heard)
            empty = 0 if len(population) > begun else empty + 1
            _require_some(empty)
        population = sorted(population, key=lambda member: member.distance)[:size]
        first = population[-1].distance
        while (worst := population[-1].distance) > 1:
            aim = _next_aim([member.distance for member in population])
            near = [member for member in population if member.distance <= aim]
            spread = np.cov(np.stack([member.theta for member in population]).T)
            while len(near) < size:
                drawn, begun = _perturbed(base, near or population, spread, rng), len(near)
                near += [member for member in _evaluated(base, drawn, convention, pool, None) if member.distance <= aim]
                empty = 0 if len(near) > begun else empty + 1
                _require_some(empty)
                tell(
                    0.2 + 0.6 * (1 - math.log(worst) / math.log(first)),
                    f"{min(len(near), size)} of {size} tables within {aim * TOLERANCE:.1%}",
                )
            population = sorted(near, key=lambda member: member.distance)[:size]
        population = _verified(base, population, convention, pool, tell)
    return _distinct(population, count)


def _next_aim(distances: Sequence[float]) -> float:
    """The distance that the next step asks for, from those of the population in ascending order: the median, or 1.

    Settling times are whole samples, so that many tables may be equally far. Where the better half is as far as the
    worst, the next lower distance is asked for, or less than all have, as the search would stay where it is otherwise.
    """
    worst, median = distances[-1], distances[len(distances) // 2]
    if median < worst:
        return max(1.0, median)
    lower = [one for one in distances if one < worst]
    return max(1.0, max(lower, default=math.nextafter(worst, 0.0)))


def _require_some(empty: int) -> None:
    if empty >= EMPTY:
        raise SearchError(
            f"{EMPTY} batches of tables in a row hold none whose outcomes come near those in [published]; correct "
            "them, or the machine's drive, friction or specification"
        )


def table(base: Machine, theta: Array) -> Machine:
    """The machine at a point theta of the logarithms; numbers rounded to five digits, as its file will hold them."""
    p = {one.name: float(value) for one, value in zip(RANGES, np.exp(theta), strict=True)}
    w = 2 * math.pi * p["bandwidth"]
    kd = p["a"] * p["mass"] * w
    kp = p["b"] * kd * w
    moved = base.plant.thrust_constant * p["mass"]  # the gains are per newton of thrust, the mass of thrust reference
    stand, load = base.plant.flexible
    drawn = {
        base.plant.rigid: (1 / moved, base.plant.modes[base.plant.rigid].damping),
        stand: (1 / (p["stand"] * moved), p["damping_1"]),
        load: (p["load"] / (1 - p["load"]) / moved, p["damping_2"]),
    }
    modes = tuple(
        replace(mode, gain=_rounded(drawn[i][0]), damping=_rounded(drawn[i][1]))
        for i, mode in enumerate(base.plant.modes)
    )
    pid = PID(_rounded(kp), _rounded(p["c"] * kp * w), _rounded(kd), _rounded(p["derivative_filter"]))
    limit, stiffness = _elements(base, p)
    return replace(
        base,
        plant=Plant(_rounded(p["dead_time"]), base.plant.thrust_constant, modes),
        friction=elements([_rounded(k) for k in stiffness], [_rounded(x) for x in limit]),
        control=replace(base.control, pid=pid),
    )


def _elements(base: Machine, p: dict[str, float]) -> tuple[Array, Array]:
    """Limits and stiffnesses (10,): nine elements for Region 1, one for Region 2, with the two slopes and T_fc met.

    Behind a reversal the nine climb 2 F_i min(s / 2 X_i, 1) each; their share of T_fc is such that slope_1 is climbed
    at the boundary; the one ends the climb of 2 T_fc where slope_2 says.
    """
    facts = base.presliding
    x = np.geomspace(p["smallest"], p["largest"], len(base.friction.limit) - 1)
    shape = x ** p["shape"] / np.sum(x ** p["shape"])
    corner = p["slope_1"] * facts.boundary
    last = 0.5 * (facts.boundary + (2 * facts.coulomb_force - corner) / p["slope_2"])
    by_nine = float(np.sum(shape * np.minimum(facts.boundary / x, 2.0)))  # climbed at the boundary, per newton of share
    by_last = facts.boundary / last
    share = (corner - facts.coulomb_force * by_last) / (by_nine - by_last)
    forces = np.append(share * shape, facts.coulomb_force - share)
    limits = np.append(x, last)
    return limits, forces / limits


def largest_sensitivity(machine: Machine) -> float:
    """The largest Ms [1] of the loop with P_l, P_e1 and P_e2, on FREQUENCIES of them; inf if a loop is unstable.

    It screens the many tables that a search refuses; `exact_sensitivity` finds the peak between these frequencies,
    which is up to 0.5 % higher.
    """
    pid, ts, facts = machine.control.pid, machine.sample_time, machine.presliding
    omega = 2 * math.pi * np.geomspace(1.0, 0.499 / ts, FREQUENCIES)
    law, peaks = controller_response(pid, ts, omega), []
    for slope in (0.0, facts.stiffness_1, facts.stiffness_2):
        plant = sampled(machine.plant, ts, slope)
        if spectral_radius(plant, pid) >= 1:
            return math.inf
        peaks.append(float(np.max(np.abs(sensitivities(frequency_response(plant, omega), law)["S"]))))
    return max(peaks)


def exact_sensitivity(machine: Machine) -> float:
    """The largest Ms [1] of the loop with P_l, P_e1 and P_e2, over all frequencies."""
    facts, ts = machine.presliding, machine.sample_time
    slopes = (0.0, facts.stiffness_1, facts.stiffness_2)
    return max(assess(sampled(machine.plant, ts, slope), machine.control.pid).ms.value for slope in slopes)


def distance(machine: Machine, without: Validation, convention: Convention = CHOSEN) -> float:
    """Distance of the outcomes from the published ones, in units of TOLERANCE; inf for an inadmissible table.

    A thrust reference above the rating, or a motion that does not settle, is inadmissible.
    """
    published = machine.published
    assert published is not None
    if not math.isfinite(without.slowest.settling_time) or without.peak_thrust > machine.drive.rated_thrust:
        return math.inf
    off = (
        without.reversal.settling_time / published.reversal_settling_time - 1,
        three_sigma(without, convention) / published.dispersion_without - 1,
    )
    return max(abs(one) for one in off) / TOLERANCE


def _rounded(number: float) -> float:
    return float(f"{number:.5g}")


def _plausible(base: Machine, theta: Array) -> bool:
    """Whether a point is in the box, with positive friction in every element and an acceptable loop."""
    if np.any(theta < LOW) or np.any(theta > HIGH):
        return False
    machine = table(base, theta)
    if min(machine.friction.stiffness) <= 0:
        return False
    return largest_sensitivity(machine) <= LARGEST_MS


def _uniform(base: Machine, rng: np.random.Generator, tries: int, heard: Callable[[int], None]) -> list[Array]:
    kept = []
    for i, theta in enumerate(LOW + (HIGH - LOW) * rng.random((tries, LOW.size))):
        if i % BATCH == 0:
            heard(0)
        if _plausible(base, theta):
            kept.append(theta)
    return kept


def _perturbed(base: Machine, near: list[Member], spread: Array, rng: np.random.Generator) -> list[Array]:
    """Points around members of the population, with its covariance: one batch."""
    drawn: list[Array] = []
    while len(drawn) < BATCH:
        centre = near[int(rng.integers(len(near)))].theta
        theta = rng.multivariate_normal(centre, 0.5 * spread + 1e-9 * np.eye(LOW.size))
        if _plausible(base, theta):
            drawn.append(theta)
    return drawn


def _evaluated(
    base: Machine,
    drawn: list[Array],
    convention: Convention,
    pool: ProcessPoolExecutor,
    heard: Callable[[int], None] | None,
) -> list[Member]:
    """The admissible points as members; `heard` receives their growing number."""
    members: list[Member] = []
    for part in _by_parts(base, drawn, convention, pool, COARSE_SUBSTEPS):
        members += [member for member in part if math.isfinite(member.distance)]
        if heard is not None:
            heard(len(members))
    return members


def _verified(
    base: Machine,
    population: list[Member],
    convention: Convention,
    pool: ProcessPoolExecutor,
    tell: Callable[[float, str], None],
) -> list[Member]:
    """The members that are within the tolerance at FINE_SUBSTEPS substeps too, so that none owes it to a simulation
    error, and whose Ms is within LARGEST_MS between the frequencies of the screening, too.
    """
    fine: list[Member] = []
    population = [member for member in population if exact_sensitivity(member.machine) <= LARGEST_MS]
    points = [member.theta for member in population]
    tell(0.8, f"verifying {len(points)} tables at {FINE_SUBSTEPS} substeps")
    for part in _by_parts(base, points, convention, pool, FINE_SUBSTEPS):
        fine += part
        tell(
            0.8 + 0.2 * len(fine) / len(points),
            f"verified {len(fine)} of {len(points)} tables at {FINE_SUBSTEPS} substeps",
        )
    within = {tuple(one.theta) for one in fine if one.distance <= 1}
    return [member for member in population if tuple(member.theta) in within]


def _by_parts(
    base: Machine, points: list[Array], convention: Convention, pool: ProcessPoolExecutor, substeps: int
) -> Iterator[list[Member]]:
    """The points evaluated by the pool, in order: in batches, smaller where each point takes longer."""
    size = max(BATCH * COARSE_SUBSTEPS // (2 * substeps), 1)
    parts = [points[i : i + size] for i in range(0, len(points), size)]
    yield from pool.map(evaluate, [base] * len(parts), parts, [substeps] * len(parts), [convention] * len(parts))


def evaluate(base: Machine, points: list[Array], substeps: int, convention: Convention = CHOSEN) -> list[Member]:
    """The tables at these points with their distances, simulated side by side without compensation [substeps]."""
    machines, controllers, kept = [], [], []
    for theta in points:
        machine = table(base, theta)
        try:
            controller = bare(machine, convention)
        except DesignError:
            continue  # no deadbeat within the thrust
        if saturated(machine, controller):
            continue
        controllers.append(controller)
        machines.append(machine)
        kept.append(theta)
    if not machines:
        return []
    validations = validate_many(machines, controllers, substeps=substeps)
    return [
        Member(theta, machine, distance(machine, without, convention))
        for theta, machine, without in zip(kept, machines, validations, strict=True)
    ]


def saturated(machine: Machine, controller: Controller) -> bool:
    """Whether the feedforward [N] reaches the thrust limit, which makes it differ from the paper's.

    The paper's deadbeat has no limit, so a table on which a limit shapes the feedforward cannot be the paper's.
    """
    peak = machine.specification.stroke * float(np.max(np.abs(np.cumsum(controller.d_ff))))
    return peak >= (1 - 1e-6) * usable_thrust(machine)


def _distinct(population: list[Member], count: int) -> tuple[Member, ...]:
    """`count` members that lie far from each other: the next is always the one farthest from those chosen."""
    points = (np.stack([member.theta for member in population]) - LOW) / (HIGH - LOW)
    chosen = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(population)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return tuple(sorted((population[i] for i in chosen), key=lambda member: member.distance))
