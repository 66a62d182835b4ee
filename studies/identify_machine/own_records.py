"""Records of a simulated table, quantised, noisy, with friction: like a user's, but with known true values.

The excitation acts while the axis rolls in one direction, so that friction is constant; the hysteresis is a slow sweep
with inner loops; the motions are short strokes of the specification, and half as long.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.controller import bare_controller
from models.controller import References
from models.friction import elements
from models.machine import Machine
from models.records.record import Record, feeding_sequence
from models.simulation.simulator import simulate
from models.variation import Variation, known_apart, varied

Array = NDArray[np.float64]

SPEED: Final = 0.01  # m/s at which the axis rolls under the excitation
PERIODS: Final = 10
DURATION: Final = 28.0  # s of the three records of a table, about
BAND: Final = (4.0, 400.0)  # Hz
LINES: Final = 80
AMPLITUDE: Final = 0.08  # of the rated thrust, over the square root of the lines
SWING: Final = 1.2  # of that speed: the most by which the excitation may change it, so that the axis keeps rolling


def noisy(machine: Machine) -> Machine:
    """The machine with noise on its scale, even if its file states none."""
    return replace(machine, scale=machine.scale.noisy())


def another(machine: Machine, seed: int) -> Machine:
    """A similar table: modes, dead time, offset and friction drawn at random, with three elements that data can
    resolve."""
    draw = np.random.default_rng(seed)
    scatter = np.array([0.1, 0.05, 0.2])  # of a gain, a frequency and a damping ratio, on the logarithm
    off = [np.exp(scatter * draw.standard_normal(3)) - 1 for _ in machine.plant.modes]
    gain, frequency, damping = (tuple(column) for column in np.transpose(off).tolist())
    delay = machine.sample_time * float(draw.uniform(-0.4, 0.4))
    limit = np.array([2.5e-6, 12e-6, 80e-6]) * np.exp(0.15 * draw.standard_normal(3))
    force = machine.friction.coulomb_force * np.array([0.45, 0.3, 0.25]) * np.exp(0.15 * draw.standard_normal(3))
    offset = float(draw.standard_normal())
    variation = Variation(modal_gain=gain, frequency=frequency, damping=damping, dead_time=delay, offset=offset)
    return replace(varied(machine, variation), friction=elements(force / limit, limit))


def drawn_from(machine: Machine, seed: int, *, held: bool = False) -> tuple[Machine, Array]:
    """A table with other values of what a motion fit identifies: its (mass, friction level, presliding length)
    [1], dead time [s] and offset [N].

    held: what the fit takes as known, the modes and the friction's shape, is off by its deviations, too; level and
    length are then those of the table before that.
    """
    draw = np.random.default_rng(seed)
    mass, level, length = (np.exp(np.array([0.05, 0.1, 0.05]) * draw.standard_normal(3)) - 1).tolist()
    delay = 0.2 * machine.sample_time * float(draw.uniform(-1, 1))
    offset = float(draw.standard_normal())
    variation = Variation(friction_force=level, friction_length=length, mass=mass, dead_time=delay, offset=offset)
    moved = varied(_with_held(machine, draw) if held else machine, variation)
    undamped = elements(moved.friction.stiffness, moved.friction.limit)  # as the identification assumes
    moved = replace(moved, friction=undamped)
    truth = np.array([1 + mass, 1 + level, 1 + length, moved.plant.dead_time, moved.drive.offset])
    return moved, truth


def _with_held(machine: Machine, draw: np.random.Generator) -> Machine:
    """The machine whose modes and elements are off by their deviations [1], each on its own."""
    off: dict[str, list[float]] = {name: [] for name in ("gain", "frequency", "damping", "stiffness", "limit")}
    size = {one.name: one.relative for one in known_apart(machine)}
    for i, mode in enumerate(machine.plant.modes, start=1):
        for name in ("gain", "frequency", "damping"):
            rigid = mode.frequency == 0
            off[name].append(0.0 if rigid else size[f"plant.modes.{i}.{name}"][0] * draw.standard_normal())
    for name in ("stiffness", "limit"):
        off[name] = [one * draw.standard_normal() for one in size[f"friction.{name}"]]
    gain, frequency, damping, stiffness, limit = (tuple(one) for one in off.values())
    held = Variation(modal_gain=gain, frequency=frequency, damping=damping, stiffness=stiffness, limit=limit)
    return varied(machine, held)


def excitation(machine: Machine, seed: int) -> Record:
    """A multisine on the feedforward while the axis rolls at a constant speed, too weak to turn it round."""
    draw, ts = np.random.default_rng(seed), machine.sample_time
    length = round(1.0 / ts)
    top = min(BAND[1], 0.4 / ts)
    lines = np.unique(np.round(np.geomspace(BAND[0], top, LINES)).astype(int))
    size = AMPLITUDE * machine.drive.rated_thrust / np.sqrt(lines.size)
    angle = 2 * np.pi * np.outer(np.arange(length) / length, lines)
    wave = size * np.sum(np.cos(angle + draw.uniform(0, 2 * np.pi, lines.size)), axis=1)
    swing = float(np.ptp(np.cumsum(wave))) * ts / machine.plant.mass
    wave *= min(1.0, SWING * SPEED / swing)
    count = (PERIODS + 2) * length
    force = np.concatenate([np.zeros(length), np.tile(wave, PERIODS + 1)])
    return run(machine, SPEED * ts * np.arange(count, dtype=np.float64), force, seed)


def hysteresis(machine: Machine, seed: int) -> Record:
    """Two slow sweeps over 2.5 presliding lengths either way, then two inner ones."""
    t = np.arange(round(12.0 / machine.sample_time)) * machine.sample_time
    wide = 2.5 * max(machine.friction.limit)
    path: Array = np.where(t < 8, wide * np.sin(np.pi * t / 2), 0.25 * wide * np.sin(np.pi * (t - 8)))
    return run(machine, np.asarray(path, np.float64), np.zeros(t.size), seed)


def motions(machine: Machine, seed: int, nominal: Machine | None = None) -> Record:
    """Strokes of the specification and half as long; SI.

    The feedforward is the nominal machine's, as the controller is designed before identification. The feedback is the
    one that the machine states, because it is the one that is replayed.
    """
    controller, control = bare_controller(nominal or machine), machine.control
    if control.law is not None:
        controller = replace(controller, law=control.law, reference_delay=control.reference_delay)
    ts, stroke = machine.sample_time, machine.specification.stroke
    short = feeding_sequence(stroke, machine.specification.motions, 0.15, ts)
    target = np.concatenate([short, feeding_sequence(0.5 * stroke, 4, 0.15, ts), short])
    return simulate(machine, controller, target, seed=seed).record


def run(machine: Machine, reference: Array, force: Array, seed: int) -> Record:
    """The loop over a reference (n,) [m] with a force (n,) [N] on its feedforward."""
    given = References(reference, force, np.zeros(force.size))
    return simulate(machine, machine.feedback_only(), reference, given=given, seed=seed).record
