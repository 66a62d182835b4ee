"""Simulated records of a table with an effect that its model lacks, for which the answer is known.

The table's nominal values are off by their tolerances, its friction starts in a random state, and its scale is noisy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.experiments import schedules as experiments
from diagnosis.experiments.schedules import Schedule
from diagnosis.model.parameters import bounded, parameters
from diagnosis.model.residual import Candidate
from diagnosis.null import simulated
from models.effects.base import Effect
from models.effects.friction_laws import FrictionRelaxation
from models.machine import Machine
from models.quantity import show
from models.records.record import Record
from studies.options import BadInputError


@dataclass(frozen=True)
class Made:
    """The machine to be diagnosed, the records, and the effect that is in them at its typical size."""

    machine: Machine
    records: tuple[Record, ...]
    effect: Effect


def made(machine: Machine, seed: int, *, quick: bool) -> Made:
    """Records of a table like the machine; quick: short ones."""
    known = replace(machine, effects=(), scale=machine.scale.noisy())
    effect = known.kinds[FrictionRelaxation.name].typical(known.priors)
    schedules = _schedules(known, quick=quick)
    layout = parameters(known, len(schedules))
    draw = np.random.default_rng([seed, 7])
    theta = bounded(layout, layout.deviation * np.clip(draw.standard_normal(layout.count), -2, 2))
    truth = Candidate(layout, theta, (effect,))
    records = tuple(simulated(truth, _template(known, one), i, 100 * seed + i) for i, one in enumerate(schedules))
    _require_followed(known, records)
    return Made(known, records, effect)


def _require_followed(machine: Machine, records: Sequence[Record]) -> None:
    """Raises BadInputError for records in which the table is further off its reference than it was to go."""
    for record in records:
        span, away = float(np.ptp(record.reference)), float(np.max(np.abs(record.position - record.reference)))
        if not away <= span:
            raise BadInputError(
                "--machine: the simulated table is up to "
                f"{show(away, 'm', 3)} off references over {show(span, 'm', 3)}: "
                f"its loop cannot follow them within drive.rated_thrust, {show(machine.drive.rated_thrust, 'N')}; give "
                "a stronger drive or slower gains, or records of the machine"
            )


def duration(*, quick: bool) -> float:
    """Of the records [s], about."""
    return 8.0 if quick else 55.0


def _schedules(machine: Machine, *, quick: bool) -> tuple[Schedule, ...]:
    if not quick:
        return experiments.sequence(machine), experiments.suite(machine)
    rest = experiments.pause(machine)
    near, most = experiments.length(machine, 0, 5, onward=2), experiments.length(machine, 0, 1000)
    # Of an axis whose strokes are long, no further than it goes while a motion settles.
    far = max(machine.specification.stroke, experiments.rounded(min(most, machine.drive.rated_speed * rest / 3)))
    speed = experiments.allowed(machine, far, experiments.rounded(0.15 * far / rest))
    short = [
        experiments.amplitude_ladder(machine, [experiments.rounded(part * near) for part in (0.05, 0.2, 1.0)]),
        experiments.dwell_sweep(machine, [experiments.rounded(times * rest) for times in (4, 20)]),
        experiments.strokes(machine, far, (speed,)),
    ]
    return (experiments.together("short suite", short),)


def _template(machine: Machine, planned: Schedule) -> Record:
    """The references of a schedule as a record whose measured signals are still empty."""
    nothing, given = np.zeros(planned.target.size), planned.given
    return Record(
        machine.sample_time,
        planned.target,
        given.position,
        given.feedforward + given.compensation,
        nothing,
        nothing,
    )
