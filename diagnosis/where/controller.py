"""Whether the stated controller made the record: its law, replayed on the logged error, must reproduce the command.

The states of the integral and of the filters before the first sample are unknown, so that a constant and the first
samples are free: STARTING of them, or as many as the slowest filter takes. What then remains is rounding, or the law is
different: another delay, unit, gain, filter or structure, or swapped columns; or a signal was added behind the
controller (`diagnosis.where.added`), which accuses no controller. A log in which the reading was rounded,
or the command quantised by a converter, leaves noise that no other law explains; the resolution of the reading says
how large that may be. On a coarse scale it may be a fifth of the command, and a difference that another controller
halves, on the samples that it is fitted to, is none of it: far from zero a log of so many digits has coarser steps.
Where the reference was rounded, it has to leave half of what it would leave if that were all. n samples.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.kalman import STARTING
from diagnosis.where.added import AS_GOOD, Added, added
from diagnosis.where.structure import Structure, judged_samples, structure
from models.controller import PID, Feedback
from models.feedback.law import Law
from models.machine import Machine
from models.quantity import listed, show
from models.records.checks import kept_to, noise_gain, quantisation, replay
from models.records.record import Record

Array = NDArray[np.float64]

MAX_SHIFT_SAMPLES: Final = 8  # samples by which the command, or the PID's reference, is shifted at most
SHIFTS: Final = range(-MAX_SHIFT_SAMPLES, MAX_SHIFT_SAMPLES + 1)
LEAST_COMPARED: Final = (
    2 * MAX_SHIFT_SAMPLES + 50
)  # samples that another law has to reproduce: those that no shift meets
EXPLAINS: Final = 0.01  # of the commands' standard deviation: what a structure may leave that is said to fit
FORGOTTEN: Final = 20.0  # time constants of a filter after which nothing is left of what was before the record
TRIED_DELAYS: Final = 3  # delays of the reference [samples], from 0 on, beside which another part of the law is tried
SMOOTHED: Final = 21  # samples over which a cubic gives a rounded reference as it may have been before
SMOOTH: Final = 200  # samples in motion, from which on a reference shows whether it was rounded
OFTEN: Final = 0.1  # of the samples in motion, up to which fourth differences that are not 0 are a path's corners
AGAINST: Final = -0.5  # how two neighbouring fourth differences go together, from which on they are rounding
OFF_STEPS: Final = 0.05  # of a step, from which on differences are no multiples of it
AT_RATING: Final = 0.02  # of the rated thrust, by which a command may be off it that is cut off by it
WHOLE: Final = "the whole command"
POSITION_LOGGED: Final = "the position logged"
KEPT_TO: Final = "the commands kept to"
SLIGHT: Final = 0.05  # of a feedforward: a part that makes less of it is not named
OTHER_UNIT: Final = 1.5  # a factor of all commands beyond which their unit is taken to be another one
SAME_UNIT: Final = 0.02  # relative difference of a factor from that of a unit, up to which it is that unit's
ONE_FACTOR: Final = 1.02  # between factors of the parts of a controller that count as one of the whole command
FILTERS: Final = (0.25, 0.5, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4, 2.0, 4.0)  # factors of the derivative filter's time


@dataclass(frozen=True)
class Replayed:
    """How far the replayed command is from the logged one: largest and rms difference [N], the tolerance [N], the first
    sample beyond it (departs), and the best of the changes that were tried (remedy) with the rms that remains [N].

    checked: False where the law cannot be replayed, which why_not says in a part of a sentence: a record without a
    reference, of only one of `every` samples, or of too few. structure: the PID
    or P/PI cascade that leaves least of the commands, whose standard deviation is spread [N], where no such change
    leaves rounding alone. added: the signal that was added behind the controller, where that leaves least.
    command_late: by how many samples the commands were logged late, where that is the remedy; negative: early.
    mislogged: whether a position logged late or early, or one factor on all commands, leaves no more than the noise of
    the log: then the log is another one than the file says, or all gains of the controller are.
    """

    checked: bool
    largest: float
    rms: float
    tolerance: float
    departs: int | None
    remedy: str | None
    remains: float
    structure: Structure | None = None
    spread: float = 0.0
    added: Added | None = None
    every: int = 1
    command_late: int = 0
    mislogged: bool = False
    why_not: str = ""

    @property
    def is_another_log(self) -> bool:
        """Whether the log is not what the file says, so that another record would show the same, and what is fitted to
        it is no machine's."""
        return self.mislogged or self.command_late != 0

    @property
    def other(self) -> str | None:
        """Part of a sentence: the structure that would fit, or that none does."""
        best = self.structure
        if best is None:
            return None
        if self.remedy is not None and self.remains <= best.leaves:
            return None  # what was said already leaves less
        left = f"{show(best.leaves, 'N', 2)} (rms)"
        if best.leaves < EXPLAINS * self.spread:
            return f"{best.words} leaves {left}"
        return f"no PID and no P/PI cascade fits, the best of which leaves {left}"

    def is_mostly_added(self, criteria: Criteria) -> bool:
        """Whether a signal was added behind the controller that leaves next to nothing of the difference."""
        return self.added is not None and (self.added.is_all or self.added.leaves < criteria.replay_added * self.rms)

    @property
    def replays(self) -> bool:
        """Whether the stated law made the record, signals added behind it apart, or that cannot be checked."""
        return not self.checked or self.departs is None or (self.added is not None and self.added.is_all)


def replayed(machine: Machine, record: Record, criteria: Criteria = Criteria()) -> Replayed:
    """The machine's feedback and reference delay, replayed on a record; forces in [N]."""
    if record.every > 1:
        why = f"its log has only one of {record.every} samples"
        return Replayed(False, 0.0, 0.0, 0.0, None, None, 0.0, every=record.every, why_not=why)
    plain, made, begin = _plainly(machine, record, criteria)
    if plain.replays:
        return plain
    rms = plain.rms
    remedy, remains = _best_remedy(machine, record, begin)
    late = next((shift for shift in SHIFTS if _logged_late(shift) == remedy), 0)
    noise = criteria.replay_log_noise * math.hypot(_rounded(machine, record), _reference_rounded(machine, record))
    most, mended = criteria.replay_log_extreme * noise, criteria.replay_remedy * rms
    signal = added(record, made, begin, max(noise, plain.tolerance))
    smooth = _between_jumps(record.feedforward[begin:], most)
    rating = machine.drive.rated_thrust
    largest = float(np.max(np.abs(_unexplained(record, made, begin, rating)[smooth]), initial=0.0))
    other = None
    if rms < noise and largest < most and (signal is None or signal.leaves >= mended):
        if _is_limited(record, begin, rating):  # any law makes the commands of a part that stands at the limit
            return replace(plain, tolerance=most, departs=None)
        other = structure(record, begin)
        share, half = min(remains / rms, _share_left(record, other, made, begin)), criteria.replay_remedy
        if share >= half or share >= half * _share_of_rounding(machine, record, begin):
            return replace(plain, tolerance=most, departs=None)
    # What is mapped to the feedforward and acts otherwise accuses no controller, though another law may do as well. A
    # feedforward that the log has not is no such law where a column of the log makes the commands.
    in_column = signal is not None and not signal.mapped and signal.is_all
    unlogged = in_column and remedy == _unlogged(record, made, begin)[0]
    by_law = signal is not None and not signal.mapped and remains <= signal.noise and remains < mended and not unlogged
    if signal is not None and not by_law and signal.leaves < (mended if unlogged else min(mended, remains / AS_GOOD)):
        other = None if signal.is_all else other or structure(record, begin)
        return replace(
            plain, remedy=signal.words, remains=signal.leaves, structure=other, spread=plain.spread, added=signal
        )
    best = remedy if remains < mended else None
    limited = remedy.startswith(KEPT_TO) and remains < noise
    if other is None and remains > plain.tolerance and not limited:
        other = structure(record, begin)
    mislogged = best is not None and remains <= max(noise, plain.tolerance) and _is_of_the_log(best)
    late = late if best else 0
    return replace(plain, remedy=best, remains=remains, structure=other, command_late=late, mislogged=mislogged)


def _is_of_the_log(remedy: str) -> bool:
    """Whether a remedy is another reading of the log and not another law: of the position's time, or of the unit."""
    return remedy.startswith((f"{WHOLE} times", POSITION_LOGGED))


def _best_remedy(machine: Machine, record: Record, begin: int) -> tuple[str, float]:
    """The change of the law that leaves least of a record's commands, in words, and the rms difference [N] left."""
    feedback, delay = machine.control.feedback, machine.control.reference_delay
    remedies = itertools.chain(
        _remedies(record, feedback, delay, begin),
        _other_acceleration(record, machine, begin),
        _kept_to(record, machine, begin),
    )
    return min(remedies, key=lambda one: one[1])


def reproduces(machine: Machine, record: Record, criteria: Criteria = Criteria()) -> bool:
    """Whether the replayed law makes a record's commands to within the rounding of the log, without a search for what
    would."""
    return _plainly(machine, record, criteria)[0].replays


def _plainly(machine: Machine, record: Record, criteria: Criteria) -> tuple[Replayed, Array, int]:
    """(what the law as stated leaves, the commands that it makes (n,) [N], the sample from which on they count)."""
    feedback, delay = machine.control.feedback, machine.control.reference_delay
    begin = _beginning(feedback, record)
    made = replay(record, feedback, delay, machine.drive.rated_thrust)
    difference = _unexplained(record, made, begin, machine.drive.rated_thrust)
    spread = float(np.std(record.command[begin:]))
    tolerance = max(criteria.replay_tolerance * spread, quantisation(record.command), _resolution(machine, record))
    beyond = np.flatnonzero(np.abs(difference) > tolerance)
    largest, rms = float(np.max(np.abs(difference), initial=0.0)), float(np.sqrt(np.mean(difference**2)))
    departs = int(beyond[0]) + begin if beyond.size else None
    still = np.ptp(record.reference) == 0 and float(np.std(record.position)) > 10 * machine.scale.resolution
    if departs is not None and still:
        return Replayed(False, largest, rms, tolerance, None, None, rms, why_not="it has no reference"), made, begin
    least = begin + LEAST_COMPARED
    if record.command.size < least:
        why = f"it is too short to replay: {record.command.size} samples, of at least {least}"
        return Replayed(False, largest, rms, tolerance, None, None, rms, why_not=why), made, begin
    return Replayed(True, largest, rms, tolerance, departs, None, rms, spread=spread), made, begin


def added_signals(machine: Machine, record: Record) -> Record:
    """The record with everything as feedforward [N] that its commands hold beyond the machine's law, replayed on the
    logged error: pulses behind the controller, say. Before the replay has settled the feedforward stays as logged.

    What an integral held before the record is a constant of the replay. It is taken from where the replay has settled,
    as a law whose integral drifts away from the logged one differs by far more later on."""
    feedback, delay = machine.control.feedback, machine.control.reference_delay
    alone = replace(record, feedforward=np.zeros(record.command.size))
    beyond = record.command - replay(alone, feedback, delay, machine.drive.rated_thrust)
    begin = _beginning(feedback, record)
    settled = slice(begin, begin + STARTING)
    held = float(np.median((beyond - record.feedforward)[settled])) if _integrates(feedback) else 0.0
    return replace(record, feedforward=np.concatenate([record.feedforward[:begin], beyond[begin:] - held]))


def _integrates(feedback: Feedback) -> bool:
    """Whether a constant in the commands may be what an integral held before the record."""
    return isinstance(feedback, Law) or feedback.ki != 0


def _beginning(feedback: Feedback, record: Record) -> int:
    """The sample from which on a record's replay counts [-]; of a short record none may."""
    shortest = min(max(record.command.size // 4, STARTING), record.command.size - 1)
    return min(starting(feedback, record.sample_time), shortest)


def starting(feedback: Feedback, sample_time: float) -> int:
    """Samples after which a replay no longer depends on what was before the record; sample_time [s]."""
    if isinstance(feedback, Law):
        poles = np.abs(np.linalg.eigvals(feedback.feedback_matrices()[0]))
        slowest = float(np.max(poles[poles < 1 - 1e-12], initial=0.0))
    else:
        slowest = feedback.pole(sample_time)
    return STARTING if slowest <= 0 else max(STARTING, round(FORGOTTEN / -float(np.log(slowest))))


def _resolution(machine: Machine, record: Record) -> float:
    """Effect on the command [N] of losing a thousandth of the scale's resolution where positions are written."""
    feedback, lost = machine.control.feedback, 1e-3 * machine.scale.resolution
    if isinstance(feedback, Law):
        return lost * abs(float(feedback.feedback_matrices()[3][0, 0]))
    return lost * (feedback.kp + feedback.kd / (feedback.derivative_filter + record.sample_time))


def _rounded(machine: Machine, record: Record) -> float:
    """Standard deviation [N] of the replay's error where the readings were rounded after the controller used them."""
    return noise_gain(machine.control.feedback, record.sample_time) * machine.scale.resolution / 12**0.5


def _reference_rounded(machine: Machine, record: Record) -> float:
    """Standard deviation [N] of the replay's error where the reference was: a fine position may be logged in steps that
    an acceleration feedforward makes newtons of."""
    return noise_gain(machine.control.feedback, record.sample_time, of="reference") * rounding(record.reference)


def _share_left(record: Record, other: Structure | None, made: Array, begin: int) -> float:
    """What another structure leaves of the commands, over what the stated law does that made (n,) [N]; rms over the
    samples that it is fitted to [1]; 1 where there is none."""
    there = float(np.std((record.command - made)[judged_samples(record, begin)]))
    return 1.0 if other is None or there == 0 else other.leaves / there


def _share_of_rounding(machine: Machine, record: Record, begin: int) -> float:
    """The least that a remedy or another structure leaves over what the stated law does [1], where that is right and
    the log has lost of its reference what `rounding` says, simulated: where the steps make more of a feedforward than
    the motion does, a law with less of it leaves less."""
    step = math.sqrt(12) * rounding(record.reference)
    if step == 0:
        return 1.0
    feedback, delay, rating = machine.control.feedback, machine.control.reference_delay, machine.drive.rated_thrust
    fine = replace(record, reference=scipy.signal.savgol_filter(record.reference, SMOOTHED, 3))
    moves = np.diff(record.reference, prepend=record.reference[0]) != 0
    lost = np.random.default_rng(0).uniform(-step / 2, step / 2, moves.size)
    logged = replace(fine, reference=fine.reference + np.where(moves, lost, 0.0))
    logged = replace(logged, command=replay(fine, feedback, delay, rating))
    made = replay(logged, feedback, delay, rating)
    remains = _best_remedy(machine, logged, begin)[1] / _rms(logged, made, begin)
    return min(remains, _share_left(logged, structure(logged, begin), made, begin))


def rounding(reference: Array) -> float:
    """Standard deviation [m] of what a smooth reference (n,) [m] lost where it was rounded; 0 for one that was not.

    In steps of q, the fourth differences of a smooth path are multiples of q, up to 8 q, most of them not 0, and
    neighbours go against each other (-0.8 of white noise, where a smooth path's go together). Of a path of straight
    lines or parabolas nearly all are 0.
    """
    moves = np.diff(reference) != 0
    together = np.convolve(moves, np.ones(4), "valid") == 4
    fourth = np.diff(reference, 4)[together]
    other = np.abs(fourth) > 1e-9 * float(np.max(np.abs(reference), initial=0.0))
    if np.count_nonzero(other) < max(SMOOTH, OFTEN * fourth.size):
        return 0.0
    step = float(np.quantile(np.abs(fourth[other]), 0.01))
    counts = fourth[other] / step
    if float(np.median(np.abs(counts - np.round(counts)))) > OFF_STEPS:
        return 0.0
    small = np.clip(fourth, -8 * step, 8 * step)
    energy = float(small @ small)
    if float(small[1:] @ small[:-1]) > AGAINST * energy:
        return 0.0
    return math.sqrt(energy / small.size / 70)  # the sum of the squares of 1, -4, 6, -4, 1


def _difference(record: Record, made: Array, begin: int, rating: float = math.inf) -> Array:
    """Logged less replayed command (n - begin,) [N], its median removed; none where the logged command stands at the
    rating [N], as the largest or the least of the record, and the replayed one is beyond it: a drive keeps to it."""
    difference = (record.command - made)[begin:]
    difference = difference - np.median(difference)
    command = record.command[begin:]
    at_rating = np.abs(np.abs(command) / rating - 1) < AT_RATING
    above, below = (command == np.max(command)) & (difference < 0), (command == np.min(command)) & (difference > 0)
    return np.where(at_rating & (above | below), 0.0, difference)


def _is_limited(record: Record, begin: int, rating: float) -> bool:
    """Whether the commands stand at the rating [N] either way."""
    limit = kept_to(record.command[begin:])
    return limit is not None and abs(limit / rating - 1) < AT_RATING


def _unexplained(record: Record, made: Array, begin: int, rating: float) -> Array:
    """`_difference`, or what is left between stands at the rating where that is less (n - begin,) [N]."""
    whole = _difference(record, made, begin, rating)
    parts = _between_stands(record, made, begin) if _is_limited(record, begin, rating) else None
    return parts if parts is not None and parts @ parts < whole @ whole else whole


def _between_stands(record: Record, made: Array, begin: int) -> Array | None:
    """Logged less replayed command (n - begin,) [N] of a record whose commands stand at a limit either way, without the
    median of each part between, as what an anti-windup keeps out of the integral is another constant after each stand;
    0 where they stand. None without such a limit, and where the parts that are long enough to tell are not most."""
    command = record.command[begin:]
    limit = kept_to(command)
    if limit is None:
        return None
    free = np.abs(command) < limit * (1 - 1e-9)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int))).reshape(-1, 2)
    left, compared = np.zeros(command.size), 0
    for start, stop in ends[np.diff(ends)[:, 0] >= LEAST_COMPARED]:
        part = command[start:stop] - made[begin + start : begin + stop]
        left[start:stop] = part - np.median(part)
        compared += stop - start
    return left if compared > command.size / 2 else None


def _between_jumps(feedforward: Array, size: float) -> NDArray[np.bool_]:
    """Which samples (n,) are farther than MAX_SHIFT_SAMPLES from a jump of the feedforward by more than size [N]: what
    is added behind a controller is logged as it was asked for, which at an edge is not yet as it acts. The record's
    ends, at which a logger may have filtered with less than its window, are left out as in `_rms`."""
    jumps = np.abs(np.diff(feedforward, prepend=feedforward[:1])) > size
    near = np.convolve(jumps, np.ones(2 * MAX_SHIFT_SAMPLES + 1), "same") > 0
    near[:MAX_SHIFT_SAMPLES] = near[-MAX_SHIFT_SAMPLES:] = True
    return np.asarray(~near)


def _rms(record: Record, made: Array, begin: int) -> float:
    return float(np.sqrt(np.mean(_difference(record, made, begin)[MAX_SHIFT_SAMPLES:-MAX_SHIFT_SAMPLES] ** 2)))


def _remedies(record: Record, feedback: Feedback, delay: int, begin: int) -> Iterator[tuple[str, float]]:
    """Changes of the law in words, each with the rms difference [N] that remains."""
    made = replay(record, feedback, delay)
    for shift in SHIFTS:
        if shift:
            yield _logged_late(shift), _rms(record, np.roll(made, shift), begin)
            position = record.position[np.clip(np.arange(record.position.size) + shift, 0, record.position.size - 1)]
            words = f"{POSITION_LOGGED} {_samples(abs(shift))} {'late' if shift > 0 else 'early'}"
            yield words, _rms(record, replay(replace(record, position=position), feedback, delay), begin)
        if delay + shift >= 0 and shift:
            yield (
                f"a reference delay of {_samples(delay + shift)} instead of {delay}",
                _rms(record, replay(record, feedback, delay + shift), begin),
            )
        elif delay + shift < 0:
            late = -(delay + shift)
            sooner = np.concatenate([record.reference[late:], np.full(late, record.reference[-1])])
            words = f"the reference logged {late} sample{'s' * (late > 1)} late"
            yield words, _rms(record, replay(replace(record, reference=sooner), feedback, 0), begin)
    if isinstance(feedback, PID):
        yield from _filters(record, feedback, delay, begin)
    error = made - record.feedforward
    if np.ptp(record.feedforward) == 0:
        yield _unlogged(record, made, begin)
    groups = [(WHOLE, [made]), ("the feedback", [error])]
    if isinstance(feedback, PID):
        groups.append(_parts(record, feedback, delay))
    for words, columns in groups:
        if all(np.ptp(column) > 0 for column in columns):
            yield _scaled(record, made, words, columns, begin)


def _logged_late(shift: int) -> str:
    """That the commands are in the log so many samples after they were made, in words [-]."""
    return f"the command logged {_samples(abs(shift))} {'late' if shift > 0 else 'early'}"


def _samples(count: int) -> str:
    """So many samples, in words [-]."""
    return f"{count} sample{'s' * (count != 1)}"


def _other_acceleration(record: Record, machine: Machine, begin: int) -> Iterator[tuple[str, float]]:
    """A cascade whose acceleration feedforward comes sooner or later than the difference of its last three references:
    a profile generator has the acceleration of the sample itself. In words, each with the rms difference [N] left."""
    control = machine.control
    if control.cascade is None or not control.fed_forward:
        return
    bare = replace(control, cascade=replace(control.cascade, acceleration_feedforward=0.0))
    for delay in dict.fromkeys((control.reference_delay, *range(TRIED_DELAYS))):
        alone = replay(record, bare.feedback, delay)
        part = replay(record, control.feedback, delay) - alone
        other = f"a reference delay of {_samples(delay)} instead of {control.reference_delay} and "
        for shift in SHIFTS:
            if shift:
                late = f"{_samples(abs(shift))} {'later' if shift > 0 else 'sooner'}"
                words = f"{other if delay != control.reference_delay else ''}the acceleration feedforward {late}"
                yield words, _rms(record, alone + np.roll(part, shift), begin)


def _kept_to(record: Record, machine: Machine, begin: int) -> Iterator[tuple[str, float]]:
    """That a limit that is not the rating cuts off the commands, in words, with the rms difference [N] left."""
    control, top = machine.control, float(np.max(np.abs(record.command)))
    if abs(top / machine.drive.rated_thrust - 1) < AT_RATING:
        return
    left = _between_stands(record, replay(record, control.feedback, control.reference_delay, top), begin)
    if left is not None:
        words = f"{KEPT_TO} {show(top, 'N', 4)} (rated_thrust in [drive])"
        yield words, float(np.sqrt(np.mean(left**2)))


def _unlogged(record: Record, made: Array, begin: int) -> tuple[str, float]:
    """The replayed command with a feedforward of the reference's acceleration and speed, where none is in the log;
    in words whichever of the two makes more than SLIGHT of it."""
    speed = np.gradient(record.reference, record.sample_time)
    basis = np.column_stack([np.gradient(speed, record.sample_time), speed, np.ones(made.size)])
    scale = np.maximum(np.max(np.abs(basis), axis=0), 1e-300)
    factors = np.linalg.lstsq((basis / scale)[begin:], (record.command - made)[begin:], rcond=None)[0] / scale
    sizes = np.std(basis[:, :2] * factors[:2], axis=0)
    kinds = ((factors[0], "kg", "acceleration"), (factors[1], "N s/m", "speed"))
    said = [
        f"{show(factor, unit, 3)} times the reference's {of}"
        for (factor, unit, of), size in zip(kinds, sizes, strict=True)
        if size > SLIGHT * float(np.sum(sizes))
    ]
    words = f"a feedforward of {listed(said or ['a constant'])} (the log has none)"
    return words, _rms(record, made + basis @ factors, begin)


def _filters(record: Record, pid: PID, delay: int, begin: int) -> Iterator[tuple[str, float]]:
    """Other filters of the PID's derivative, where it has one."""
    for factor in FILTERS if pid.kd > 0 and pid.derivative_filter > 0 else ():
        other = replace(pid, derivative_filter=factor * pid.derivative_filter)
        words = f"the derivative's filter {factor:g} times as slow"
        yield words, _rms(record, replay(record, other, delay), begin)


def _parts(record: Record, pid: PID, delay: int) -> tuple[str, list[Array]]:
    """The names of the PID's parts that have a gain, and the command (n,) [N] of each."""
    bare = replace(record, feedforward=np.zeros_like(record.feedforward))
    alone = {
        "proportional": replace(pid, ki=0.0, kd=0.0),
        "integral": replace(pid, kp=0.0, kd=0.0),
        "derivative": replace(pid, kp=0.0, ki=0.0),
    }
    there = {name: replay(bare, one, delay) for name, one in alone.items() if one.kp + one.ki + one.kd > 0}
    return f"the {listed(there)} part", list(there.values())


def _scaled(record: Record, made: Array, words: str, columns: list[Array], begin: int) -> tuple[str, float]:
    """The replayed command with each of its parts (n,) [N] times the factor that fits the logged command best."""
    rest = made - sum(columns)
    basis = np.column_stack([*columns, np.ones(made.size)])[begin:]
    factors = np.linalg.lstsq(basis, (record.command - rest)[begin:], rcond=None)[0][:-1]
    again = rest + sum(factor * column for factor, column in zip(factors, columns, strict=True))
    told = f"{words} times {listed(f'{factor:.4g}' for factor in factors)}"
    alike = factors.min() > 0 and factors.max() / factors.min() < ONE_FACTOR  # of all commands, or of all parts
    if (words == WHOLE or (alike and factors.size > 1)) and alike and abs(np.log(factors[0])) > np.log(OTHER_UNIT):
        told += f", as where one of the log's units is {show(1 / factors[0], 'N', 4)}"
        if abs(math.degrees(factors[0]) - 1) < SAME_UNIT:
            told += ", or where angles in degrees were read as radians"
    return told, _rms(record, again, begin)
