"""`python -m tests.kernels`: compiles the kernels that most tests need, before several processes would each do so.

What is compiled lies beside the sources from then on, where every later process finds it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from diagnosis.experiments.schedules import strokes
from diagnosis.model.fit import fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.start_states import search, static_equilibrium_start
from diagnosis.records.motions import numbered, pieces
from diagnosis.which.detectors.scan import partial_out, scan
from models.deployment.coefficients import load_coefficients
from models.deployment.running_law import RunningLaw
from models.simulation.simulator import simulate, simulate_many
from studies.blind_trial.sealer import nominal, schedule
from studies.blind_trial.sealer.distance import contact_force, innovations
from studies.blind_trial.sealer.machines import motions
from studies.blind_trial.sealer.machines.drawing import draw_axis
from studies.blind_trial.sealer.machines.simulation import simulate as simulate_drawn
from studies.blind_trial.sealer.simulate import simulate as simulate_table
from tests.diagnosis.tables import recorded, table
from tests.models.deployment.laws import written
from tests.models.effects.laws import laws


def run_all() -> None:
    """Simulated motions without and with every law, the diagnosis of a record up to the scan, the law of a drive,
    and the sealers' motions: all as short as can be."""
    machine = table()
    controller, rest = machine.feedback_only(), np.zeros(8)
    simulate(machine, controller, rest)
    simulate_many([machine, machine], [controller, controller], rest)
    for effect in laws().values():  # each law is compiled by itself, the loop that calls them once
        simulate(replace(machine, effects=(effect,)), controller, rest)
    records = recorded(machine, [strokes(machine, 2e-3, (0.02,))], seed=0)
    layout = parameters(machine, 1)
    start = fit(Candidate(layout, static_equilibrium_start(layout, records)), records, iterations=1, walk=0.125)
    fitted = fit(search(start, records), records, paths=start.paths, iterations=1, walk=0.05)
    scan(fitted, records, partial_out(fitted, numbered(pieces(records), records)), ())
    with TemporaryDirectory() as folder:
        RunningLaw(load_coefficients(written("learning", Path(folder)), math.nan, math.nan))
    _simulate_sealed()


def _simulate_sealed() -> None:
    """The table of the sealed cases, and a drawn machine: pushed for a few samples."""
    few = np.zeros(50)
    simulate_table(nominal.load(), schedule.Schedule(few, few, few), 1, exact=True)
    simulate_drawn(draw_axis(np.random.default_rng(1))[0], motions.Schedule(few, few, few, ()), 1, None, exact=True)
    contact_force(few[:, np.newaxis], np.ones(2), np.ones(2), np.zeros(2))
    innovations(np.eye(2), np.ones(2), np.ones(2), np.zeros(2), few, few)


if __name__ == "__main__":
    run_all()
