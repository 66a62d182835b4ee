"""What can be wrong with a record, each with its sentence: what makes it useless raises, the rest is said.

Symbols: n samples; T_s the sample time [s]; u the command [N], x the position [m], x_T* the reference [m].
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from models.controller import PID, Feedback
from models.feedback.law import Law, follow
from models.friction import Friction, half_way
from models.quantity import keeps_to, show
from models.records.record import Record
from models.records.sampling import ROW
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]

TRUST: Final = "if the record is right as it is, give --trust-records (in Python, trusted=True)"
LONGEST_SHIFT: Final = 8  # samples by which two channels are looked at for a delay
NEAR_TOP: Final = 0.9  # of a command's extreme, from which on a sine in coarse steps is as often below it as at it
MOST_NEAR_TOP: Final = 2 / 3  # of those samples, that a limited command has at its extreme
SATURATED: Final = 3  # samples in a row at the extreme of the command
MIN_DIAGNOSIS_SAMPLES: Final = 1000  # samples that a diagnosis needs, of all records together
AT_LIMIT: Final = 0.99  # of the rated thrust, from which on a command that stands at its extreme is at the limit
SIGNALS: Final = ("target", "reference", "feedforward", "command", "position")  # of a record
SAME_TIME: Final = 1e-3  # relative difference between a record's sample time and the machine's that is tolerated
STILL: Final = 5.0  # steps of the scale: a position that stays within them does not count as moving
STANDS: Final = 256  # samples of a reference that stands still, after which an axis counts as at rest
FEWEST_STRETCHES: Final = 4  # of a quarter of these, that a record has to rest to show its scale's noise
SHAKES: Final = 2.0  # times the variance by fourth differences, above which that by second ones is a motion's
NOISIER: Final = 2.0  # times what a machine file says: a reading that scatters more at rest is told
SAME_MASS: Final = 1.3  # ratio of the masses that two records show, above which they are of two machines
ROLLING: Final = 0.05  # of the highest speed: below, a record hardly shows on which way the axis is
NOISE_LASTS: Final = 60  # samples after which a law has answered to an impulse, but for its integral
FEWEST_ROLLING: Final = 100  # samples of rolling that a fit of the mass needs
LEAVES_LESS: Final = 0.5  # of what two masses leave of two records: one mass on a spring that leaves less is believed
NO_WORSE: Final = 1.1  # of the same, in either record
INERTIA: Final = 0.8  # share of the smoothed command's variance that inertia must explain for a mass to be read off


class DoubtfulError(RecordError):
    """A record that only looks wrong: `doubt` says how, and the message also how to use the record as it is."""

    def __init__(self, doubt: str) -> None:
        super().__init__(f"{doubt}; {TRUST}")
        self.doubt = doubt


@dataclass(frozen=True)
class Facts:
    """What is nominally known of a machine [SI], to see more in its records; None: not known.

    The feedback that ran and its reference's delay [samples], the sample time [s], the mass [kg], the rated thrust [N],
    the resolution of the scale [m], the deviation of a reading [m], the stiffness of what holds the axis at rest, its
    friction and springs to ground [N/m], the friction's force [N], whether the axis turns, the constant force that the
    thrust holds [N], and what holds the axis by where it is: springs to ground [N/m], and other forces at most [N].
    """

    pid: Feedback | None = None
    reference_delay: int = 0
    sample_time: float | None = None
    mass: float | None = None
    limit: float | None = None
    resolution: float | None = None
    scatter: float | None = None
    stiffness: float | None = None
    friction: float | None = None
    rotary: bool | None = None
    offset: float | None = None
    spring: float = 0.0
    by_place: float = 0.0

    def seen_in(self, record: Record) -> Facts:
        """Without the controller for a record that has another rate than it, from which it can't be replayed."""
        other = self.sample_time is not None and not is_at_rate(record, self.sample_time)
        return replace(self, pid=None) if other else self


def findings(record: Record, given: Iterable[str], facts: Facts) -> tuple[str, ...]:
    """Sentences on a record that can be used; raises RecordError for one that can't. given: signals of the file."""
    given = set(given)
    _constant(record)
    sentences = [*_saturation(record, facts.limit), *_step(record)]
    if "reference" in given:  # without one nothing tells when the axis rests
        sentences += _scatter(record, facts.scatter)
    if facts.pid is not None and {"reference", "command"} <= given:
        sentences += _shift(record, facts.pid, facts.reference_delay)
    return tuple(sentences)


def check_signals(record: Record) -> None:
    """Raises RecordError for signals that are no rows of as many finite numbers, or a sample time that is none [s]."""
    if not (math.isfinite(record.sample_time) and record.sample_time > 0):
        raise RecordError(f"its sample time is {record.sample_time:g}; give the seconds from one sample to the next")
    sizes = {}
    for name in SIGNALS:
        signal = getattr(record, name)
        if not isinstance(signal, np.ndarray) or signal.ndim != 1 or signal.dtype.kind != "f":
            raise RecordError(f"its {name} is no row of numbers; give a numpy array of floats of shape (n,)")
        if not np.all(np.isfinite(signal)):
            first = int(np.argmin(np.isfinite(signal)))
            raise RecordError(f"its {name} is no finite number at sample {first}; leave such samples out")
        sizes[name] = signal.size
    if len(set(sizes.values())) > 1 or 0 in sizes.values():
        said = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise RecordError(f"its signals must have equally many samples, at least one ({said})")


def is_at_rate(record: Record, sample_time: float) -> bool:
    """Whether a record was sampled at the rate of a controller that runs every `sample_time` [s]."""
    return abs(record.sample_time / sample_time - 1) <= SAME_TIME


def check_sample_time(record: Record, sample_time: float) -> None:
    """Raises RecordError for a record that was not sampled at the rate [s] of the machine's controller."""
    if not is_at_rate(record, sample_time):
        raise RecordError(
            f"is sampled every {show(record.sample_time, 's')}, and the machine's controller runs every "
            f"{show(sample_time, 's')}; give the machine file of this record, or a record that holds all of that "
            "controller's samples, or every second, third and so on; "
            f'where only the times in the file are off, map time = "{ROW} * {show(sample_time, "s", 6)}"'
        )


def check_length(records: Sequence[Record]) -> None:
    """Raises RecordError for records that are too short together."""
    samples = sum(record.position.size for record in records)
    if samples < MIN_DIAGNOSIS_SAMPLES:
        raise RecordError(
            f"{samples} samples are too short for a diagnosis; give {MIN_DIAGNOSIS_SAMPLES} or more, with "
            "several motions"
        )


def check_movement(records: Sequence[Record], friction: Friction | None = None) -> None:
    """Raises DoubtfulError for records in none of which anything moves; friction: see `moves`."""
    if not any(moves(record, friction) for record in records):
        raise DoubtfulError(
            "nothing moves; a diagnosis needs motions, such as the references in the suite.csv that gap_diagnosis "
            "writes where it is given no record"
        )


def moves(record: Record, friction: Friction | None = None) -> bool:
    """Whether an axis moves: it creeps by some steps of its scale where it rests, and where nothing is asked of it, by
    what contacts of this friction give under forces that differ by no more than it."""
    asked, step = np.ptp(record.reference) > 0 or np.ptp(record.feedforward) > 0, quantisation(record.position)
    held = friction is not None and not asked and np.ptp(record.command) < friction.coulomb_force
    far = max(STILL * step, half_way(friction) if friction is not None and held else 0.0)
    return bool(np.ptp(record.position) > far and (asked or np.ptp(record.command) > 0))


def check_one_machine(records: Sequence[Record], names: Sequence[str], presliding: float) -> None:
    """Raises DoubtfulError where the records' scales have other steps, or their commands move another mass.

    names: what the message calls each record. presliding [m]: the way after a turn on which all friction slips.
    """
    steps = [
        (step, name) for record, name in zip(records, names, strict=True) if (step := quantisation(record.position))
    ]
    for step, name in steps[1:]:
        if not 0.99 < step / steps[0][0] < 1.01:
            raise DoubtfulError(
                f"{steps[0][1]} and {name} are of two machines: their scales have steps of "
                f"{show(steps[0][0], 'm')} and {show(step, 'm')}; diagnose each with its own machine file"
            )
    shown = [
        (found, name) for record, name in zip(records, names, strict=True) if (found := rolling(record, presliding))
    ]
    for other, name in shown[1:]:
        if not 1 / SAME_MASS < other.mass / shown[0][0].mass < SAME_MASS and not _one_mass(shown[0][0], other):
            raise DoubtfulError(
                f"{shown[0][1]} and {name} are of two machines: their commands move {show(shown[0][0].mass, 'kg', 3)} "
                f"and {show(other.mass, 'kg', 3)}; diagnose each with its own machine file"
            )


def quantisation(signal: Array) -> float:
    """The step [as the signal's unit] on whose multiples all differences of a signal (n,) lie; 0 if there is none."""
    levels = np.unique(signal)
    apart = np.diff(levels)
    apart = apart[apart > 1e-9 * np.max(np.abs(levels), initial=0.0)]
    if apart.size == 0 or levels.size > 0.6 * signal.size:
        return 0.0
    step = float(np.min(apart))
    step = float(np.median(apart[apart < 1.5 * step]))
    counts = apart / step
    return step if float(np.max(np.abs(counts - np.round(counts)) / np.maximum(counts, 1))) < 0.02 else 0.0


def replay(record: Record, feedback: Feedback, reference_delay: int, limit: float = math.inf) -> Array:
    """u (n,) [N] that this feedback makes of the record's reference, feedforward and position; a PID from I = 0, d = 0,
    any other law from a rest at the first sample. limit [N]: the rating that an anti-windup keeps to."""
    if isinstance(feedback, Law):
        return _replayed_law(record, feedback, reference_delay, limit)
    pid, error = feedback, _waiting(record, reference_delay) - record.position
    integral = pid.ki * record.sample_time * np.cumsum(error)
    return np.asarray(
        pid.kp * error + integral + pid.kd * _slope(error, pid, record.sample_time) + record.feedforward, float
    )


def noise_gain(feedback: Feedback, sample_time: float, *, of: Literal["reading", "reference"] = "reading") -> float:
    """Standard deviation [N/m] of what a law makes of white noise of 1 m in the reading, or in the reference; what its
    integral keeps of it is left out. sample_time [s]: the controller's."""
    impulse, nothing = np.zeros(NOISE_LASTS), np.zeros(NOISE_LASTS)
    impulse[1] = 1.0
    reference, reading = (nothing, impulse) if of == "reading" else (impulse, nothing)
    if isinstance(feedback, Law):
        answer = follow(feedback, reference, reading, nothing)
        answer = answer - answer[-1]
    else:
        answer = replay(
            Record(sample_time, reference, reference, nothing, nothing, reading), replace(feedback, ki=0.0), 0
        )
    return float(np.linalg.norm(answer))


def _replayed_law(record: Record, law: Law, reference_delay: int, limit: float) -> Array:
    """The commands (n,) [N] of a law. What its integral held at first shows before the rating is reached."""
    signals = _waiting(record, reference_delay), record.position, record.feedforward
    made = follow(law, *signals)
    reached = np.flatnonzero(np.abs(record.command) >= limit * (1 - 1e-9))
    if not law.keeps_to_the_rating or reached.size == 0:
        return made
    before = slice(reached[0] // 2, max(reached[0], 1))
    held = float(np.median((record.command - made)[before]))
    return follow(law, *signals, limit=limit, start=held)


def derivative_of_error(record: Record, pid: PID, reference_delay: int) -> Record:
    """A record whose PID took the derivative of the position, as one whose PID took it of the error: the same
    commands [N], where the reference's derivative is taken off the feedforward."""
    added = pid.kd * _slope(_waiting(record, reference_delay), pid, record.sample_time)
    return replace(record, feedforward=record.feedforward - added)


def _waiting(record: Record, reference_delay: int) -> Array:
    """The reference (n,) [m] as the PID has it."""
    return np.concatenate([np.full(reference_delay, record.reference[0]), record.reference])[: record.reference.size]


def _slope(signal: Array, pid: PID, ts: float) -> Array:
    """d (n,) [m/s] of the PID over a signal (n,) [m]; from d = 0."""
    keep = pid.pole(ts)
    return np.asarray(scipy.signal.lfilter([1.0, -1.0], [ts / (1 - keep), -keep * ts / (1 - keep)], signal), float)


def _constant(record: Record) -> None:
    for name in ("position", "command"):
        signal: Array = getattr(record, name)
        if np.ptp(signal) == 0:
            raise RecordError(f"the {name} is constant at {signal[0]:g}; map the column that holds it, or record it")


@dataclass(frozen=True)
class Rolling:
    """The samples (n,) of a record in which its axis rolls: position [m], speed [m/s], acceleration [m/s2], the command
    [N] that made them, what `mass` [kg], friction and an offset leave of it [N]."""

    position: Array
    speed: Array
    acceleration: Array
    force: Array
    mass: float
    left: Array


def rolling(record: Record, presliding: float) -> Rolling | None:
    """Where the axis has gone beyond `presliding` [m] since it turned, smoothed over 40 samples; None if friction hides
    the mass.

    Dead time and current loop move the force behind its command, which in strokes of a few samples takes off a third
    of the mass. So the command is taken as many samples earlier, up to LONGEST_SHIFT, as leave the least."""
    position, speed, acceleration, force = smoothed(record, 40)
    rolls = np.abs(speed) > ROLLING * float(np.max(np.abs(speed)))
    rolls &= _since_turned(speed) * record.sample_time > presliding
    rolls[:LONGEST_SHIFT] = False
    at = np.flatnonzero(rolls)
    if at.size < FEWEST_ROLLING:
        return None
    fits = {shift: fitted_mass(speed[at], acceleration[at], force[at - shift]) for shift in range(LONGEST_SHIFT + 1)}
    best = min(fits, key=lambda shift: float(np.var(fits[shift][1])))
    mass, left = fits[best]
    inertia, rest = float(np.var(mass * acceleration[at])), float(np.var(left))
    if inertia <= INERTIA * (inertia + rest):
        return None
    return Rolling(position[at], speed[at], acceleration[at], force[at - best], mass, left)


def _one_mass(one: Rolling, other: Rolling) -> bool:
    """Whether one mass explains two records: with a drag alone, or on a spring that leaves less than LEAVES_LESS of
    what a mass each leaves, in variance and in the geometric mean over both, and fits neither worse.

    In slow or short motions the force of a spring is taken for inertia, or takes some off it: beside a cable of 9 N/m
    slow strokes showed 4.3 kg of 7. Where all motion is of one frequency nothing tells the two apart, and the records
    pass for those of two machines."""
    none = np.zeros_like
    masses = (np.append(one.acceleration, none(other.speed)), np.append(none(one.speed), other.acceleration))
    each, left = _together(one, other, masses)
    if 1 / SAME_MASS < each[1] / each[0] < SAME_MASS:
        return True
    position = np.append(one.position, other.position)
    alike, less = _together(one, other, (masses[0] + masses[1], position))
    shares = [after / before for before, after in zip(left, less, strict=True)]
    return min(alike[:2]) > 0 and max(shares) < NO_WORSE and math.sqrt(math.prod(shares)) < LEAVES_LESS


def _together(one: Rolling, other: Rolling, wanted: tuple[Array, Array]) -> tuple[Array, list[float]]:
    """The weights of two columns (n,) in the forces of two records, beside a drag of both and a friction and an offset
    of each, and the variance [N2] that is left of each."""
    own = np.zeros((one.speed.size + other.speed.size, 4))
    for i, (moved, rows) in enumerate(((one, slice(one.speed.size)), (other, slice(one.speed.size, None)))):
        own[rows, 2 * i], own[rows, 2 * i + 1] = np.sign(moved.speed), 1.0
    columns = np.column_stack([*wanted, np.append(one.speed, other.speed), own])
    sizes = [np.full(moved.speed.size, max(float(np.std(moved.left)), 1e-300)) for moved in (one, other)]
    size = np.concatenate(sizes)
    weights, left = _least_squares(columns / size[:, None], np.append(one.force, other.force) / size)
    return weights, [float(np.var(part)) for part in np.split(left * size, [one.speed.size])]


def _since_turned(speed: Array) -> Array:
    """The way (n,) since the last turn, from the speed (n,) [any unit, times samples]."""
    way = np.cumsum(speed)
    turned = np.append(True, np.sign(speed[1:]) != np.sign(speed[:-1]))
    last = np.maximum.accumulate(np.where(turned, np.arange(speed.size), 0))
    return np.asarray(np.abs(way - way[last]))


def smoothed(record: Record, samples: int) -> tuple[Array, Array, Array, Array]:
    """(position [m], speed [m/s], acceleration [m/s2], command [N]) of a record, smoothed by a Hann window of so many
    samples."""
    window = np.hanning(samples + 2)[1:-1]
    x, u = (np.convolve(signal, window / window.sum(), "valid") for signal in (record.position, record.command))
    speed = np.gradient(x, record.sample_time)
    return x, speed, np.gradient(speed, record.sample_time), u


def fitted_mass(speed: Array, acceleration: Array, force: Array) -> tuple[float, Array]:
    """(m [kg], residual (n,) [N]) of u = m a + c sign(v) + b by least squares."""
    weights, left = _least_squares(np.column_stack([acceleration, np.sign(speed), np.ones(force.size)]), force)
    return float(weights[0]), left


def _least_squares(columns: Array, force: Array) -> tuple[Array, Array]:
    """(weights (p,), residual (n,) [N]) of a force over columns (n, p) of any size."""
    scale = np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, force, rcond=None)[0]
    return np.asarray(weights / scale), np.asarray(force - (columns / scale) @ weights)


def _saturation(record: Record, limit: float | None) -> Iterator[str]:
    u = record.command
    top = float(np.max(np.abs(u)))
    at_top = np.abs(np.abs(u) - top) < 1e-9 * top
    rated = limit is not None and top >= AT_LIMIT * limit
    kept = limit is not None and not rated and kept_to(u) is not None
    if _stays(at_top) and np.ptp(np.diff(u)) > 0 and (rated or kept or not _stands_elsewhere(u, at_top)):
        advice = "the drive may not have followed there, so cut those parts out"
        if limit is not None and kept:
            advice = f"a drive that keeps to this has it as rated_thrust, not {show(limit, 'N')}"
        yield (
            f"The command is saturated: {int(np.sum(at_top))} samples stand at its extreme of {show(top, 'N')}; "
            f"{advice}."
        )
    elif limit is not None and not keeps_to(top, limit):
        beyond = int(np.sum(np.abs(u) > limit))
        yield (
            f"The command goes beyond the rated {show(limit, 'N')} in {beyond} samples; the drive may not have "
            "followed there, so cut those parts out if it did not."
        )


def kept_to(command: Array) -> float | None:
    """The force [N] that commands (n,) [N] stand at either way, as a drive's limit keeps them: its extremes, which are
    the same, for SATURATED samples in a row each, and far more often than just below; None where they do not."""
    top = float(np.max(np.abs(command)))
    if top == 0:
        return None
    for sign in (1, -1):
        at_top, near = sign * command > top * (1 - 1e-9), sign * command > NEAR_TOP * top
        if not _stays(at_top) or np.count_nonzero(at_top) < MOST_NEAR_TOP * np.count_nonzero(near):
            return None
    return top


def _stays(there: NDArray[np.bool_]) -> bool:
    """Whether this holds of SATURATED samples (n,) in a row."""
    return bool(np.any(np.convolve(there, np.ones(SATURATED), "valid") >= SATURATED))


def _stands_elsewhere(command: Array, at_top: NDArray[np.bool_]) -> bool:
    """Whether a command (n,) also stands still at other levels than its extreme and one at rest, as a coarse one does;
    at_top (n,): where it is at the extreme."""
    same = np.diff(command) == 0
    stands = np.convolve(same, np.ones(SATURATED - 1), "valid") >= SATURATED - 1
    levels = command[: stands.size][stands & ~at_top[: stands.size]]
    return bool(np.unique(levels).size > 1)


def _step(record: Record) -> Iterator[str]:
    step = quantisation(record.position)
    if step > 0:
        yield f"The position has steps of {show(step, 'm')}: the resolution of its scale."
    force = quantisation(record.command)
    if force > 1e-3 * float(np.std(record.command)):
        yield f"The command has steps of {show(force, 'N')}."


def _scatter(record: Record, stated: float | None) -> Iterator[str]:
    """A reading that scatters more at rest than the machine file says [m]: what the scale adds would pass for force."""
    shown = scatter_at_rest(record)
    if stated is not None and shown is not None and shown > NOISIER * stated:
        yield (
            f"At rest the reading scatters by {show(shown, 'm', 2)} from sample to sample, where the scale of the "
            f"machine file has {show(stated, 'm', 2)}, noise and rounding together; state the noise in [scale], or the "
            "drive is taken for rougher than it is."
        )


def scatter_at_rest(record: Record) -> float | None:
    """The deviation [m] of the reading at rest that no motion makes; None where the record hardly rests, or shakes.

    What moves changes little from sample to sample, and its fourth difference less; that of white noise is 70 times its
    variance. It is taken where reference and feedforward have stood still for STANDS samples, as the median over
    stretches of a quarter of that, of which vibrations and what is left of a motion spoil few. Where an excitation that
    is not in the record moves the axis, second differences, of which noise has 6 times its variance, show more.
    """
    since, length = _stood(record), STANDS // 4
    ends = np.flatnonzero((since >= STANDS) & (since % length == 0)) + 1
    if ends.size < FEWEST_STRETCHES:
        return None
    second, fourth = (np.diff(record.position, order) for order in (2, 4))
    coarse, fine = (
        float(np.median([np.mean(one[end - length : end - 4] ** 2) for end in ends])) / times
        for one, times in ((second, 6), (fourth, 70))
    )
    return math.sqrt(fine) if coarse < SHAKES * fine else None


def at_rest(record: Record) -> NDArray[np.bool_]:
    """Whether reference and feedforward have stood still for STANDS samples, at each sample (n,) [-]."""
    return np.asarray(_stood(record) >= STANDS)


def _stood(record: Record) -> NDArray[np.int_]:
    """For how many samples (n,) reference and feedforward have stood still."""
    still = (np.diff(record.reference, prepend=np.nan) == 0) & (np.diff(record.feedforward, prepend=np.nan) == 0)
    samples = np.arange(still.size)
    return np.asarray(samples - np.maximum.accumulate(np.where(still, -1, samples)))


def _shift(record: Record, feedback: Feedback, reference_delay: int) -> Iterator[str]:
    """A delay between channels: the shift at which the replayed controller agrees best with the logged command."""
    made = np.diff(replay(record, feedback, reference_delay))
    logged = np.diff(record.command)
    n, most = made.size, LONGEST_SHIFT
    middle = slice(60 + most, n - most)
    if n < 200 + 2 * most or np.std(logged[middle]) == 0:
        return
    left = {
        shift: float(np.std(logged[middle] - made[middle.start - shift : middle.stop - shift]))
        for shift in range(-most, most + 1)
    }
    best = min(left, key=lambda shift: left[shift])
    share = left[best] / float(np.std(logged[middle]))
    if best != 0 and share < 0.5 and left[best] < 0.5 * left[0]:
        delays = {
            delay: float(np.std((logged - np.diff(replay(record, feedback, delay)))[middle]))
            for delay in range(max(reference_delay - most, 0), reference_delay + most + 1)
        }
        other = min(delays, key=lambda delay: delays[delay])
        if delays[other] <= left[best]:  # which a shift of the log only resembles
            yield (
                f"The command is that of the stated controller with a reference delay of {other} samples, and not of "
                f"{reference_delay}; correct reference_delay in the machine file."
            )
            return
        late = "late" if best > 0 else "early"
        yield (
            f"A delay between channels: the command is logged {abs(best)} sample{'s' * (abs(best) > 1)} "
            f"({show(abs(best) * record.sample_time, 's')}) {late} against position and reference; shift it back, "
            "or dead times come out wrong by as much."
        )
    elif share > 0.5:
        yield (
            "The stated controller does not reproduce the logged command; its gains, delay or columns differ, or it "
            "has terms that this one has not."
        )
