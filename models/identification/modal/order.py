"""How many modes a frequency response shows: the fewest that pass.

Orders are fitted one after the other, with lag and drag beside the modes where there may be any, and with a spring to
ground where one shows beside what was found without it, so that no mode stands for them. From the order with the best
criterion on, whatever is not a mode is taken out and the rest fitted again: what ends at a bound of the search or
outside the measured band, is damped as no structure is, is narrower than the lines of a single record, forms a pair
with a neighbour of the other sign, or whose residue is smaller than three deviations. Then every part, mode, lag, drag
or spring, whose loss raises the criterion by less than ten is taken out, the least first. The criterion is Bayes's,
with the errors' variance that the best order leaves: without that, what no mode explains (an encoder's period, an
amplifier's knee) would be explained by ever more of them. Of a record with thousands of lines a few hundred decide how
many modes there are; lag, drag and spring are small, and are decided on all of them. A scan that ends far from the
stated errors is made again from the modes that a growing band shows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from models.identification.estimate import STRONG
from models.identification.modal.fitting import (
    LEAST_DAMPING,
    MAX_COMPARED_LINES,
    MOST_DAMPING,
    bounds,
    jacobian,
    refined,
    residual,
    trend,
    with_mode,
)
from models.identification.modal.problem import Problem, Structure
from models.identification.modal.transfer import Array

HEAVY: Final = 0.2  # damping ratio that no structure has: such a mode stands for friction
MAX_MODE_GAIN_RATIO: Final = 10.0  # times the rigid body's gain: a larger mode is half of a pair that cancels itself
SEEN: Final = 3.0  # standard deviations that a residue is from none at least
WORSE: Final = 2  # orders in a row whose criterion is worse: then none better follows
BOUND_FACTOR: Final = 1.05  # factor from a bound of the search within which a value stands at it
SURE_PART_SQUARED_STDS: Final = 400.0  # squared deviations from none from which on no trial without a part is needed
MISFIT_VARIANCE_RATIO: Final = 10.0  # times the stated variance: what is left is no scatter, and another start is tried
THIRD: Final = 2 ** (1 / 3)  # by which a band grows; by a whole octave a large mode may come too suddenly to be found
MIN_BAND_LINES: Final = 12  # lines that such a band has at least
EDGE: Final = 1.1  # times the lowest line: a mode below stands for friction where the axis did not roll
SAME_MODE_DISTANCE: Final = 0.02  # relative distance of two frequencies that count as the same mode in another order


@dataclass(frozen=True)
class Candidate:
    """One structure with so many modes, fitted: theta (p,), its covariance (p, p) and its weighted squares' sum [1]."""

    structure: Structure
    theta: Array
    covariance: Array
    cost: float

    @property
    def modes(self) -> int:
        """How many vibration modes."""
        return (self.theta.size - self.structure.before) // 3

    @property
    def triples(self) -> Array:
        """(k_i / k_0, f_i [Hz], zeta_i) of each mode (m, 3)."""
        found = self.theta[self.structure.before :].reshape(-1, 3).copy()
        found[:, 1:] = np.exp(found[:, 1:])
        return found

    def deviation(self, index: int) -> float:
        """The standard deviation of one of theta."""
        return math.sqrt(max(float(self.covariance[index, index]), 0.0))


@dataclass(frozen=True)
class Order:
    """One order of the scan: (k_i / k_0, f_i [Hz], zeta_i) of its modes (m, 3), why each is not one ("" if it is), its
    reduced chi-square and its criterion."""

    triples: Array
    faults: tuple[str, ...]
    chi_square: float
    criterion: float


@dataclass(frozen=True)
class Chosen:
    """The candidate that passes, the orders that were looked at, and the criteria by which parts were kept: how much
    each part's loss would raise it, by the part's name. bent: the low lines ask for what no structure has."""

    best: Candidate
    orders: tuple[Order, ...]
    worth: dict[str, float]
    bent: bool = False


def chosen(
    problem: Problem, most: int, candidates: Structure, *, exactly: int | None = None, rolling: bool = True
) -> Chosen:
    """The order that the lines show, at most `most` modes; see the module's head. exactly: so many modes instead.

    candidates: what may be beside the modes. rolling: else an order that does better by a mode that stands for friction
    ends the search at once, as the lines are then of no use. A spring is one where it shows beside all that the lines
    ask for without one: sought throughout, it would cost a weak mode among the lines of an axis that has none. One that
    is known to be there is sought from the start.
    """
    if candidates.spring and problem.spring > 0:
        return _chosen(problem, most, candidates, exactly, rolling)
    plain = _chosen(problem, most, replace(candidates, spring=False), exactly, rolling)
    if plain.bent or not (candidates.spring and _sprung(problem, plain.best)):
        return plain
    return _chosen(problem, most, candidates, exactly, rolling)


def _sprung(problem: Problem, one: Candidate) -> bool:
    """Whether a spring added to a candidate shows surely, and lowers the criterion by ten."""
    structure = replace(one.structure, spring=True)
    more = fitted(problem, structure, _with_parts(problem, one, structure))
    scale = max(1.0, more.cost / max(problem.size - more.theta.size, 1))
    fallen = _criterion(problem, one, scale) - _criterion(problem, more, scale)
    return fallen > STRONG and not _at_bound(problem, more, "spring")


def _chosen(problem: Problem, most: int, candidates: Structure, exactly: int | None, rolling: bool) -> Chosen:
    """As `chosen`, with all candidates from the first order on.

    Where what passes is far from the stated errors, the modes may be too large for a start without any: then those that
    a growing band shows begin a second scan, and the better of both counts.
    """
    most, few = most if exactly is None else exactly, problem.thinned(MAX_COMPARED_LINES)
    found = _passed(problem, _scanned(problem, most, candidates, exactly, rolling), exactly, rolling)
    if few.known and not found.bent and found.best.cost > MISFIT_VARIANCE_RATIO * few.size:
        scanned = _scanned_from(problem, _grown(few, candidates, most), most, exactly, rolling)
        again = _passed(problem, scanned, exactly, rolling)
        found = min(found, again, key=lambda one: one.best.cost)
    if few.size == problem.size or found.bent:
        return found
    best, nuisances = _with_all_lines(problem, found.best, candidates)
    worth = {name: found.worth[name] for name in found.worth if name.startswith("mode")} | nuisances
    return replace(found, best=best, worth=worth)


def _passed(problem: Problem, scanned: list[Candidate], exactly: int | None, rolling: bool) -> Chosen:
    """What is left of the best order without what is no mode, or is not worth its parameters; on a few of the lines."""
    scale, few = _scale(problem, scanned), problem.thinned(MAX_COMPARED_LINES)
    wrong = [faults(few, one) for one in scanned]
    orders = tuple(_told(few, one, wrong[i], scale) for i, one in enumerate(scanned))
    if not rolling and _bent(problem, scanned):
        return Chosen(scanned[-1], orders, {}, bent=True)
    best = scanned[-1] if exactly is not None else _sound(few, scanned, wrong, scale)
    best, worth = _fewest(few, best, scale, modes=exactly is None)
    return Chosen(best, orders, worth)


def _sound(few: Problem, scanned: list[Candidate], wrong: list[tuple[str, ...]], scale: float) -> Candidate:
    """The best order without what is no mode, or the best of those that have no such mode, whichever is better: of an
    order with too many, a mode that stands beside them may seem not to be seen, and is lost with them. wrong: the
    faults of each order's modes."""
    best = min(range(len(scanned)), key=lambda i: _criterion(few, scanned[i], scale))
    without = [one for one, found in zip(scanned, wrong, strict=True) if not any(found)]
    mended = _without_faults(few, scanned[best], wrong[best])
    return min(mended, *without, key=lambda one: _criterion(few, one, scale))


def _with_all_lines(problem: Problem, one: Candidate, candidates: Structure) -> tuple[Candidate, dict[str, float]]:
    """The candidate fitted to all lines, with those of the candidates that these show, and what each is worth."""
    whole = fitted(problem, one.structure, one.theta)
    for structure in (replace(one.structure, lag=True), replace(candidates, spring=False), candidates):
        if structure != whole.structure:
            more = fitted(problem, structure, _with_parts(problem, whole, structure))
            whole = min(whole, more, key=lambda fit: fit.cost)  # a search may end where nothing is gained
    scale = max(1.0, whole.cost / max(problem.size - whole.theta.size, 1))
    return _fewest(problem, whole, scale, modes=False)


def _with_parts(problem: Problem, one: Candidate, structure: Structure) -> Array:
    """theta (p,) [1] of a candidate with the parts of a structure; what it lacks begins as is usual."""
    theta, own = one.theta, one.structure
    usual = trend(structure, problem)
    parts = {
        part: theta[own.index(part)] if getattr(own, part) else usual[structure.index(part)] for part in structure.parts
    }
    late = theta[1] - (parts["lag"] if structure.lag and not own.lag else 0.0)
    return np.array([theta[0], late, *parts.values(), *theta[own.before :]])


def fitted(problem: Problem, structure: Structure, start: Array, evaluations: int = 30) -> Candidate:
    """A structure fitted from a start of theta [1]."""
    theta = refined(start, structure, problem, evaluations=evaluations)
    left, slopes = residual(theta, structure, problem), jacobian(theta, structure, problem)
    size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-140)
    inverse = np.linalg.pinv((slopes / size).T @ (slopes / size), rcond=1e-14, hermitian=True) / np.outer(size, size)
    cost = float(left @ left)
    chi_square = cost / max(problem.size - theta.size, 1)
    return Candidate(structure, theta, inverse * (max(1.0, chi_square) if problem.known else chi_square), cost)


def beside_unseen(problem: Problem, one: Candidate, candidates: Structure) -> Candidate:
    """The candidate with deviations that allow for what it lacks: a lag or a drag that is there, but is not worth its
    parameter, moves the other values by many of those deviations that a fit without it gives (on a simulated ball screw
    the gain of a mode at 62 Hz by eleven, for a lag of 0.27 ms in place of as much dead time). So values are also
    uncertain by as much as such a part, fitted, moves them, and together.
    """
    structure = replace(candidates, spring=one.structure.spring)
    if structure == one.structure:
        return one
    more = fitted(problem, structure, _with_parts(problem, one, structure))
    away = np.abs(np.log(more.triples[:, 1] / one.triples[:, 1]))
    if more.cost > one.cost or np.any(away > SAME_MODE_DISTANCE):  # the search ended elsewhere
        return one
    kept = [
        *range(2),
        *(structure.index(part) for part in one.structure.parts),
        *range(structure.before, more.theta.size),
    ]
    moved = more.theta[kept] - one.theta
    if structure.lag and not one.structure.lag:
        moved[1] += more.theta[structure.index("lag")]  # what lags is late
    return replace(one, covariance=one.covariance + np.outer(moved, moved))


def faults(problem: Problem, one: Candidate) -> tuple[str, ...]:
    """Why each mode of a candidate is not one, in words; "" for one that is."""
    return tuple(next(_faults(problem, one, i), "") for i in range(one.modes))


def _faults(problem: Problem, one: Candidate, i: int) -> Iterator[str]:
    low, high = problem.band
    gain, natural, damping = one.triples[i]
    others = np.delete(one.triples, i, axis=0)
    if not low < natural < high:
        yield "outside the measured band"
    if not LEAST_DAMPING * BOUND_FACTOR < damping < MOST_DAMPING / BOUND_FACTOR:
        yield "damping at a bound of the search"
    if damping > HEAVY:
        yield "damped as no structure is"
    if abs(gain) > MAX_MODE_GAIN_RATIO:
        yield f"more than {MAX_MODE_GAIN_RATIO:g} times the rigid body's gain"
    near = np.abs(others[:, 1] - natural) < damping * natural + others[:, 2] * others[:, 1]
    if np.any(near & (others[:, 0] * gain < 0) & (np.abs(others[:, 0]) >= abs(gain))):
        yield "cancelled by its neighbour"
    apart = [float(np.min(np.diff(lines.f))) for lines in problem.lines if lines.single]
    if apart and natural * damping < min(apart):
        yield "narrower than the lines are apart, as a disturbing tone is"
    # Beside a lag, which makes up for a part of it, a residue's deviation is large however much is lost with it.
    if not abs(gain) > SEEN * one.deviation(one.structure.before + 3 * i) and not _is_missed(problem, one, i):
        yield f"residue smaller than {SEEN:g} deviations"


def _is_missed(problem: Problem, one: Candidate, i: int) -> bool:
    """Whether the others do not make up for a mode, fitted again without it."""
    scale = one.cost / max(problem.size - one.theta.size, 1)
    lost = _without(problem, one, f"mode {i}").cost - one.cost
    return lost > SEEN**2 * (max(1.0, scale) if problem.known else scale)


def _bent(problem: Problem, found: list[Candidate]) -> bool:
    """Whether the last order does surely better than those before, by a mode at the lowest lines or damped as no
    structure is."""
    few, scale = problem.thinned(MAX_COMPARED_LINES), _scale(problem, found)
    criteria = [_criterion(few, one, scale) for one in found]
    modes = found[-1].triples
    wrong = np.any((modes[:, 2] > HEAVY) | (modes[:, 1] < EDGE * problem.band[0]))
    return len(found) > 1 and bool(wrong) and criteria[-1] < min(criteria[:-1]) - STRONG


def _scanned(problem: Problem, most: int, structure: Structure, exactly: int | None, rolling: bool) -> list[Candidate]:
    """Candidates with 0, 1, ... modes, until the criterion has been worse WORSE times in a row."""
    few = problem.thinned(MAX_COMPARED_LINES)
    return _from(few, [fitted(few, structure, trend(structure, few))], most, exactly, rolling)


def _scanned_from(problem: Problem, grown: Candidate, most: int, exactly: int | None, rolling: bool) -> list[Candidate]:
    """The same with the candidate that a growing band shows, and more modes from there on."""
    few, structure = problem.thinned(MAX_COMPARED_LINES), grown.structure
    found = [fitted(few, structure, trend(structure, few))]
    while len(found) < grown.modes:
        found.append(fitted(few, structure, with_mode(found[-1].theta, structure, few)))
    return _from(few, [*found[: grown.modes], grown], most, exactly, rolling)


def _from(few: Problem, found: list[Candidate], most: int, exactly: int | None, rolling: bool) -> list[Candidate]:
    """A scan that goes on from the candidates with the fewest modes."""
    while len(found) <= most:
        structure = found[-1].structure
        found.append(fitted(few, structure, with_mode(found[-1].theta, structure, few)))
        scale = _scale(few, found)
        criteria = [_criterion(few, one, scale) for one in found]
        if exactly is None and min(criteria[-WORSE:]) > min(criteria) and len(found) > WORSE:
            break
        if not rolling and _bent(few, found):
            break
    return found


def _grown(problem: Problem, structure: Structure, most: int) -> Candidate:
    """The modes that show as the band grows by THIRDs of an octave, from the lowest two octaves on, where an axis is
    hardly more than a rigid body; fitted to the whole band at last. Without a lag, which a dead time stands in for, and
    without what is not a mode: in a narrow band either would pass for the slopes of a mode above it."""
    low, high = problem.band
    every = np.sort(np.concatenate([one.f for one in problem.lines]))
    top, plain = max(4 * low, float(every[min(MIN_BAND_LINES, every.size) - 1])), replace(structure, lag=False)
    part = problem.up_to(top)
    one = fitted(part, plain, trend(plain, part))
    while top < high:
        top *= THIRD
        part = problem.up_to(top)
        one = fitted(part, plain, one.theta)
        while one.modes < most:
            more = _without_faults(part, fitted(part, plain, with_mode(one.theta, plain, part)))
            scale = _scale(part, [one, more])
            if _criterion(part, one, scale) - _criterion(part, more, scale) < STRONG:
                break
            one = more
    return fitted(problem, structure, _with_parts(problem, one, structure))


def _scale(problem: Problem, found: list[Candidate]) -> float:
    """The variance of the errors over the stated one, as the best order leaves it; at least 1."""
    few = problem.thinned(MAX_COMPARED_LINES)
    return max(1.0, min(one.cost / max(few.size - one.theta.size, 1) for one in found))


def _criterion(problem: Problem, one: Candidate, scale: float) -> float:
    """Bayes's information criterion; for unknown variances with the one that the fit leaves."""
    n = problem.size
    return (one.cost / scale if problem.known else n * math.log(one.cost / n)) + one.theta.size * math.log(n)


def _told(few: Problem, one: Candidate, wrong: tuple[str, ...], scale: float) -> Order:
    chi_square = one.cost / max(few.size - one.theta.size, 1)
    return Order(one.triples, wrong, chi_square, _criterion(few, one, scale))


def _without_faults(problem: Problem, one: Candidate, found: tuple[str, ...] | None = None) -> Candidate:
    """The candidate without what is not a mode, the one that is seen least first, fitted again after each. found: its
    faults, if they are known."""
    while True:
        found = faults(problem, one) if found is None else found
        wrong = [i for i, fault in enumerate(found) if fault]
        if not wrong:
            return one
        first = one.structure.before
        least = min(wrong, key=lambda i: abs(one.triples[i, 0]) / max(one.deviation(first + 3 * i), 1e-300))
        one, found = _without(problem, one, f"mode {least}"), None


def _without(problem: Problem, one: Candidate, part: str) -> Candidate:
    """The candidate without one part, fitted again: one of its structure's, or "mode 0", ..."""
    structure, theta, first = one.structure, one.theta.copy(), one.structure.before
    if part in structure.parts:
        index = structure.index(part)
        if part == "lag":
            theta[1] += theta[index]  # what lagged is late
        return fitted(problem, structure.without(part), np.delete(theta, index))
    begin = first + 3 * int(part.split()[1])
    return fitted(problem, structure, np.delete(theta, slice(begin, begin + 3)))


def _fewest(problem: Problem, one: Candidate, scale: float, *, modes: bool) -> tuple[Candidate, dict[str, float]]:
    """The candidate without the parts whose loss raises the criterion by less than STRONG; what the rest is worth."""
    while True:
        names = list(one.structure.parts)
        names += [f"mode {i}" for i in range(one.modes)] if modes else []
        if not names:
            return one, {}
        less, before = dict[str, Candidate](), _criterion(problem, one, scale)
        worth = {name: _seen(one, name) for name in names}
        for name in names:
            if worth[name] < SURE_PART_SQUARED_STDS:
                less[name] = _without(problem, one, name)
                worth[name] = _criterion(problem, less[name], scale) - before
        for name in one.structure.parts:
            if _at_bound(problem, one, name):
                worth[name] = -math.inf
        least = min(worth, key=lambda name: worth[name])
        if worth[least] >= STRONG:
            return one, worth
        one = less.get(least) or _without(problem, one, least)
        if modes:
            one = _without_faults(problem, one)


def _seen(one: Candidate, name: str) -> float:
    """The square of a part's size over its deviation: about what its loss would add to the weighted squares."""
    parts = one.structure.parts
    index = one.structure.index(name) if name in parts else one.structure.before + 3 * int(name.split()[1])
    return (float(one.theta[index]) / max(one.deviation(index), 1e-300)) ** 2


def _at_bound(problem: Problem, one: Candidate, name: str) -> bool:
    """Whether a part ends at a bound of the search, or is not surely above none; or lag leaves no dead time."""
    index = one.structure.index(name)
    low, high = bounds(one.theta, one.structure, problem)
    value = float(one.theta[index])
    inside = BOUND_FACTOR * low[index] < value < high[index] / BOUND_FACTOR and value > SEEN * one.deviation(index)
    return not inside or (name == "lag" and one.theta[1] < -SEEN * one.deviation(1))
