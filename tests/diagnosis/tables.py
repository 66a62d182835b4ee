"""Simulated tables for the tests of the diagnosis: short schedules, nominal values off by their tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.experiments.schedules import (
    Schedule,
    amplitude_ladder,
    dwell_sweep,
    multisine,
    sequence,
    strokes,
    together,
)
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parameters import applied, bounded, parameters
from diagnosis.model.residual import Candidate
from models.controller import Controller, References
from models.effects.base import Effect
from models.effects.base import parameters as ranges_of
from models.effects.catalogue import SIZES, every, in_order
from models.effects.priors import Priors
from models.friction import deflections
from models.machine import Machine, load
from models.records.record import Record
from models.simulation.simulator import simulate

LEAD = 0.5  # s of rest before a record


def table() -> Machine:
    """The paper's table with a scale that is as noisy as a good one."""
    machine = load()
    return replace(machine, scale=replace(machine.scale, resolution=1e-7, noise=3e-8))


def asking(machine: Machine) -> Machine:
    """The machine whose file asks for the effects that are not common, with the sizes that they have elsewhere; not
    for gravity, which only a rotary axis has, nor for what goes with a stated spring (test_flexure.py)."""
    stated = {
        (name, item.name): (item.low, item.high)
        for name, kind in every().items()
        for item in ranges_of(kind)
        if "linear" not in kind.common_on and name != "gravity" and not kind.beside and item.role in SIZES
    }
    return replace(machine, priors=Priors.of(stated))


def short(machine: Machine) -> Schedule:
    """Some of everything in twelve seconds."""
    return together(
        "short",
        [
            amplitude_ladder(machine, (5e-6, 20e-6, 100e-6)),
            dwell_sweep(machine, (0.06, 0.3, 0.9)),
            multisine(machine, duration=1.5),
            strokes(machine, 2e-3, (0.01,)),
            strokes(machine, 45e-3, (0.2,), passes=2),
        ],
    )


def schedules(machine: Machine) -> tuple[Schedule, ...]:
    """One pass of the sequence, and some of everything."""
    return sequence(machine, repeats=1), short(machine)


def left_by_moves(limit: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Displacements (N,) [m] of elements with limits (N,) [m] after a dozen moves of some micrometres and more."""
    path = np.concatenate([[0.0], 2e-5 * np.cumsum(rng.standard_t(2, 12))])
    return np.asarray(deflections(limit, path)[-1])


def off_by(machine: Machine, rng: np.random.Generator, wrong: float = 1.0) -> Machine:
    """The table with nominal values that are off by `wrong` times their tolerances [1]."""
    layout = parameters(machine, 1)
    theta = bounded(layout, wrong * layout.deviation * np.clip(rng.standard_normal(layout.count), -2, 2))
    return applied(layout, theta)


def recorded(
    machine: Machine, plan: Sequence[Schedule], effects: Sequence[Effect] = (), *, seed: int, wrong: float = 1.0
) -> tuple[Record, ...]:
    """Records of a table whose nominal values are off by `wrong` times their tolerances [1], with effects."""
    rng = np.random.default_rng(seed)
    truth = replace(off_by(machine, rng, wrong), effects=tuple(effects))
    limit = np.array(truth.friction.limit)
    control = machine.control
    controller = Controller(machine.sample_time, control.pid, control.reference_delay, (1.0,), (0.0,))
    lead = np.zeros(round(LEAD / machine.sample_time))
    made = []
    for i, schedule in enumerate(plan):
        signals = (schedule.given.position, schedule.given.feedforward, schedule.given.compensation)
        given = References(*(np.concatenate([lead, signal]) for signal in signals))
        run = simulate(
            truth,
            controller,
            np.concatenate([lead, schedule.target]),
            given=given,
            seed=100 * seed + i,
            initial_friction=left_by_moves(limit, rng),
        )
        made.append(run.record.last(schedule.target.size))
    return tuple(made)


def nominal_with(machine: Machine, effects: Sequence[Effect], records: Sequence[Record]) -> Fit:
    """The model at its nominal values with effects in it, nothing fitted."""
    layout = parameters(machine, 1)
    return fit(Candidate(layout, np.zeros(layout.count), in_order(effects)), records, iterations=0, walk=4e-3)


def fitted_with(fitted: Fit, effect: Effect, records: Sequence[Record]) -> Fit:
    """The fit with one effect more, everything re-fitted."""
    candidate = replace(fitted.candidate, effects=in_order((*fitted.candidate.effects, effect)))
    return fit(candidate, records, paths=fitted.paths, iterations=8, walk=fitted.walk)
