"""Which machine file is handed over: the richest that does no harm on motions that it was not fitted to.

The candidates are the machine as delivered, with its offset fitted, re-fitted, and with effects; where those do harm
together, with all of them but one. Each is fitted without a part of the motions in turn and judged on that part, in
force, position and settling. One that is worse than the machine as delivered, or than a simpler candidate that passed,
by more than chance in any of the three is not adopted, unless it is no worse than as delivered and surely better than
the simpler one in both force and position (settling is when a few motions cross a threshold, the others are of all
samples), or surely leaves less than half of one of the two and hardly more of the other: a mode that is missing makes
the position, while the force is mostly the scale's noise.
A law that was learned, for which nothing speaks but that it fits, has to be surely better in force or position; its
table is fitted without the same motions as the values are, while its coordinate and its smoothness are those of all.
Chance is told by drawing motions, the same for both (a paired bootstrap: B. Efron, R. Tibshirani, An Introduction to
the Bootstrap, 1993, section 8.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.closure import simulated_records
from diagnosis.handover.files import Content, JudgedFile, judged_file, machine_of, starts_of
from diagnosis.handover.final_fit import Finished
from diagnosis.how_far import Errors, Gap, errors_of
from diagnosis.learned.learn import Learned
from diagnosis.model.fit import Fit, fit, without
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import Candidate, SmoothedPath, smooth
from diagnosis.refit import CALLED, OFFSET
from models.machine import Machine

Array = NDArray[np.float64]

FOLDS: Final = 3  # into which the motions are divided; each is judged by a fit to the others
DRAWS: Final = 1000
OWN_DRAWS: Final = 4  # records that a file makes itself, to see what it leaves of them
CHANCE: Final = 0.05  # one-sided level at which a candidate counts as worse
# A file that surely leaves less than this share of one error
OUTWEIGHING_ERROR_RATIO: Final = 0.5
# may leave more of the other one, by up to this share of it.
MAX_RELATIVE_HARM: Final = 0.1
# Tolerances by which a file may move a value that the re-fit moves where nothing is wrong.
MAX_BIASED_MOVE_STDS: Final = 3.0
ROUNDING: Final = 1e-6  # relative difference of errors that are equal but for their arithmetic
# What a file leaves more of, if only by chance, by more than this part
MIN_CHANCE_HARM: Final = 0.02
# it has to leave less of the other error by so many times as much, on logarithms.
MIN_TRADE_RATIO: Final = 3.0
# Times what the machine as delivered leaves of records held out: a file that leaves more is not handed over.
MAX_HELD_OUT_RATIO: Final = 1.02
MEASURES: Final = ("force", "position", "settling")


@dataclass(frozen=True)
class Sums:
    """Errors by motion: sums of squares (m,) [N^2] and [m^2] over `count` (m,) samples, and settling differences (m,)
    [s], the sum over `settled` (m,) of them. Motions at which the floor is not known have a count of 0."""

    force: Array
    position: Array
    count: Array
    settling: Array
    settled: Array

    def mean(self, measure: str, motions: NDArray[np.int64] | None = None) -> Array:
        """Mean square [N^2], [m^2] or mean difference [s] of a measure, over all motions or rows of them (k, m)."""
        above, below = (self.settling, self.settled) if measure == "settling" else (getattr(self, measure), self.count)
        if motions is None:
            motions = np.arange(above.size)
        return np.asarray(above[motions].sum(axis=-1) / np.maximum(below[motions].sum(axis=-1), 1e-300))

    def gap(self) -> Gap:
        """As a gap: root mean squares, and the mean settling difference."""
        settling = float(self.mean("settling")) if self.settled.sum() else None
        return Gap(float(np.sqrt(self.mean("force"))), float(np.sqrt(self.mean("position"))), settling)


@dataclass(frozen=True)
class File:
    """A machine file: its name among the candidates, what it leaves of the records, and of motions left out of its fit;
    the fit behind it (None as delivered)."""

    name: str
    judged: JudgedFile
    gap: Gap
    held_out: Sums
    finished: Finished | None = None

    @property
    def machine(self) -> Machine:
        """The machine as loaded from the file."""
        return self.judged.machine

    @property
    def fitted(self) -> Fit:
        """The fit behind the file. Raises ValueError where there is none."""
        if self.finished is None:
            raise ValueError(f"the file {self.name} has no fit")
        return self.finished.fitted


@dataclass(frozen=True)
class Harm:
    """A candidate that is worse than another file in one measure ("force", "position" or "settling") on motions held
    out: by how much, in that measure's unit."""

    file: str
    measure: str
    than: str
    before: float
    after: float


@dataclass(frozen=True)
class Handover:
    """The file that is handed over, all that were judged, the simplest first, and why the others were not adopted.
    without: the effects that it lacks where it has some of them."""

    adopted: File
    files: tuple[File, ...]
    harms: tuple[Harm, ...] = ()
    without: tuple[str, ...] = ()

    def named(self, name: str) -> File | None:
        """The candidate of this name."""
        return next((file for file in self.files if file.name == name), None)


def chosen(files: Sequence[File], fallback: Callable[[], File] | None = None, *, incomplete: bool = False) -> Handover:
    """The handover among files, the first of them as delivered and then the richer the later; fallback: a simpler one
    than the second, which is judged only where that does harm. incomplete: whether the model lacks something that has
    no name, for which values may make up, so that a file has to leave less in the mean of both measures."""
    first, *rest = files
    best, judged_, harms = first, [first], list[Harm]()
    for number, file in enumerate(rest):
        found = _harms(file, first) or (_poor_trade(file, first) if incomplete else [])
        if not found and not _closer(file, best):
            worse = _harms(file, best)
            found = [] if _outweighed(worse, file, best) else worse
        judged_.append(file)
        harms += found
        idle = incomplete and not _leaves_less(file, best)
        sure = file.name != Content.MEASURED or any(_better(file, best, one) for one in MEASURES[:2])
        if not found and sure and not idle:
            best = file
        elif found and number == 0 and fallback is not None:
            simpler = fallback()
            judged_.insert(1, simpler)
            worse = _harms(simpler, first)
            harms += worse
            best = simpler if not worse and _better(simpler, first) else best
    return Handover(best, tuple(judged_), tuple(harms))


def is_believed(file: File, baseline: Baseline) -> bool:
    """Whether a file has no value far from where it was that the re-fit would move where nothing is wrong, too, and is
    of a log that is what the file says: from commands that acted at another time the dead time and all that delays are
    no machine's, and from those in another unit neither is the mass."""
    if file.finished is None:
        return True
    if any(one.is_another_log for one in baseline.replays):
        return False
    layout, theta = file.fitted.candidate.layout, file.fitted.candidate.theta
    own = np.array([CALLED.get(name, name) in baseline.biased for name in layout.names])
    return bool(np.all(np.abs(theta[own]) <= MAX_BIASED_MOVE_STDS * layout.deviation[own]))


def _better(file: File, other: File, measure: str = "force", part: float = 1.0) -> bool:
    """Whether a file leaves less of a measure than another, or than this part of it, beyond chance."""
    return bool(np.quantile(_apart(file, other, measure, part), 1 - CHANCE) < 0)


def _leaves_less(file: File, other: File) -> bool:
    """Whether a file leaves less than another, in the geometric mean of force and position."""
    then, first = (np.prod([float(one.held_out.mean(measure)) for measure in MEASURES[:2]]) for one in (file, other))
    return bool(then < first)


def _closer(file: File, other: File) -> bool:
    """Whether a file is surely better than another all along the motions."""
    return _better(file, other, "force") and _better(file, other, "position")


def outweighs(file: File, other: File) -> bool:
    """Whether a file surely leaves less than half of what another does, in force or in position."""
    return any(_better(file, other, one, OUTWEIGHING_ERROR_RATIO) for one in MEASURES[:2])


def _outweighed(harms: Sequence[Harm], file: File, other: File) -> bool:
    """Whether a file that is a little worse in force or position surely leaves less than half of the other one."""
    (worse,) = harms if len(harms) == 1 else (None,)
    if worse is None or worse.measure == "settling" or worse.after > (1 + MAX_RELATIVE_HARM) * worse.before:
        return False
    return _better(file, other, "position" if worse.measure == "force" else "force", OUTWEIGHING_ERROR_RATIO)


def leaves_more(left: Sequence[Gap], other: Sequence[Gap]) -> bool:
    """Whether of records that nothing was fitted to one file leaves more than another: by MAX_HELD_OUT_RATIO in the
    geometric mean of their forces and positions. What a simulation runs away with is no number, and more."""
    then, first = (np.array([(one.force, one.position) for one in gaps]) for gaps in (left, other))
    with np.errstate(divide="ignore", invalid="ignore"):
        return not float(np.exp(np.mean(np.log(then / first)))) <= MAX_HELD_OUT_RATIO


def _apart(file: File, other: File, measure: str, part: float = 1.0) -> Array:
    """By how much a file leaves more than another, or than a part of what that leaves, in draws of motions (DRAWS,)
    [the measure's unit, or its square]."""
    before, after = other.held_out, file.held_out
    draws = np.random.default_rng(0).integers(0, before.count.size, (DRAWS, before.count.size))
    least = part if measure == "settling" else part**2
    return np.asarray(after.mean(measure, draws) - least * before.mean(measure, draws))


def _harms(file: File, other: File) -> list[Harm]:
    """The measures in which a file is worse than another beyond chance."""
    before, after = other.held_out, file.held_out
    found = []
    for measure in MEASURES:
        if np.quantile(_apart(file, other, measure), CHANCE) > ROUNDING * before.mean(measure):
            sizes = (float(one.mean(measure)) for one in (before, after))
            first, then = (size if measure == "settling" else size**0.5 for size in sizes)
            found.append(Harm(file.name, measure, other.name, first, then))
    return found


def _poor_trade(file: File, other: File) -> list[Harm]:
    """That error of force and position of which a file leaves more, within chance, where it leaves hardly less of the
    other: values that make up for what a model lacks take off some of one and add to the other."""
    first, then = (
        [float(one.mean(measure)) ** 0.5 for measure in MEASURES[:2]] for one in (other.held_out, file.held_out)
    )
    if min(*first, *then) <= 0:
        return []
    moved = np.log(np.divide(then, first))
    worse = int(np.argmax(moved))
    if moved[worse] <= MIN_CHANCE_HARM or -moved[1 - worse] >= MIN_TRADE_RATIO * moved[worse]:
        return []
    return [Harm(file.name, MEASURES[worse], other.name, first[worse], then[worse])]


def as_delivered(baseline: Baseline, starts: Sequence[Array]) -> File:
    """The machine as its file states it; only the starts of the records, which no file can know, are those of the
    re-fitted file, so that neither is the better by them: displacements (N,) [m] of the friction elements by record."""
    file = judged_file(baseline.nominal.candidate.nominal, starts)
    left = _errors(file.candidate, baseline, smooth(file.candidate, baseline.records))
    return File(Content.DELIVERED, file, left.gap(), sums(left, baseline))


def is_right(file: File, baseline: Baseline, seed: int) -> bool:
    """Whether a file leaves no more of the records than of those that it makes of the same references, but for
    chance, in force and in position."""
    made = (simulated_records(file.judged.candidate, baseline.records, seed + i) for i in range(OWN_DRAWS))
    own = [errors_of(*one, smooth(*one)).gap() for one in made]
    return all(
        getattr(file.gap, of) <= np.mean(values) + baseline.criteria.own_floor_stds * np.std(values, ddof=1)
        for of, values in (("force", [one.force for one in own]), ("position", [one.position for one in own]))
    )


def with_fit(name: str, finished: Finished, baseline: Baseline, law: Learned | None = None) -> File:
    """The file of a finished fit, judged on its records and on motions that were left out of it, and of the learned law
    that it may have."""
    file = file_of(finished.candidate, baseline.machine)
    left = _errors(file.candidate, baseline, smooth(file.candidate, baseline.records))
    return File(name, file, left.gap(), held_out(finished, baseline, law), finished)


def file_of(candidate: Candidate, nominal: Machine, starts: Sequence[Array] | None = None) -> JudgedFile:
    """The file that is written of a fitted candidate; starts: displacements (N,) [m] of the friction by record, which
    no file holds, in place of the candidate's."""
    return judged_file(machine_of(nominal, candidate), starts or starts_of(candidate), candidate.random_forces)


def held_out(finished: Finished, baseline: Baseline, law: Learned | None = None) -> Sums:
    """The errors by motion of files that were fitted without these motions, a learned law in them included."""
    segment = baseline.segment
    part, starts = parts(int(segment.max()) + 1), starts_of(finished.candidate)

    def of_part(number: int) -> Sums:
        out = part == number
        fitted = _with_law_of(~out, law, finished.fitted, baseline)
        file = file_of(without(fitted, baseline.records, out[segment]), baseline.machine, starts)
        return sums(_errors(file.candidate, baseline, finished.fitted.paths), baseline)

    return _by_part(of_part, part)


def _with_law_of(motions: NDArray[np.bool_], law: Learned | None, fitted: Fit, baseline: Baseline) -> Fit:
    """The fit with the table of the learned law that these motions (m,) alone give, if it has the law."""
    effects = fitted.candidate.effects
    if law is None or law.law not in effects:
        return fitted
    other = law.fitted_to(motions, baseline)
    candidate = replace(fitted.candidate, effects=tuple(other if one == law.law else one for one in effects))
    return fit(candidate, baseline.records, paths=fitted.paths, iterations=0, walk=fitted.walk)


def _by_part(of_part: Callable[[int], Sums], part: NDArray[np.int64]) -> Sums:
    """The errors of each motion by the file that was made without its part; part: of each motion (m,)."""
    found = list(parallel_map(of_part, range(FOLDS)))
    return Sums(*(np.choose(part, [getattr(one, field.name) for one in found]) for field in fields(Sums)))


def parts(count: int) -> NDArray[np.int64]:
    """The number of the part [1] that each motion belongs to (count,), at random."""
    return np.asarray(np.random.default_rng(0).permutation(count) % FOLDS)


def sums(left: Errors, baseline: Baseline) -> Sums:
    """Errors summed by motion."""
    segment, size = baseline.segment, len(baseline.pieces)
    force, position = np.concatenate(left.force), np.concatenate(left.position)
    known = ~np.isnan(force)
    begins = np.cumsum([0, *(record.position.size for record in baseline.records)])
    rows = [np.column_stack([one[:, 0] + begin, one[:, 1]]) for one, begin in zip(left.settling, begins, strict=False)]
    settling = np.concatenate(rows)
    at = segment[settling[:, 0].astype(np.int64)]

    def by_motion(weights: Array) -> Array:
        return np.asarray(np.bincount(segment[known], weights[known], size), float)

    return Sums(
        by_motion(force**2),
        by_motion(position**2),
        by_motion(np.ones(force.size)),
        np.asarray(np.bincount(at, settling[:, 1], size), float),
        np.bincount(at, minlength=size).astype(float),
    )


def _errors(candidate: Candidate, baseline: Baseline, paths: Sequence[SmoothedPath]) -> Errors:
    return errors_of(candidate, baseline.records, paths, baseline.driving)


def beside_doubted(baseline: Baseline, delivered: File) -> list[File]:
    """What may be handed over in place of a re-fit that is not believed: the machine as delivered with its offset
    fitted, where the log is what the file says and this surely leaves less force and does no harm."""
    if any(one.is_another_log for one in baseline.replays) or OFFSET in baseline.biased:
        return []
    simpler = offset_alone(baseline, delivered)
    return [simpler] if _better(simpler, delivered) and not _harms(simpler, delivered) else []


def offset_alone(baseline: Baseline, delivered: File) -> File:
    """The machine as delivered but for its offset, less the mean of the force that it leaves: the offset is taken off
    the thrust, where the unknown force is added to it."""
    candidate = delivered.judged.candidate
    paths = smooth(candidate, baseline.records)
    left = _errors(candidate, baseline, paths)
    segment, force = baseline.segment, np.concatenate(left.force)
    part = parts(int(segment.max()) + 1)

    def with_mean(used: NDArray[np.bool_]) -> JudgedFile:
        machine = delivered.machine
        offset = machine.drive.offset - float(np.nanmean(force[used]))
        moved = replace(machine, drive=replace(machine.drive, offset=offset))
        return judged_file(moved, starts_of(candidate))

    def of_part(number: int) -> Sums:
        return sums(_errors(with_mean(part[segment] != number).candidate, baseline, paths), baseline)

    file = with_mean(np.ones(force.size, bool))
    return File(Content.OFFSET, file, _errors(file.candidate, baseline, paths).gap(), _by_part(of_part, part))
