"""Prediction-error fit of a motion record: the closed loop is simulated with the controller replayed.

The model of the command is the simulated loop, over the record's reference and feedforward, and an autoregressive
disturbance (Box-Jenkins with C = 1; Ljung, System Identification, 4.2):

    u[k] = u_sim[k; theta] + offset + v[k],    A(q) v[k] = e[k]

What is minimised are the one-step prediction errors e = A(q) (u - u_sim - offset); A is fitted to what is left, twice.
In closed loop the position hides what the model leaves out and the command carries it, so the command is predicted.
theta scales the mass, the friction and its presliding lengths, and shifts the dead time; damping of the elements comes
in where it shows. What the friction remembers at the record's start is not known: the fit begins where the axis first
is as far away as it gets, and what an element that did not slip until then still carries acts as a constant force,
part of the offset. So the offset's deviation covers all that it may carry. n samples.

What the fit holds as known (the modes, the shape of the friction) is off as well, by as much as the machine file says
or tolerates. A fit takes such an error up into the mass and the friction, and its errors hardly show it; so one
deviation in each of these values is carried through the fit and makes what it finds unsure. What the model lacks
altogether is no noise either: every equal motion makes the same error again, so that more of them tell no more. The
deviations are therefore at least those by which the fit moves when the same part of all equal motions is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.controller import References
from models.friction import elements
from models.identification.estimate import LOOSE, STRONG, Estimate, left_out, wider
from models.identification.force.fit import DAMPING, SIGNIFICANT_STDS
from models.identification.unusable import UnusableError
from models.machine import Machine
from models.quantity import show
from models.records.record import Record, cut
from models.simulation.simulator import simulate, substeps_needed
from models.variation import Variation, known_apart, varied

Array = NDArray[np.float64]

LEAST_SUBSTEPS: Final = 6  # in a sample of the simulations of a fit
FARTHEST: Final = 20.0  # times what is known, of mass, friction and length: beyond, a fit has run away
MOST_STEPS: Final = 40  # of a fit; usual ones take four to six
USUAL_STEPS: Final = 6  # after which a step that is small beside the deviations is the last one
SMALL: Final = 0.05  # of a deviation
HALVINGS: Final = 6  # of a step that makes the errors larger
MOST_SAMPLES: Final = 700_000  # that 2 GB hold: slopes, draws of noise and held values take 2 to 2.5 kB for each
ORDER: Final = 30  # of A(q)
START: Final = 60  # samples left out at the start at least, in which the controller's state is unknown
# Of the longest way from the start: from there on friction has forgotten what it can forget.
FORGOTTEN_WAY_SHARE: Final = 0.98
NOISE_DRAWS: Final = 60  # of the noise, for the covariance
PARAMETER_UNITS: Final = (
    ("mass", "1"),
    ("friction level", "1"),
    ("presliding length", "1"),
    ("dead time", "s"),
    (DAMPING, "s"),
)
LARGEST_STEPS: Final = np.array([0.2, 0.3, 0.3])  # of mass, friction and length, times what they have come to
LARGEST_DELAY_STEP: Final = 0.3  # of the dead time, times itself or, where that is longer, the sample time
LARGEST_LAG_STEP: Final = 1e-3  # s, of the damping over stiffness
# Of the numerical derivatives, in the order of PARAMETER_UNITS.
DERIVATIVE_STEPS: Final = np.array([2e-3, 5e-3, 1e-2, 1e-5, 1e-5])
# Relative change of stiffnesses and limits up to which the command changes in proportion.
MAX_PROPORTIONAL_CHANGE: Final = 0.05
PARTS_LEFT_OUT: Final = 20  # of the information on all parameters, one after another
LENGTH_STEPS: Final = 100  # times that motions' lengths are told apart, over the longest one
PLAIN: Final = 4  # parts that are always identified; the damping only where it shows


@dataclass(frozen=True)
class MotionFit:
    """The estimate (mass, friction level and presliding length relative to the machine given [1], dead time [s], the
    elements' damping over stiffness [s] if it shows, offset [N]), the machine with it, and the command [N] as logged
    and as modelled (n,), its residual and the white e. lag: tau = D_i / K_i and its standard deviation [s], taken or
    not; carried: elements that may carry a constant force from before, as in the module's head, and that force [N]."""

    estimate: Estimate
    machine: Machine
    command: Array
    modelled: Array
    prediction_error: Array
    lag: tuple[float, float]
    carried: tuple[int, float]

    @property
    def damped(self) -> bool:
        """Whether the record shows damping of the elements."""
        return DAMPING in self.estimate.names


@dataclass(frozen=True)
class _Job:
    """The record, the machine with its noise and without, the sample at which the fit begins, and how sure the shape of
    the friction is (None: as the machine's file has it)."""

    record: Record
    machine: Machine
    still: Machine
    first: int
    friction_covariance: Array | None

    def whitened(self, filter_: Array, signals: Array) -> Array:
        """Signals (samples, ...) [N] through A(q), from where the fit begins."""
        filtered = scipy.signal.lfilter(filter_, 1.0, signals, axis=0) if signals.size else signals
        return np.asarray(filtered[self.first + ORDER :])


def identify(
    record: Record, machine: Machine, *, friction_covariance: Array | None = None, iterations: int = MOST_STEPS
) -> MotionFit:
    """Fits a motion record to the machine that is nominally known, its PID among it; see the module's head.

    friction_covariance (2 N, 2 N): of the stiffnesses [N/m] and limits [m] that the machine's friction has from another
    record. The fit can only scale them, so that what is unsure of their shape makes all that it finds unsure; so do the
    deviations of the modes and, without that covariance, of the elements, as the machine's file has or tolerates them.
    Damping of the elements is one time tau = D_i / K_i; it is taken only if BIC falls by ten and tau is surely above
    none. What the machine has of it is not used, nor is its offset: motions show both better.
    Raises ValueError if the record's sample time is another than the machine's, nothing moves, it is too long [s], or
    the fit runs away, does not settle in so many iterations or makes nothing of the command (an UnusableError).
    """
    if record.position.size > MOST_SAMPLES:
        raise ValueError(
            f"{record.position.size:,} samples are more than the {MOST_SAMPLES:,} from which motions are identified in "
            "2 GB of memory; cut the record"
        )
    if abs(record.sample_time / machine.sample_time - 1) > 1e-3:
        raise ValueError(
            f"the record is sampled at {record.sample_time:g} s and the machine's controller at "
            f"{machine.sample_time:g} s; give records of the controller's own samples"
        )
    if np.ptp(record.reference) == 0:
        raise ValueError("the record's reference does not move, so that it shows no motion; map the reference's column")
    friction = elements(machine.friction.stiffness, machine.friction.limit)
    machine = replace(machine, drive=replace(machine.drive, offset=0.0), friction=friction)
    still = replace(machine, scale=replace(machine.scale, noise=0.0, resolution=0.0))
    job = _Job(record, machine, still, begin(record), friction_covariance)
    theta, filter_ = _converged(job, np.array([1.0, 1.0, 1.0, machine.plant.dead_time]), iterations)
    near = _near(job, np.append(theta, 0.0), filter_)
    plain, whole = _solved(job, near, PLAIN), _solved(job, near, DERIVATIVE_STEPS.size)
    del near  # the next one is as large
    if _shows(plain, whole):
        theta, filter_ = _converged(job, whole.values[:-1], iterations)
        plain = whole = _solved(job, _near(job, theta, filter_), DERIVATIVE_STEPS.size)
    return _made(_told(job, plain, whole))


def _made(fit: MotionFit) -> MotionFit:
    """The fit, of which the simulated loop makes at least a part of the command. Raises UnusableError."""
    _check_follows(fit.command, fit.modelled)
    return fit


def _check_follows(command: Array, modelled: Array) -> None:
    """That a simulated loop makes at least a part of a command (n,), both [N]. Raises UnusableError."""
    left, whole = float(np.std(command - modelled)), float(np.std(command))
    if not left < whole:  # nor is it so of nan
        raise UnusableError(
            f"the simulated loop leaves {show(left, 'N', 2)} of a command of {show(whole, 'N', 2)} (root mean square)"
        )


def begin(record: Record) -> int:
    """The sample at which the fit begins; see the module's head. A record that never comes back begins at START."""
    away = np.abs(record.position - record.position[0])
    far = int(np.argmax(away >= FORGOTTEN_WAY_SHARE * np.max(away)))
    return max(far, START) if far < 0.6 * away.size else START


def _converged(job: _Job, theta: Array, iterations: int) -> tuple[Array, Array]:
    """theta (4,) or, with the damping, (5,) and A(q) by Gauss-Newton steps until these are small beside the deviations.
    Raises UnusableError if a value that the record shows runs away, or the last step is not small."""
    filter_, command = np.array([1.0, -1.0]), _simulated(job.record, job.still, theta)
    small = False
    for iteration in range(iterations):
        left, slopes = _linearised(job, theta, command)
        for _ in range(2):  # A(q) and the step depend on each other
            white = job.whitened(filter_, np.column_stack([left, slopes]))
            estimator = _estimator(white[:, 1:])
            step = estimator @ white[:, 0]
            filter_ = _autoregression((left + slopes @ step)[job.first :])
        size = float(np.std(white[:, 0] + white[:, 1:] @ step))
        deviations = size * np.linalg.norm(estimator[: theta.size], axis=1)
        moved = _bounded(job, theta, step[:-1])
        moved[PLAIN:] = np.maximum(moved[PLAIN:], -theta[PLAIN:])  # there is no damping below none
        ran = np.flatnonzero((deviations < LOOSE * theta)[:3] & _at_end(theta + moved))
        if ran.size:
            raise UnusableError(_diverged(theta + moved, int(ran[0])))
        before = theta
        theta, command = _stepped(job, theta, moved, filter_, command)
        moved = theta - before
        small = bool(np.all(np.abs(moved) <= SMALL * deviations))
        settled = np.all(np.abs(moved) < 1e-3 * DERIVATIVE_STEPS[: theta.size])
        if iteration > 1 and (settled or (small and iteration + 1 >= USUAL_STEPS)):
            return theta, filter_
    if not small:
        _check_follows(job.record.command, command)  # else what it leaves tells no value at all
        raise UnusableError(_unsettled(theta, moved / np.maximum(deviations, 1e-300), iterations))
    return theta, filter_


def _bounded(job: _Job, theta: Array, step: Array) -> Array:
    """A step (p,) from theta (p,), cut to what the linearised loop may hold for and to values that a machine has: mass,
    friction and length up to FARTHEST, where one that the record does not show stays."""
    delay = LARGEST_DELAY_STEP * max(job.record.sample_time, float(theta[3]))
    largest = np.concatenate([LARGEST_STEPS * theta[:3], [delay, LARGEST_LAG_STEP]])[: theta.size]
    moved = theta + np.clip(step, -largest, largest)
    moved[:3] = np.clip(moved[:3], 1 / FARTHEST, FARTHEST)
    return np.asarray(moved - theta)


def _at_end(theta: Array) -> NDArray[np.bool_]:
    """Which of mass, friction and length (3,) are as far away as they may get."""
    return np.abs(np.log(theta[:3])) > (1 - 1e-9) * math.log(FARTHEST)


def _stepped(job: _Job, theta: Array, moved: Array, filter_: Array, command: Array) -> tuple[Array, Array]:
    """theta (p,) after a step and the command [N] simulated there, the step halved until the whitened errors do not
    grow, by as much as would speak against a parameter at least, or HALVINGS times, and taken then. Raises
    UnusableError if not even that one can be simulated."""

    def size(made: Array) -> float:
        white = job.whitened(filter_, job.record.command - made)
        return white.size * math.log(max(float(np.var(white)), 1e-300))

    now = size(command)
    for halving in range(HALVINGS):
        there = theta + moved * 0.5**halving
        try:
            made = _simulated(job.record, job.still, there)
        except UnusableError:
            if halving == HALVINGS - 1:
                raise
            continue
        if size(made) <= now + STRONG:
            break
    return there, made


@dataclass(frozen=True)
class _Near:
    """All near theta (5,), whitened: the command that is left (n,), its slopes by theta and by the offset (n, 6), and
    what is made of it by the scale's noise and rounding (n, NOISE_DRAWS), and by one standard deviation of each value
    that is held as known (n, M). phase (n,): the same number for samples at the same place of equal motions, in the
    order of kinds and time."""

    theta: Array
    phase: NDArray[np.int64]
    left: Array
    slopes: Array
    shaken: Array
    unsure: Array


@dataclass(frozen=True)
class _Solution:
    """Values of the first parts and, last, of the offset (p,), their covariance, in all and by noise alone, and the
    errors e left (n,)."""

    values: Array
    covariance: Array
    by_noise: Array
    error: Array


def _near(job: _Job, theta: Array, filter_: Array) -> _Near:
    clean = _simulated(job.record, job.still, theta)
    left, slopes = _linearised(job, theta, clean)
    noisy = replace(job.machine, scale=job.machine.scale.noisy())
    shaken = (_simulated(job.record, noisy, theta, seed) - clean for seed in range(1, NOISE_DRAWS + 1))
    # One by one, as all of them before and behind the filter would take twice the memory.
    many = ([job.whitened(filter_, one) for one in signals] for signals in (shaken, _unsure(job, theta)))
    noise, held = (np.column_stack(signals) for signals in many)
    phase = _phases(job.record)[job.first + ORDER :]
    return _Near(theta, phase, job.whitened(filter_, left), job.whitened(filter_, slopes), noise, held)


def _phases(record: Record) -> NDArray[np.int64]:
    """The place (n,) of each sample in the motions that are not equal to an earlier one, one after another.

    Motions are equal if they go as far in the same direction, behind one in the same direction or the other.
    """
    moves = cut(record)
    longest = max((abs(one.target - one.origin) for one in moves), default=0.0) or 1.0
    kinds = [(round(LENGTH_STEPS * (one.target - one.origin) / longest), one.reversal) for one in moves]
    room: dict[tuple[int, bool], int] = {}  # for the longest of each kind
    for one, kind in zip(moves, kinds, strict=True):
        room[kind] = max(room.get(kind, 0), one.stop - one.start)
    n = record.position.size  # before the first motion, and where none is found, a sample is its own place
    begin = dict(zip(room, np.cumsum([n, *room.values()]), strict=False))
    phase = np.arange(n)
    for one, kind in zip(moves, kinds, strict=True):
        phase[one.start : one.stop] = begin[kind] + np.arange(one.stop - one.start)
    return phase


def _parts(phase: NDArray[np.int64], slopes: Array) -> NDArray[np.int64]:
    """Which part (n,) each sample belongs to: places of the motions that follow each other and tell equally much of
    the parameters, by the leverage of their slopes (n, p)."""
    leverage = np.sum(np.linalg.qr(slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300))[0] ** 2, axis=1)
    told = np.bincount(phase, leverage)
    so_far = np.cumsum(told) / np.sum(told)
    return np.minimum((PARTS_LEFT_OUT * so_far).astype(np.int64), PARTS_LEFT_OUT - 1)[phase]


def _unsure(job: _Job, theta: Array) -> Iterator[Array]:
    """By how much u (samples,) [N] changes with each value that the fit holds as known, by its standard deviation."""
    for moved, size in _held(job):
        # So far that it is seen, so near that it is in proportion.
        step = min(1.0, MAX_PROPORTIONAL_CHANGE / max(size, 1e-300)) * size
        more, less = (_simulated(job.record, moved(sign * step), theta) for sign in (1, -1))
        yield (more - less) * (0.5 * size / max(step, 1e-300))


Moved = Callable[[float], Machine]


def _held(job: _Job) -> Iterator[tuple[Moved, float]]:
    """What is held as known: the machine that is off by so much of a value [1], and the value's deviation [1]."""
    still = job.still
    if job.friction_covariance is not None:
        yield from _shapes(still, job.friction_covariance)
    for one in known_apart(still):
        *path, part = one.name.split(".")
        name = {"gain": "modal_gain"}.get(part, part)
        if path[:2] == ["plant", "modes"]:
            index, count, fitted = int(path[2]) - 1, len(still.plant.modes), int(path[2]) - 1 == still.plant.rigid
        else:
            index, count = 0, len(one.numbers)
            fitted = one.name not in {"friction.stiffness", "friction.limit"} or job.friction_covariance is not None
        for i, size in enumerate(() if fitted else one.relative):
            if math.isfinite(size):
                yield partial(_off, still, name, index + i, count), size


def _off(machine: Machine, name: str, index: int, count: int, error: float) -> Machine:
    """The machine with one mode's or contact's error [1] of the variation's field `name`."""
    each = tuple(error if i == index else 0.0 for i in range(count))
    return varied(machine, Variation(**{name: each}))  # type: ignore[arg-type]


def _shapes(machine: Machine, covariance: Array) -> Iterator[tuple[Moved, float]]:
    """The directions in which stiffnesses [N/m] and limits [m] are unsure together, by their covariance (2 N, 2 N)."""
    friction = machine.friction
    values = np.concatenate([friction.stiffness, friction.limit])

    def moved(direction: Array, step: float) -> Machine:
        stiffness, limit = np.split(values * np.exp(step * direction), 2)
        return replace(machine, friction=elements(stiffness, limit, friction.damping))

    sizes, directions = np.linalg.eigh(covariance / np.outer(values, values))
    for size, direction in zip(np.sqrt(np.maximum(sizes, 0.0)), directions.T, strict=True):
        yield partial(moved, direction), float(size)


def _solved(job: _Job, near: _Near, parts: int) -> _Solution:
    """The first `parts` and the offset identified, less their bias, with their covariance.

    Both by simulating the fitted loop with the scale's noise and rounding, through the estimator (a parametric
    bootstrap; Efron and Tibshirani, 1993): the noise goes through the friction's memory, which no stationary model of a
    disturbance follows, and shakes the elements, so that its mean effect is not zero. What is held as known adds its
    own. If the record's errors are larger than what both make, so is the covariance, by the ratio of their variances;
    and it is no surer than the fit without a part.
    """
    slopes = near.slopes[:, [*range(parts), -1]]
    estimator = _estimator(slopes)
    step, draws, apart = (estimator @ signals for signals in (near.left, near.shaken, near.unsure))
    error = near.left + slopes @ step
    noise = float(np.var(near.shaken))
    expected = noise + float(np.sum(np.var(near.unsure + slopes @ apart, axis=0)))
    size = float(np.var(error)) / max(expected, 1e-300)
    by_noise = np.cov(draws) * (1 + 1 / NOISE_DRAWS) * max(1.0, float(np.var(error)) / max(noise, 1e-300))
    covariance = (np.cov(draws) * (1 + 1 / NOISE_DRAWS) + apart @ apart.T) * max(1.0, size)
    covariance = wider(covariance, left_out(slopes, near.left, _parts(near.phase, slopes)))
    step = step - np.mean(draws, axis=1)
    theta = near.theta[:parts] + _bounded(job, near.theta[:parts], step[:-1])
    return _Solution(np.append(theta, step[-1]), covariance, by_noise, error)


def _shows(plain: _Solution, whole: _Solution) -> bool:
    """Whether BIC falls by ten with the damping, and it is surely above none beside noise: whether this record shows
    it, which is another question than how well it is known beside what the fit holds."""
    n = plain.error.size
    fallen = n * math.log(float(plain.error @ plain.error) / float(whole.error @ whole.error)) - math.log(n)
    return fallen > STRONG and bool(whole.values[-2] > SIGNIFICANT_STDS * math.sqrt(whole.by_noise[-2, -2]))


def _told(job: _Job, found: _Solution, whole: _Solution) -> MotionFit:
    names, units = zip(*PARAMETER_UNITS[: found.values.size - 1], ("offset", "N"), strict=True)
    theta, command = found.values[:-1], job.record.command
    offset = float(found.values[-1])
    machine = _changed(job.machine, theta)
    friction = machine.friction
    covariance = found.covariance.copy()
    way = float(np.max(np.abs(job.record.position[: job.first + 1] - job.record.position[0])))
    carried = [k * (2 * x - way) for k, x in zip(friction.stiffness, friction.limit, strict=True) if 2 * x > way]
    covariance[-1, -1] += sum(carried) ** 2 / 3  # what they carry is equally likely anywhere within
    return MotionFit(
        Estimate(names, units, found.values, covariance),
        replace(machine, drive=replace(machine.drive, offset=offset)),
        command,
        _simulated(job.record, job.still, theta) + offset,
        found.error,
        (float(whole.values[-2]), math.sqrt(whole.covariance[-2, -2])),
        (len(carried), sum(carried)),
    )


def _estimator(slopes: Array) -> Array:
    """What makes of whitened errors (n,) the step (p,) that takes most of them away."""
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    return np.asarray(-np.linalg.pinv(slopes / scale) / scale[:, None])


def _changed(machine: Machine, theta: Array) -> Machine:
    """The machine with theta (4,) put in, or (5,) with damping."""
    mass, level, length, dead_time = theta[:PLAIN].tolist()
    off = Variation(friction_force=level - 1, friction_length=length - 1, mass=mass - 1)
    changed = varied(machine, off)
    friction = changed.friction
    lag = max(float(theta[PLAIN]), 0.0) if theta.size > PLAIN else 0.0
    damped = elements(friction.stiffness, friction.limit, lag * np.array(friction.stiffness))
    return replace(changed, plant=replace(changed.plant, dead_time=max(dead_time, 0.0)), friction=damped)


def _linearised(job: _Job, theta: Array, command: Array) -> tuple[Array, Array]:
    """u - u_sim (n,) [N] and its slopes (n, p + 1) by theta (p,) and by the offset; command: u_sim at theta [N]."""
    slopes = []
    for i, step in enumerate(DERIVATIVE_STEPS[: theta.size]):
        ends = [theta + sign * step * (np.arange(theta.size) == i) for sign in (1, -1)]
        if i >= PLAIN:
            ends[1] = np.maximum(ends[1], 0.0)  # there is no damping below none
        more, less = (_simulated(job.record, job.still, end) for end in ends)
        slopes.append((less - more) / (ends[0][i] - ends[1][i]))
    left = job.record.command - command
    return left, np.column_stack([*slopes, -np.ones(left.size)])


def _simulated(record: Record, machine: Machine, theta: Array, seed: int = 0) -> Array:
    """u (n,) [N] of the loop over the record's reference and feedforward, from rest with friction unstrained."""
    changed = _changed(machine, theta)
    given = References(record.reference, record.feedforward, np.zeros(record.feedforward.size))
    origin = float(record.reference[0])
    feedback, substeps = machine.feedback_only(), substeps_needed(changed, LEAST_SUBSTEPS)
    command = simulate(
        changed, feedback, record.target, given=given, substeps=substeps, seed=seed, origin=origin
    ).record.command
    if not np.all(np.isfinite(command)):
        raise UnusableError(_diverged(theta))
    return command


def _diverged(theta: Array, which: int | None = None) -> str:
    """What to say where no machine close to the known one reproduces the motions: which of mass, friction and length
    ran away, by default the one that is farthest from what is known."""
    which = int(np.argmax(np.abs(np.log(np.maximum(theta[:3], 1e-300))))) if which is None else which
    return (
        f"the fit of its motions does not converge: the {PARAMETER_UNITS[which][0]} runs away, to {theta[which]:.3g} "
        "times that of the machine file"
    )


def _unsettled(theta: Array, moved: Array, iterations: int) -> str:
    """What to say where the last step still moved values by so many deviations (p,)."""
    which = int(np.argmax(np.abs(moved)))
    name, unit = PARAMETER_UNITS[which]
    come = f"{theta[which]:.3g} times that of the machine file" if unit == "1" else show(float(theta[which]), unit, 3)
    return (
        f"the fit of its motions has not settled after {iterations} steps: the {name} has come to {come}, and the last "
        f"step still moved it by {abs(moved[which]):.2g} standard deviations"
    )


def _autoregression(signal: Array) -> Array:
    """A(q) (ORDER + 1,) by Yule and Walker's equations."""
    from scipy.linalg import solve_toeplitz  # noqa: PLC0415

    centred = signal - np.mean(signal)
    n = centred.size
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[: ORDER + 1] / n
    correlation[0] *= 1 + 1e-9
    return np.concatenate([[1.0], -solve_toeplitz(correlation[:-1], correlation[1:])])
