"""An axis that is sampled as slowly as a leg's actuator: 0.5 kg, and records of its strokes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.controller import PID
from models.friction import elements
from models.machine import FROM_ELEMENTS, Machine, load
from models.plant import Mode, Plant
from models.records.record import Record
from models.simulation.simulator import simulate


def leg(rate: float) -> Machine:
    """Sampled at `rate` [Hz], with a dead time of 1.5 samples and a PID whose crossover is a thirtieth of the rate."""
    table, ts, mass = load(), 1 / rate, 0.5
    crossover = 2 * np.pi * rate / 30
    pid = PID(0.5 * mass * crossover**2, 0.05 * mass * crossover**3, mass * crossover, 0.0)
    return replace(
        table,
        name="leg",
        plant=Plant(1.5 * ts, 1.0, (Mode(1 / mass, 0.0, 0.0),)),
        friction=elements([300.0, 40.0], [1e-3, 1e-2]),  # slips at 0.7 N
        control=replace(table.control, sample_time=ts, reference_delay=1, pid=pid),
        drive=replace(table.drive, rated_thrust=60.0, offset=0.0),
        scale=replace(table.scale, resolution=1e-3, noise=3e-4),
        presliding=FROM_ELEMENTS,
        published=None,
        sources={},
    )


def moved(machine: Machine, seed: int = 0, count: int = 1900) -> Record:
    """Strokes of 0.2 and 0.5 m to and fro in 0.4 or 0.8 s, each followed by a rest."""
    second = 1 / machine.sample_time
    draw, path = np.random.default_rng(seed), [np.zeros(30)]
    while sum(map(len, path)) < count:
        share = np.linspace(0, 1, round(draw.choice([0.4, 0.8]) * second))
        sign = -1 if path[-1][-1] > 0.2 else 1
        stroke = sign * draw.choice([0.2, 0.5]) * share**3 * (10 - 15 * share + 6 * share**2)
        path += [path[-1][-1] + stroke, np.full(round(0.4 * second), path[-1][-1] + stroke[-1])]
    return simulate(machine, machine.feedback_only(), np.concatenate(path)[:count], seed=seed).record
