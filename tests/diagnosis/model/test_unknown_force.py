"""The unknown force that a fit leaves, and what a search leaves open: the start of a contact that never slips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.model.fit import fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.unknown_force import force_left, unknown_less_mean, unknown_less_means
from models.effects.structure import AdditionalMode
from tests.diagnosis.tables import recorded, table


def test_a_constant_force_of_each_record_is_left_out() -> None:
    machine = table()
    plan = [amplitude_ladder(machine, (5e-6, 20e-6))] * 2
    records = recorded(machine, plan, seed=3, wrong=0.0)
    fitted = fit(Candidate(parameters(machine, 2), np.zeros(parameters(machine, 2).count)), records)
    theta, layout = fitted.candidate.theta.copy(), fitted.candidate.layout
    stiffness, limit = (np.array(one) for one in (machine.friction.stiffness, machine.friction.limit))
    longest = int(np.argmax(limit))
    assert limit[longest] > 4 * 20e-6  # it holds both ways, from where the records began
    starts = layout.of("initial_friction_state").reshape(2, -1)[:, longest]
    theta[starts[0]] -= 0.2 * limit[longest] * np.sign(theta[starts[0]])  # away from its limit
    moved = replace(fitted, candidate=replace(fitted.candidate, theta=theta))

    apart = 0.2 * stiffness[longest] * limit[longest]
    assert apart > 10 * force_left(fitted, records)
    half = records[0].position.size
    between = []  # the two records' means, with the start where the fit had left it and where it is now
    for given in (fitted, moved):
        one, used = unknown_less_mean(given, records)
        between.append(np.mean(one[:half][used[:half]]) - np.mean(one[half:][used[half:]]))
    assert abs(between[1] - between[0]) > 0.8 * apart
    one, used = unknown_less_means(moved, records)
    start = 0
    for record in records:
        part = slice(start, start + record.position.size)
        assert abs(np.mean(one[part][used[part]])) < 1e-9 * apart
        start = part.stop
    assert force_left(moved, records) < 1.05 * force_left(fitted, records)


def test_a_mode_that_an_effect_adds_leaves_no_force_behind() -> None:
    """The bed of a heavy axis rocked at 18 Hz: named and sized rightly, its motion had stood in the force even so."""
    machine, mode = table(), AdditionalMode(0.002, 18.0, 0.04)
    plan = [together("moves", [strokes(machine, 2e-3, (0.02,), passes=2), strokes(machine, 45e-3, (0.2,), passes=2)])]
    rocking, still = (recorded(machine, plan, effects, seed=4, wrong=0.0) for effects in ([mode], []))
    layout = parameters(machine, 1)
    start = np.zeros(layout.count)
    left = {
        name: force_left(fit(Candidate(layout, start, effects), records), records)
        for name, effects, records in (("without", (), rocking), ("with", (mode,), rocking), ("floor", (), still))
    }
    assert left["without"] > 4 * left["floor"]
    assert left["with"] < 2 * left["floor"]
