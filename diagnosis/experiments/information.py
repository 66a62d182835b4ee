"""What each experiment would tell, computed before any is run: by effect, by pair of effects, by nominal parameter.

Every experiment is run once on the nominal machine by simulation. Along its path an effect of its usual size changes
the whitened innovations by a column; with the nominal parameters taken out within their priors, squared lengths and
distances of these columns are the chi-square by which the right effect would win (confusability.py). What one record
tells adds to what others do: each minimum is over parameters that all records share, so that the sum is no more than
what they tell together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.experiments.confusability import distances, products
from diagnosis.experiments.menu import Experiment
from diagnosis.experiments.propose import virtual
from diagnosis.model.fit import Fit
from diagnosis.model.parallel import on_single_blas_thread, parallel_map
from diagnosis.records.units import with_units
from models.effects.priors import Priors
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

FOLLOWS: Final = 0.5  # of the way: further off its reference a simulated machine does not follow


@dataclass(frozen=True)
class ExperimentInformation:
    """What one experiment tells in so many seconds [s]: distance (E, E), the squared distance [1] of each effect at its
    usual size from the nominal parameters (diagonal), and from the best fit by another; parameters (P, P), the
    information [1] on the nominal parameters, counted in their priors."""

    experiment: Experiment
    seconds: float
    distance: Array
    parameters: Array


@on_single_blas_thread
def information_of(
    machine: Machine, found: Sequence[Experiment], names: Sequence[str], seed: int = 0
) -> tuple[ExperimentInformation, ...]:
    """What each experiment tells on effects of these names [1]; without those in which the simulated machine does not
    follow its reference."""
    known = replace(machine, priors=usual_sizes(machine, found))
    each = parallel_map(lambda one: _information_of(known, one, names, seed), found)
    return tuple(one for one in each if one is not None)


def usual_sizes(machine: Machine, found: Sequence[Experiment]) -> Priors:
    """The usual sizes of effects along these experiments' ways [SI], so that in all of them an effect is the same."""
    return with_units(machine, [_asked(machine, one) for one in found]).priors


@on_single_blas_thread
def told_by(fitted: Fit, records: Sequence[Record], names: Sequence[str], sizes: Priors) -> Array:
    """What records that there are tell, by the fit of the nominal machine to them: (E, E) [1], as the distance of
    ExperimentInformation, of effects of these names and usual sizes."""
    layout = fitted.candidate.layout
    sized = replace(layout, machine=replace(layout.machine, priors=sizes))
    along = replace(fitted, candidate=replace(fitted.candidate, layout=sized))
    return distances(products(along, records, names, usual_only=True), tuple(names)) ** 2


def _information_of(machine: Machine, one: Experiment, names: Sequence[str], seed: int) -> ExperimentInformation | None:
    try:
        fitted, record = virtual(machine, one.schedule, seed)
    except ArithmeticError:
        return None
    span = float(np.ptp(record.reference)) or machine.specification.stroke
    if not np.abs(record.position - record.reference).max() <= FOLLOWS * span:
        return None
    squared = distances(products(fitted, [record], names, usual_only=True), tuple(names)) ** 2
    layout = fitted.candidate.layout
    kept = np.flatnonzero(np.array(layout.names) != "initial_friction_state")
    starts = np.setdiff1d(np.arange(layout.count), kept)
    whole = (fitted.slopes * layout.deviation).T @ (fitted.slopes * layout.deviation)
    free = np.linalg.solve(whole[np.ix_(starts, starts)] + np.eye(starts.size), whole[np.ix_(starts, kept)])
    information = whole[np.ix_(kept, kept)] - whole[np.ix_(kept, starts)] @ free
    return ExperimentInformation(one, record.position.size * machine.sample_time, squared, information)


def _asked(machine: Machine, one: Experiment) -> Record:
    """The references of an experiment as a record of which nothing else is known."""
    nothing, given = np.zeros(one.schedule.target.size), one.schedule.given
    return Record(machine.sample_time, one.schedule.target, given.position, given.feedforward, nothing, nothing)
