"""Experiments for a diagnosis, as the references that the controller is to follow.

A move is a seventh-order polynomial in time, with zero speed, acceleration and jerk at both ends. The feedforward is
the force that the rigid body needs for it, plus an excitation at rest where the experiment has one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.controller import References
from models.machine import Machine
from models.quantity import listed

Array = NDArray[np.float64]

PEAK_SPEED = 35 / 16  # peak speed of a move over its mean speed
PEAK_ACCELERATION = 7.5131884  # peak acceleration of a move, in units of distance / duration^2


@dataclass(frozen=True)
class Schedule:
    """What to run: a name, the target r (n,) [m], and the references x_T*, u_ff and u_rf (n,) [m], [N], [N]."""

    name: str
    target: Array
    given: References


@dataclass(frozen=True)
class Move:
    """A move by `distance` [m] within `duration` [s], then rest for `dwell` [s]; rest only where the distance is 0."""

    distance: float
    duration: float
    dwell: float


@dataclass(frozen=True)
class Excitation:
    """A multisine on the feedforward at rest: `band` [Hz], `amplitude` [N] (rms), `duration` [s]."""

    band: tuple[float, float]
    amplitude: float
    duration: float
    seed: int = 0


Step = Move | Excitation


def schedule(name: str, machine: Machine, steps: Sequence[Step], lead: float = 0.1) -> Schedule:
    """The steps one after the other, after `lead` [s] of rest at 0, at the sample time of the machine's controller."""
    ts, mass = machine.sample_time, machine.plant.mass
    position, target, force = [np.zeros(round(lead / ts))], [np.zeros(round(lead / ts))], [np.zeros(round(lead / ts))]
    at = 0.0
    for step in steps:
        if isinstance(step, Excitation):
            added = _multisine(step, ts)
            path, thrust = np.full(added.size, at), added
        else:
            moving, resting = max(round(step.duration / ts), 1), round(step.dwell / ts)
            s = np.clip(np.arange(1, moving + resting + 1) / moving, 0.0, 1.0)
            path = at + step.distance * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
            curved = 420 * s**2 - 1680 * s**3 + 2100 * s**4 - 840 * s**5
            thrust = mass * step.distance / (moving * ts) ** 2 * curved * (s < 1)
            at += step.distance
        position.append(path)
        target.append(np.full(path.size, at))
        force.append(thrust)
    whole = np.concatenate(position)
    return Schedule(name, np.concatenate(target), References(whole, np.concatenate(force), np.zeros(whole.size)))


def quickest(machine: Machine, distance: float, share: float) -> float:
    """Duration [s] of a move of `distance` [m] whose peak thrust is a share [1] of the rated thrust, within the rated
    speed."""
    force = share * machine.drive.rated_thrust
    by_thrust = float(np.sqrt(PEAK_ACCELERATION * distance * machine.plant.mass / force))
    return max(by_thrust, PEAK_SPEED * distance / machine.drive.rated_speed, 2 * machine.sample_time)


def allowed(machine: Machine, distance: float, speed: float, share: float = 0.6) -> float:
    """The peak speed [m/s] of a move of `distance` [m], reduced to what a share [1] of the rated thrust can reach."""
    return min(speed, PEAK_SPEED * distance / quickest(machine, distance, share))


def _multisine(excitation: Excitation, sample_time: float) -> Array:
    """Sines of equal amplitude and random phase over the band, periodic in the duration, with a soft start and end."""
    n = round(excitation.duration / sample_time)
    low, high = (round(f * n * sample_time) for f in excitation.band)
    spectrum = np.zeros(n // 2 + 1, complex)
    chosen = np.arange(max(low, 1), min(high, n // 2) + 1)
    phase = np.random.default_rng(excitation.seed).uniform(0, 2 * np.pi, chosen.size)
    spectrum[chosen] = np.exp(1j * phase)
    signal = np.fft.irfft(spectrum, n)
    ramp = np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) * sample_time / 0.05, 0.0, 1.0)
    return np.asarray(signal / np.std(signal) * excitation.amplitude * ramp)


def sequence(machine: Machine, repeats: int = 3) -> Schedule:
    """The motions of the specification, up and down, `repeats` times."""
    wanted = machine.specification
    duration = wanted.reference_settling_time
    up = [Move(wanted.stroke, duration, wanted.interval - duration)] * wanted.motions
    down = [Move(-wanted.stroke, duration, wanted.interval - duration)] * wanted.motions
    return schedule("sequence", machine, (up + down) * repeats)


def amplitude_ladder(
    machine: Machine, sizes: Sequence[float] = (2e-6, 5e-6, 10e-6, 20e-6, 50e-6, 100e-6, 200e-6)
) -> Schedule:
    """Moves of each size [m], twice up and twice down, within 30 ms."""
    steps = [Move(sign * size, 0.03, 0.22) for size in sizes for sign in (1, 1, -1, -1)]
    return schedule("amplitude ladder", machine, steps)


def dwell_sweep(
    machine: Machine, dwells: Sequence[float] = (0.06, 0.12, 0.25, 0.5, 1.0, 1.5), stroke: float = 17.3e-6
) -> Schedule:
    """Moves after rests of each length [s], onward in the same direction and back."""
    steps = [Move(sign * stroke, 0.025, dwell) for dwell in dwells for sign in (1, 1, -1, -1)]
    return schedule("dwell sweep", machine, steps)


def multisine(
    machine: Machine, band: tuple[float, float] = (4.0, 400.0), amplitude: float = 4.0, duration: float = 4.0
) -> Schedule:
    """A multisine at rest: band [Hz], amplitude [N] (rms), duration [s]."""
    return schedule(
        "multisine", machine, [Move(0.0, 0.1, 0.1), Excitation(band, amplitude, duration), Move(0.0, 0.1, 0.1)]
    )


def strokes(machine: Machine, distance: float, speeds: Sequence[float], passes: int = 1) -> Schedule:
    """Strokes of `distance` [m] there and back at each peak speed [m/s]."""
    steps = [
        Move(sign * distance, PEAK_SPEED * distance / speed, 0.3)
        for speed in speeds
        for _ in range(passes)
        for sign in (1, -1)
    ]
    return schedule("strokes", machine, steps)


def hold(machine: Machine, duration: float = 15.0) -> Schedule:
    """Nothing moves for `duration` [s]."""
    return schedule("hold", machine, [Move(0.0, duration, 0.0)])


def nested_loops(
    machine: Machine, sizes: Sequence[float] = (30e-6, 10e-6, 3e-6, 1e-6), duration: float = 0.2
) -> Schedule:
    """Loops of each size [m] back and forth, each from the end of the larger one, each way in `duration` [s]."""
    steps = [Move(sign * size, duration, 0.1) for size in sizes for sign in (1, -1, 1, -1)]
    return schedule("nested loops", machine, steps)


def hard_moves(machine: Machine, distance: float = 1e-3, shares: Sequence[float] = (0.2, 0.4, 0.6, 0.8)) -> Schedule:
    """Moves of `distance` [m] there and back whose peak thrust is each share [1] of the rated thrust."""
    steps = [
        Move(sign * distance, quickest(machine, distance, share), 0.25) for share in shares for sign in (1, -1) * 2
    ]
    return schedule("hard moves", machine, steps)


def moves_along(
    machine: Machine, places: int = 6, apart: float = 10e-3, distance: float = 1e-3, share: float = 0.5
) -> Schedule:
    """Fast moves of `distance` [m] back and forth at places `apart` [m], at a share [1] of the rated thrust."""
    fast = quickest(machine, distance, share)
    here = [Move(sign * distance, fast, 0.15) for sign in (1, -1)]
    steps = [*here, *([Move(apart, 0.4, 0.2), *here] * (places - 1)), Move(-apart * (places - 1), 1.0, 0.2)]
    return schedule("moves along the way", machine, steps)


def repeated_strokes(machine: Machine, distance: float = 5e-3, speed: float = 0.03, passes: int = 12) -> Schedule:
    """The same stroke [m] at one speed [m/s], again and again."""
    return strokes(machine, distance, (speed,), passes)


def together(name: str, parts: Sequence[Schedule]) -> Schedule:
    """Several schedules as one; all begin and end at 0."""
    return Schedule(
        name,
        np.concatenate([part.target for part in parts]),
        References(
            np.concatenate([part.given.position for part in parts]),
            np.concatenate([part.given.feedforward for part in parts]),
            np.concatenate([part.given.compensation for part in parts]),
        ),
    )


def suite(machine: Machine) -> Schedule:
    """The main experiments of the menu in one record of half a minute."""
    return together(
        "suite",
        [
            amplitude_ladder(machine),
            dwell_sweep(machine),
            multisine(machine),
            strokes(machine, 1.5e-3, (0.005,)),
            strokes(machine, 6e-3, (0.02,)),
            strokes(machine, 12e-3, (0.08,)),
            strokes(machine, 20e-3, (0.12,)),
            strokes(machine, 60e-3, (0.15,), passes=2),
        ],
    )


@dataclass(frozen=True)
class Experiment:
    """One entry of the menu: its settings in words, its schedule, and the coordinates that it varies the most."""

    words: str
    schedule: Schedule
    coordinates: tuple[str, ...] = ()


def menu(machine: Machine) -> tuple[Experiment, ...]:
    """The experiments that can be run on this machine, with settings within its ratings."""
    long, slow = 60e-3, (0.005, 10e-3)
    speeds = tuple(float(f"{allowed(machine, 10e-3, speed):.3g}") for speed in (0.005, 0.02, 0.05, 0.1))
    fast = float(f"{allowed(machine, long, 0.15):.3g}")
    nyquist = 0.5 / machine.sample_time
    high = min(800.0, 0.8 * nyquist)
    return (
        Experiment(
            "a dwell sweep: moves of 17.3 µm in 25 ms after rests of 0.06, 0.12, 0.25, 0.5, 1 and 1.5 s, onward in "
            "the same direction and back",
            dwell_sweep(machine),
            ("dwell", "time_in_motion"),
        ),
        Experiment("a hold: nothing moves for 15 s", hold(machine), ("time",)),
        Experiment(
            f"a speed ladder: strokes of 10 mm there and back at peak speeds of {_list(speeds, 1e3)} mm/s",
            strokes(machine, 10e-3, speeds),
            ("velocity", "velocity_sign"),
        ),
        Experiment(
            f"a slow stroke of {slow[1] * 1e3:g} mm there and back at {slow[0] * 1e3:g} mm/s, not commensurate with "
            "the scale's period",
            strokes(machine, slow[1] + 1.7e-5, (slow[0],)),
            (),
        ),
        Experiment(
            f"long strokes of {long * 1e3:g} mm there and back at {1e3 * fast:g} mm/s, twice",
            strokes(machine, long, (fast,), passes=2),
            ("position", "pitch"),
        ),
        Experiment(
            f"a multisine of 4 to {high:g} Hz and 4 N (rms) at rest, for 4 s",
            multisine(machine, (4.0, high)),
            ("acceleration",),
        ),
        Experiment(
            "a small multisine of 2 to 100 Hz and 0.3 N (rms) at rest, for 4 s", multisine(machine, (2.0, 100.0), 0.3)
        ),
        Experiment(
            "nested loops of 30, 10, 3 and 1 µm back and forth, 0.2 s each way",
            nested_loops(machine),
            ("since_reversal",),
        ),
        Experiment(
            "an amplitude ladder: moves of 2, 5, 10, 20, 50, 100 and 200 µm within 30 ms, twice up and twice down",
            amplitude_ladder(machine),
        ),
        Experiment(
            "hard moves of 1 mm there and back at 20, 40, 60 and 80 % of the rated thrust, twice each",
            hard_moves(machine),
            ("command",),
        ),
        Experiment(
            "fast moves of 1 mm back and forth, at half the rated thrust, at 6 places 10 mm apart",
            moves_along(machine),
        ),
        Experiment(
            "one stroke of 5 mm at 30 mm/s at the same place, twelve times there and back", repeated_strokes(machine)
        ),
    )


def _list(numbers: Sequence[float], factor: float) -> str:
    """Numbers times a factor, as text."""
    return listed(f"{factor * number:g}" for number in dict.fromkeys(numbers))


def to_csv(planned: Schedule, sample_time: float) -> str:
    """The schedule as a record of references (SI): time_s, target_m, reference_m, feedforward_N."""
    given = planned.given
    lines = ["time_s,target_m,reference_m,feedforward_N"]
    force = given.feedforward + given.compensation
    for k, (target, reference, pushed) in enumerate(zip(planned.target, given.position, force, strict=True)):
        lines.append(f"{k * sample_time:.9g},{target:.9g},{reference:.9g},{pushed:.9g}")
    return "\n".join(lines) + "\n"
