"""What to run on an axis so that it can be identified and diagnosed: references alone, in sizes of the axis itself.

Lengths are in presliding distances and strokes, forces in shares of the rated thrust and of friction, times in settling
times and sample times. The suite is the one that a diagnosis begins with (`diagnosis.experiments.schedules.suite`).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.experiments.schedules import (
    SUITE_SAMPLES,
    Move,
    Schedule,
    quickest,
    room,
    schedule,
    suite,
)
from models.controller import References
from models.machine import Machine
from models.plant import frequency_response

FILE_NAMES: Final = ("slow_loops.csv", "sweep_low.csv", "sweep_high.csv", "strokes.csv", "suite.csv")
# Of friction: the largest inertial force of slow loops, so that they show friction alone.
MAX_SLOW_INERTIA_SHARE: Final = 0.01
WIDE: Final = (2.5, 0.6)  # presliding distances: amplitudes of slow loops, and of the inner ones
GENTLY: Final = 4  # parts of a slow loop, in one of which it comes to its speed: no more force than turning round takes
SAMPLES: Final = 4000  # least samples of a slow loop
TOP: Final = 0.2  # of the sample rate: the end of sweeps
DECADES: Final = 2.0  # of frequency in a sweep
SWEEP: Final = 20_000  # samples of a sweep, 10 s at 2 kHz
ROLLING: Final = 0.005  # of the rated speed: the axis rolls under the sweep
STRONG: Final = 0.1  # of the rated thrust: the most of a sweep's force
LEVELS: Final = {"sweep_low.csv": 0.3, "sweep_high.csv": 1.0}  # of the strongest sweep
KEEPS_ROLLING: Final = 0.3  # of that speed: the most that a sweep's force may make the table oscillate
REST: Final = 10  # settling times after a stroke, fewer where the strokes would have more samples than this
STROKES_SAMPLES: Final = 90_000  # as the suite's: a diagnosis takes both
SHORTEST_REST: Final = 2  # settling times


def axis_references(machine: Machine) -> dict[str, Schedule]:
    """The references by the names of their files; they begin at 0, and all but the sweeps end there. [m], [N].

    The two sweeps roll in opposite directions, so that one after the other they end where they began.
    """
    sweeps = {name: _sweep(machine, level, sign) for (name, level), sign in zip(LEVELS.items(), (1, -1), strict=True)}
    others = {"strokes.csv": _strokes(machine), "suite.csv": suite(machine, SUITE_SAMPLES)}
    return {"slow_loops.csv": _slow_loops(machine), **sweeps, **others}


def _slow_loops(machine: Machine) -> Schedule:
    """Two slow loops over 2.5 presliding distances either way, as far as the axis may travel, then four inner ones; the
    inertial force is slight."""
    ts, reach = machine.sample_time, min(max(machine.friction.limit), room(machine) / (2 * WIDE[0]))
    heavy = machine.plant.mass * WIDE[0] * reach / (MAX_SLOW_INERTIA_SHARE * machine.friction.coulomb_force)
    count = max(SAMPLES, round(2 * np.pi * np.sqrt(heavy) / ts))
    two = 4 * np.pi * _from_rest_to_rest(2 * count, count // GENTLY)
    angle = np.concatenate([two, 4 * np.pi + two])
    path = np.where(angle < 4 * np.pi, WIDE[0] * np.sin(angle), WIDE[1] * np.sin(2 * angle)) * reach
    path = np.asarray(np.append(path, 0.0), np.float64)
    return Schedule("slow loops", path, References(path, np.zeros(path.size), np.zeros(path.size)))


def _sweep(machine: Machine, level: float, sign: float = 1.0) -> Schedule:
    """A sweep on the feedforward while the axis rolls in one direction, at a level [1] of the strongest one.

    Its force grows with frequency up to a share of the rated thrust, and is less about the file's modes, so that the
    axis never stops; it begins after a twentieth of rolling alone, to which the axis comes gently: a controller with
    an acceleration feedforward of its own would answer a step of speed with all its thrust.
    """
    ts, begin, count = machine.sample_time, SWEEP // 20, SWEEP
    speed = min(ROLLING * machine.drive.rated_speed, room(machine) / ((begin + count) * ts))
    share = np.arange(count) / count
    low, rate = TOP / ts / 10**DECADES, DECADES * np.log(10)
    frequency = low * np.exp(rate * share)
    angle = 2 * np.pi * low * count * ts / rate * np.expm1(rate * share)
    omega = 2 * np.pi * frequency
    moves = np.maximum(np.abs(frequency_response(machine.plant, omega)), 1 / (machine.plant.mass * omega**2))
    rolling = KEEPS_ROLLING * speed / (omega * moves)
    soft = np.clip(np.minimum(share, 1 - share) * 50, 0, 1)
    force = level * soft * np.minimum(STRONG * machine.drive.rated_thrust, rolling) * np.sin(angle)
    turning = _eased(begin + count, begin // 2)
    position = np.asarray(sign * speed * ts * np.append(0.0, np.cumsum(turning[1:])), np.float64)
    return Schedule(
        "sweep", position, References(position, np.concatenate([np.zeros(begin), force]), np.zeros(begin + count))
    )


def _eased(count: int, ease: int) -> np.ndarray:
    """A rate (count,) [1] that rises from 0 to 1 over the first samples, with no step of its slope."""
    share = np.clip(np.arange(count) / max(ease, 1), 0.0, 1.0)
    return np.asarray(share**2 * (3 - 2 * share), np.float64)


def _from_rest_to_rest(count: int, ease: int) -> np.ndarray:
    """Shares (count,) [1] of a way from 0 on, at one rate but for the first and the last samples."""
    rate = np.minimum(_eased(count + 1, ease), _eased(count + 1, ease)[::-1])
    whole = np.cumsum(0.5 * (rate[1:] + rate[:-1]))
    return np.asarray(np.append(0.0, whole[:-1]) / whole[-1], np.float64)


def _strokes(machine: Machine) -> Schedule:
    """Strokes of the specification, of half and up to ten times its length, up and down, each with its rigid body's
    feedforward. The longest come first: from their end on the friction's state is known, and a fit begins there."""
    wanted = machine.specification
    far = min(10.0, room(machine) / (wanted.motions * wanted.stroke))  # specified strokes
    sizes = np.repeat([sign * size * wanted.stroke for size in (far, 1.0, 0.5) for sign in (1, -1)], wanted.motions)
    durations = [max(wanted.reference_settling_time, quickest(machine, abs(size), 0.6)) for size in sizes]
    left = (STROKES_SAMPLES * machine.sample_time - wanted.settling_time - sum(durations)) / sizes.size
    rest = max(min(REST * wanted.settling_time, left), SHORTEST_REST * wanted.settling_time)
    steps = [Move(float(size), duration, rest) for size, duration in zip(sizes, durations, strict=True)]
    return schedule("strokes", machine, steps, lead=wanted.settling_time)
