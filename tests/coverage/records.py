"""What a user would record on an axis, a multisine or a sweep while it rolls; and the machine file to begin with, which
knows little."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.controller import PID
from models.feedback.forms import Cascade
from models.machine import Machine, from_table
from studies.new_machine.starter import starter
from tests.coverage.axis import Axis, Log, law, run

Array = NDArray[np.float64]


def band(axis: Axis) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] excited: from 3 Hz, to a third above the highest mode or 0.4 of the rate."""
    highest = float(np.max(axis.frequency, initial=150.0))
    return 3.0, min(1.4 * highest + 100.0, 0.4 / axis.sample_time)


def rolling(axis: Axis, force: Array, seed: int) -> Log:
    """A force (n,) [N] fed forward behind two seconds of rolling, at a speed that it never turns round."""
    ts = axis.sample_time
    impulse = np.cumsum(force - np.mean(force)) * ts / axis.mass
    speed = 1.013 * max(4.0 * float(np.ptp(impulse)), 0.005)
    whole = np.concatenate([np.zeros(round(2.0 / ts)), force])
    return run(axis, np.asarray(speed * ts * np.arange(whole.size), np.float64), whole, seed)


def multisine(axis: Axis, seed: int, periods: int = 8, level: float = 1.0) -> Log:
    """Lines spread evenly in their logarithm with random phases, a period of 1 s; level [1] of the usual force."""
    draw, ts = np.random.default_rng(seed), axis.sample_time
    low, high = band(axis)
    lines = np.unique(np.round(np.geomspace(low, high, 120)).astype(int))
    angle = 2 * np.pi * np.outer(np.arange(round(1.0 / ts)) * ts, lines) + draw.uniform(0, 2 * np.pi, lines.size)
    wave = np.sum(np.cos(angle), axis=1)
    return rolling(axis, np.tile(level * _force(axis) * wave / np.std(wave), periods), seed)


def sweep(axis: Axis, seed: int, length: float = 8.0, level: float = 1.0) -> Log:
    """One logarithmic sweep over `length` [s]; level [1] of the usual force."""
    ts = axis.sample_time
    low, high = band(axis)
    t = np.arange(round(length / ts)) * ts
    rate = np.log(high / low) / length
    phase = 2 * np.pi * low * np.expm1(rate * t) / rate
    return rolling(axis, level * _force(axis) * np.sqrt(2) * np.sin(phase), seed)


def _force(axis: Axis) -> float:
    """Rms force [N]: a g of 0.05."""
    return 0.5 * axis.mass


def first_file(axis: Axis) -> Machine:
    """The machine file of a user who knows the mass to a few per cent, what the drive's display says, and the gains."""
    ts = axis.sample_time
    answers = {
        "mass": f"{axis.mass:.1g} kg",
        "rated_thrust": f"{20 * axis.mass:.3g} N",
        "rated_speed": "1 m/s",
        "sample_time": f"{ts} s",
        "resolution": f"{axis.step} m",
        "stroke": "20 um",
        "tolerance": "1 um",
        "settling_time": f"{0.04 + 20 * ts:.4g} s",
        "friction_force": f"{axis.coulomb:.1g} N",
        "presliding": "30 um",
    }
    machine = from_table(tomllib.loads(starter(answers, "axis")), Path("axis.toml"))
    gains = law(axis)
    if axis.cascade:
        control = replace(machine.control, cascade=Cascade(*gains[:3].tolist()))
    else:
        control = replace(machine.control, pid=PID(*gains.tolist()))
    return replace(machine, control=control)
