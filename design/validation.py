"""The judge of a design: the motions of Fig. 5 on the nonsmooth machine, repeated until periodic, and their outcome."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.controller import Controller, References
from models.machine import Machine
from models.quantity import show
from models.records.record import Motion, feeding_sequence, motions
from models.records.settling import dispersion, overshoot, settling_time
from models.simulation.simulator import Response, simulate, simulate_many

Array = NDArray[np.float64]
Reading = Literal["position", "scale"]

PERIODS: Final = 3  # The sequence is simulated so often at first; the default machine then repeats itself.
LONGER_PERIODS: Final = (6, 12, 24)  # So many periods are tried where fewer do not repeat.
OF_TOLERANCE: Final = 0.05  # of the tolerance: by so much two periods may differ and a motion is judged all the same
BATCH: Final = 40  # At most so many machines are simulated side by side,
# and so few that they have no more samples together, of about 100 bytes each: 1 GB.
MAX_BLOCK_SAMPLES: Final = 10_000_000
ROUNDING: Final = 1e-9  # Relative. Readings are rounded multiples of the resolution, and 20 of 0.1 um are within 2 um.


@dataclass(frozen=True)
class Achieved:
    """One motion's outcome: times [s], lengths [m], thrust [N]; `error` (n,) [m] is x - target from the step on."""

    motion: Motion
    settling_time: float
    overshoot: float
    peak_thrust: float
    error: Array


@dataclass(frozen=True)
class Validation:
    """The last of `periods` of the sequence: its response, cut into motions; `repeat_error` [m] to the period before.

    dispersion (n,) [m] is 3 sigma over the positive motions at each time from the step on; worst_dispersion [m] its
    largest value after the specified settling time. Positions are the true ones or the scale's, as `validate` was told.

    >>> validation
    Validation(10 motions, slowest settles in 19.5 ms, 3 sigma 57... nm after 25 ms, peak thrust ... N)
    """

    machine: Machine
    response: Response
    achieved: tuple[Achieved, ...]
    periods: int
    repeat_error: float
    dispersion: Array
    worst_dispersion: float

    def __repr__(self) -> str:
        after = show(self.machine.specification.settling_time, "s")
        return (
            f"Validation({len(self.achieved)} motions, slowest settles in {show(self.slowest.settling_time, 's')}, "
            f"3 sigma {show(self.worst_dispersion, 'm')} after {after}, peak thrust {show(self.peak_thrust, 'N')})"
        )

    @property
    def positive(self) -> tuple[Achieved, ...]:
        """The motions that the paper evaluates: those in the positive direction, the reversal first."""
        return tuple(one for one in self.achieved if one.motion.direction > 0)

    @property
    def reversal(self) -> Achieved:
        """The first motion in the positive direction, behind one in the negative direction."""
        return self.positive[0]

    @property
    def inching(self) -> tuple[Achieved, ...]:
        """The motions in the positive direction that follow another such motion."""
        return self.positive[1:]

    @property
    def slowest(self) -> Achieved:
        """The motion, in either direction, that settles last."""
        return max(self.achieved, key=lambda one: one.settling_time)

    @property
    def peak_thrust(self) -> float:
        """The largest |u_M| [N] of all motions."""
        return max(one.peak_thrust for one in self.achieved)

    def settling_within(self, tolerance: float) -> float:
        """When [s] the slowest motion stays within another `tolerance` [m] than the specified one; inf for never."""
        ts = self.machine.sample_time
        return max(settling_time(one.error, tolerance, ts) for one in self.achieved)

    def dispersion_after(self, time: float) -> float:
        """The largest 3 sigma [m] from `time` [s] after the step on."""
        return float(np.max(self.dispersion[round(time / self.machine.sample_time) :], initial=0.0))


def validate(
    machine: Machine,
    controller: Controller,
    *,
    stroke: float | None = None,
    periods: int | None = None,
    reading: Reading = "position",
    lead: int = 0,
    substeps: int | None = None,
    seed: int = 0,
) -> Validation:
    """What the sequence of Fig. 5 with strokes of `stroke` [m] (default: the specification's) achieves on a machine.

    periods: of the sequence, at least 2; by default as many as it takes until the last two agree (see `agreement`).
    reading: whether motions are judged by the true position or by the scale. lead: samples of rest before the sequence.
    substeps: of the simulation in a sample; None: as many as the machine needs. seed: of the scale's noise. Raises
    ValueError for fewer than 2 periods, and for a stroke or a reading that there is not.

    >>> validation = pos.validate(machine, controller)
    >>> validation.slowest.settling_time < machine.specification.settling_time  # [s]
    True
    """
    for count in (PERIODS, *LONGER_PERIODS) if periods is None else (periods,):
        target = sequence(machine, stroke, count, lead)
        response = simulate(machine, controller, target, substeps=substeps, seed=seed)
        found = assess(machine, response, stroke=stroke, periods=count, reading=reading)
        if found.repeat_error <= agreement(machine):
            break
    return found


def validate_many(
    machines: Sequence[Machine],
    controller: Controller | Sequence[Controller],
    *,
    periods: int = PERIODS,
    reading: Reading = "position",
    substeps: int | None = None,
) -> tuple[Validation, ...]:
    """`validate` of each machine over the same sequence, many at a time.

    controller: for all, or one for each. The machines must agree in stroke, number and interval of motions and sample
    time. Whether the last two periods agree is in each Validation's repeat_error [m]. Each keeps its last period only;
    what is simulated at a time is bounded by MAX_BLOCK_SAMPLES.
    """
    if not machines:
        return ()
    responses = respond(machines, controller, sequence(machines[0], None, periods), substeps=substeps)
    return tuple(
        assess(machine, response, periods=periods, reading=reading)
        for machine, response in zip(machines, responses, strict=True)
    )


def respond(
    machines: Sequence[Machine],
    controller: Controller | Sequence[Controller],
    target: Array,
    *,
    given: References | Sequence[References] | None = None,
    substeps: int | None = None,
    seed: int = 0,
    initial_friction: Sequence[ArrayLike] | None = None,
) -> Iterator[Response]:
    """The responses of many machines to one target r (n,) [m], simulated up to BATCH at a time as they are asked for.

    controller, given: for all, or one for each; given: x_T*, u_ff, u_rf over the whole target. seed: of the scale's
    noise. initial_friction: of each machine's elements (N,) [m], default 0. Who keeps little of each response needs
    memory for one batch only.
    """
    laws = [controller] * len(machines) if isinstance(controller, Controller) else controller
    size = max(min(BATCH, MAX_BLOCK_SAMPLES // max(target.size, 1)), 1)
    for begin in range(0, len(machines), size):
        part = slice(begin, begin + size)
        its = given if given is None or isinstance(given, References) else given[part]
        starts = None if initial_friction is None else initial_friction[part]
        yield from simulate_many(
            machines[part], laws[part], target, given=its, substeps=substeps, seed=seed, initial_friction=starts
        )


def sequence(machine: Machine, stroke: float | None = None, periods: int = PERIODS, lead: int = 0) -> Array:
    """The target r (n,) [m] of Fig. 5 with strokes of `stroke` [m] (default: the specification's), `periods` times.

    `lead` samples of rest go before it.
    """
    wanted = machine.specification
    height = wanted.stroke if stroke is None else stroke
    if not np.isfinite(height) or height == 0:
        raise ValueError(f"stroke: must be a way other than 0 [m], not {height:g}")
    whole = feeding_sequence(height, wanted.motions, wanted.interval, machine.sample_time, periods)
    return np.concatenate([np.zeros(lead), whole])


def agreement(machine: Machine) -> float:
    """How far [m] two periods may differ to count as equal: a step of the scale, which rounds them, and noise."""
    return max(machine.scale.resolution + 6 * machine.scale.noise, 1e-3 * machine.specification.tolerance)


def repeats_within(machine: Machine) -> float:
    """How far [m] two periods may differ where motions are judged by the specification: what `agreement` asks for, or a
    part of the tolerance that decides nothing; with friction of many contacts, a count of the scale is passed on from
    period to period."""
    return max(agreement(machine), OF_TOLERANCE * machine.specification.tolerance)


def assess(
    machine: Machine,
    response: Response,
    *,
    stroke: float | None = None,
    periods: int = PERIODS,
    reading: Reading = "position",
) -> Validation:
    """What the last period of a response to `sequence` achieved, and how far it is from the one before; see `validate`.

    stroke [m]. Raises ValueError for fewer than 2 periods.
    """
    if reading not in get_args(Reading):
        raise ValueError(f"reading {reading!r} is unknown; choose one of {', '.join(get_args(Reading))}")
    if periods < 2:
        raise ValueError(f"the last period is compared with the one before; give at least 2 periods, not {periods}")
    period = sequence(machine, stroke, 1)
    n, by_scale = period.size, reading == "scale"
    position = response.record.position if by_scale else response.position
    repeat_error = float(np.max(np.abs(position[-n:] - position[-2 * n : -n])))
    last = response.last(n)
    wanted = machine.specification
    tolerance = wanted.tolerance * (1 + ROUNDING) if by_scale else wanted.tolerance
    achieved = tuple(
        _achieved(motion, position[-n:], last.record.command, tolerance, machine.sample_time)
        for motion in _within_period(period)
    )
    spread = dispersion([one.error for one in achieved if one.motion.direction > 0])
    after = round(wanted.settling_time / machine.sample_time)
    worst = float(np.max(spread[after:], initial=0.0))
    return Validation(machine, last, achieved, periods, repeat_error, spread, worst)


def last_errors(position: Array, target: Array, periods: int) -> list[Array]:
    """x - r [m] of each motion in the last of the periods of a `sequence`, from its step on; position, target (n,) [m].

    For positions that no simulation of this project gave, as those of exported programs.
    """
    begin = target.size - target.size // periods
    return [position[one.start : one.stop] - one.target for one in motions(target) if one.start >= begin]


def _within_period(period: Array) -> Sequence[Motion]:
    """The motions of one period that others precede: its first comes after a motion down, so it is a reversal."""
    return motions(np.concatenate([period, period]), initial=0.0)[: len(motions(period))]


def _achieved(motion: Motion, position: Array, command: Array, tolerance: float, sample_time: float) -> Achieved:
    part = slice(motion.start, motion.stop)
    error = position[part] - motion.target
    return Achieved(
        motion,
        settling_time(error, tolerance, sample_time),
        overshoot((position[part] - motion.origin) * motion.direction, abs(motion.target - motion.origin)),
        float(np.max(np.abs(command[part]))),
        error,
    )
