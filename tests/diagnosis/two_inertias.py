"""A motor and a load on a spring, the scale on either: integrated here in small steps, friction on either or both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.controller import PID
from models.friction import elements
from models.machine import FROM_ELEMENTS, Machine, load
from models.plant import Mode, Plant
from models.records.record import Record

Array = NDArray[np.float64]

TS = 1e-4
STEPS = 40  # of the integration in a sample
LATE = 2  # samples of dead time
MOTOR, LOAD = 0.6, 0.4  # kg
HELD = 2 * math.pi * 600.0  # rad/s, of the load while the motor is held
SPRING = LOAD * HELD**2
DAMPING = 0.03 * 2 * math.sqrt(SPRING * LOAD)  # N s/m
LIMITS = np.geomspace(1e-6, 20e-6, 6)
STIFFNESS = 0.25 / LIMITS  # each slips at 0.25 N
NOISE = 2e-9  # m
CROSSOVER = 2 * math.pi * 30.0  # rad/s


@dataclass(frozen=True)
class Ran:
    """Commands and readings of each sample, and at every step of the integration the load's position, its speed and
    the friction."""

    command: Array
    reading: Array
    position: Array
    speed: Array
    friction: Array


def machine(*, reads_motor: bool = False) -> Machine:
    """The model of it that knows all but where the friction acts; the scale is on the load, or on the motor."""
    table, mass = load(), MOTOR + LOAD
    natural = HELD * math.sqrt(1 + LOAD / MOTOR)
    damping = DAMPING * (1 / MOTOR + 1 / LOAD) / 2 / natural
    modes = Mode(1 / mass, 0.0, 0.0), Mode((LOAD / MOTOR if reads_motor else -1) / mass, natural / 2 / math.pi, damping)
    pid = PID(mass * CROSSOVER**2 / 3, mass * CROSSOVER**3 / 15, mass * CROSSOVER, TS)
    return replace(
        table,
        name="two inertias",
        plant=Plant(LATE * TS, 1.0, modes),
        friction=elements(STIFFNESS, LIMITS),
        control=replace(table.control, sample_time=TS, reference_delay=LATE, pid=pid),
        drive=replace(table.drive, rated_thrust=60.0, offset=0.0),
        scale=replace(table.scale, resolution=0.0, noise=NOISE),
        presliding=FROM_ELEMENTS,
        published=None,
        sources={},
    )


def moves(strokes: tuple[float, ...], time: float = 5e-3, rest: float = 25e-3) -> tuple[Array, Array]:
    """Targets, and references that go there along quintics, of strokes one after another [m]."""
    count, still = round(time / TS), round(rest / TS)
    part = np.arange(1, count + 1) / count
    course = np.concatenate([part**3 * (10 - 15 * part + 6 * part**2), np.ones(still)])
    begins = np.concatenate([[0.0], np.cumsum(strokes)])
    targets = [np.full(count + still, end) for end in begins[1:]]
    references = [begin + stroke * course for begin, stroke in zip(begins, strokes, strict=False)]
    pause = np.zeros(still)
    return np.concatenate([pause, *targets]), np.concatenate([pause, *references])


def record(on_motor: float, seed: int, strokes: tuple[float, ...], *, reads_motor: bool = False) -> Record:
    """What its controller logs along these strokes [m]; see `run`."""
    target, reference = moves(strokes)
    asked = (MOTOR + LOAD) * np.gradient(np.gradient(reference, TS), TS)
    ran = run(asked, reference, on_motor=on_motor, seed=seed, reads_motor=reads_motor)
    return Record(TS, target, reference, asked, ran.command, ran.reading)


def run(feedforward: Array, reference: Array, *, on_motor: float, seed: int = 0, reads_motor: bool = False) -> Ran:
    """A feedforward [N] beside the PID along a reference [m], from rest; on_motor: the share [1] of the friction that
    acts on the motor, the rest acts on the load."""
    n, pid = feedforward.size, machine().control.pid
    signals = np.zeros((3, n * STEPS))
    logged = np.zeros((2, n))
    noise = NOISE * np.random.default_rng(seed).standard_normal(n)
    gains = np.array([pid.kp, pid.ki, pid.kd, pid.pole(TS)])
    late = np.concatenate([np.full(LATE, reference[0]), reference])[:n]
    _integrate(np.array([feedforward, late, noise]), gains, float(on_motor), reads_motor, logged, signals)
    return Ran(*logged, *signals)


@compiled
def _integrate(given: Array, gains: Array, on_motor: float, reads_motor: bool, logged: Array, signals: Array) -> None:
    (feedforward, reference, noise), (command, reading) = given, logged
    x1 = v1 = x2 = v2 = integral = slope = previous = 0.0
    z, h, at1, at2 = np.zeros((2, LIMITS.size)), TS / STEPS, 0.0, 0.0
    for k in range(command.size):
        reading[k] = (x1 if reads_motor else x2) + noise[k]
        error = reference[k] - reading[k]
        integral += gains[1] * TS * error
        slope = gains[3] * slope + (1.0 - gains[3]) * (error - previous) / TS
        previous = error
        command[k] = gains[0] * error + integral + gains[2] * slope + feedforward[k]
        thrust = command[k - LATE] if k >= LATE else 0.0
        for i in range(STEPS):  # the positions half a step before the speeds
            x1 += 0.5 * h * v1
            x2 += 0.5 * h * v2
            friction1 = friction2 = 0.0
            for j in range(LIMITS.size):
                z[0, j] = max(-LIMITS[j], min(z[0, j] + x1 - at1, LIMITS[j]))
                z[1, j] = max(-LIMITS[j], min(z[1, j] + x2 - at2, LIMITS[j]))
                friction1 += on_motor * STIFFNESS[j] * z[0, j]
                friction2 += (1.0 - on_motor) * STIFFNESS[j] * z[1, j]
            at1, at2 = x1, x2
            pull = SPRING * (x1 - x2) + DAMPING * (v1 - v2)
            v1 += h * (thrust - pull - friction1) / MOTOR
            v2 += h * (pull - friction2) / LOAD
            signals[0, k * STEPS + i], signals[1, k * STEPS + i] = x2, v2
            signals[2, k * STEPS + i] = friction1 + friction2
            x1 += 0.5 * h * v1
            x2 += 0.5 * h * v2
