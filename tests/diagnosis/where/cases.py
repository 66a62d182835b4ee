"""Short records of the default table with one thing in it that the model lacks, and the nominal fit to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import scipy.signal

from diagnosis.experiments import schedules as experiments
from diagnosis.experiments.schedules import Schedule
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.start_states import static_equilibrium_start
from models.controller import Controller
from models.effects.base import Effect
from models.effects.catalogue import every
from models.machine import Machine, load
from models.records.record import Record
from models.simulation.simulator import simulate

WIND = 3.0  # N rms
CALMS = 1.0  # s, after which it has forgotten itself


@cache
def table() -> Machine:
    """The default machine with noise on its scale."""
    machine = load()
    return replace(machine, scale=replace(machine.scale, noise=3e-8))


def schedules(machine: Machine) -> tuple[Schedule, ...]:
    """Two short records: the sequence once, and moves of several sizes with dwells, twice."""
    moves = experiments.together(
        "moves",
        [
            experiments.dwell_sweep(machine, (0.1, 0.4)),
            experiments.strokes(machine, 20e-3, (0.12,), passes=2),
            experiments.strokes(machine, 2e-3, (0.01,)),
        ],
    )
    return experiments.sequence(machine, 1), moves


def run(machine: Machine, effects: Sequence[Effect], given: Sequence[Schedule], seed: int = 3) -> tuple[Record, ...]:
    """The schedules on the machine with these effects; forces in [N]."""
    control = machine.control
    controller = Controller(machine.sample_time, control.pid, control.reference_delay, (1.0,), (0.0,))
    real = replace(machine, effects=tuple(effects))
    return tuple(
        simulate(real, controller, one.target, given=one.given, seed=seed + i).record for i, one in enumerate(given)
    )


def fitted(machine: Machine, records: Sequence[Record]) -> Fit:
    """The nominal parameters fitted in two rounds from the truth: a quick stand-in for the whole re-fit."""
    layout = parameters(machine, len(records))
    found = fit(Candidate(layout, static_equilibrium_start(layout, records)), records, iterations=2, walk=0.125)
    return fit(found.candidate, records, paths=found.paths, iterations=1, walk=0.05)


@cache
def case(name: str) -> tuple[tuple[Record, ...], Fit]:
    """Records with the named effect at its typical size, or with nothing for "", and the fit to them."""
    effects = (every()[name].typical(),) if name else ()
    records = run(table(), effects, schedules(table()))
    return records, fitted(table(), records)


def fine() -> Machine:
    """The same with a scale so fine that a wind leaves hundreds of times what it promises."""
    machine = table()
    return replace(machine, scale=replace(machine.scale, noise=5e-9, resolution=5e-9))


@cache
def still() -> tuple[Record, ...]:
    """Its records without wind."""
    return run(fine(), (), schedules(fine()))


def blown(records: Sequence[Record], seed: int) -> list[Record]:
    """The records with commands that lack a wind: to the model it is a force that the table had beside them."""
    draw, found = np.random.default_rng(seed), []
    for record in records:
        keep = np.exp(-record.sample_time / CALMS)
        white = draw.standard_normal(record.position.size + 4000)
        wind = WIND * scipy.signal.lfilter([np.sqrt(1 - keep**2)], [1, -keep], white)[4000:]
        found.append(replace(record, command=record.command - wind))
    return found


@cache
def windy(seed: int) -> tuple[list[Record], Fit]:
    """Its records with a wind of this seed, and the fit to them."""
    records = blown(still(), seed)
    return records, fitted(fine(), records)
