"""The fit behind a machine file, on a simulated axis with one friction element: its offset, and values at bounds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.experiments.schedules import strokes
from diagnosis.handover.files import judged_file, machine_of, starts_of
from diagnosis.handover.final_fit import finished
from diagnosis.how_far import errors_of
from diagnosis.model.at_bounds import at_bounds, freed, plant_at_bounds, roomier
from diagnosis.model.fit import Fit, bounds_of, fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate, smooth
from diagnosis.model.start_states import static_equilibrium_start
from diagnosis.records.units import with_units
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import in_order
from models.effects.structure import AdditionalMode
from models.machine import Machine, load
from models.records.record import Record
from tests.diagnosis.tables import recorded

AXIS = load(Path(__file__).parents[3] / "models" / "machines" / "emps.toml")


def _with_offset(shift: float) -> tuple[Machine, Record]:
    """The axis with another offset [N], and a record of it."""
    truth = replace(AXIS, drive=replace(AXIS.drive, offset=AXIS.drive.offset + shift))
    (record,) = recorded(truth, (strokes(AXIS, 20e-3, (0.1,)),), AXIS.effects, seed=1, wrong=0.0)
    return truth, record


def _searched(record: Record) -> Fit:
    """As the search fits: beside a force that walks."""
    layout = parameters(AXIS, 1)
    start = static_equilibrium_start(layout, [record])
    return fit(Candidate(layout, start, in_order(AXIS.effects)), [record], iterations=3)


def test_the_offset_is_found() -> None:
    truth, record = _with_offset(5.0)
    found = finished(_searched(record), [record])
    assert found.candidate.machine.drive.offset == pytest.approx(truth.drive.offset, abs=0.05)
    assert not found.widened


def test_a_value_at_its_bound_gets_twice_the_room_once() -> None:
    """Of 24 N, eight deviations of the tolerance: 34 N are found, and 60 N are said to be out of reach."""
    truth, record = _with_offset(34.0)
    found = finished(_searched(record), [record])
    assert "amplifier_offset" in [one.name for one in found.widened]
    assert found.at_bound == at_bounds(found.candidate) == ()
    assert found.candidate.machine.drive.offset == pytest.approx(truth.drive.offset, abs=0.05)
    _, record = _with_offset(60.0)
    found = finished(_searched(record), [record])
    assert "amplifier_offset" in [one.name for one in found.at_bound]


def test_a_value_that_stays_where_its_room_had_ended_is_at_its_bound() -> None:
    """A mode of 38 Hz had come to rest 10 % off, at the end of its room, and with twice the room it was at none."""
    _, record = _with_offset(34.0)
    found = finished(_searched(record), [record], iterations=0)
    assert "amplifier_offset" in [one.name for one in found.widened]
    assert "amplifier_offset" in [one.name for one in found.at_bound]


def test_a_value_of_the_plant_that_runs_on_is_followed() -> None:
    """It was changed without a note; a contact that does may stand in for any law, and stays."""
    truth, record = _with_offset(90.0)
    begun = _searched(record)
    assert [one.name for one in plant_at_bounds(begun.candidate)] == ["amplifier_offset"]
    found = freed(begun, [record])
    assert not plant_at_bounds(found.candidate)
    assert found.candidate.machine.drive.offset == pytest.approx(truth.drive.offset, abs=1.0)
    contacts = np.isin(found.candidate.layout.names, ["presliding_stiffness", "presliding_limit"])
    assert np.array_equal(found.candidate.layout.high[contacts], begun.candidate.layout.high[contacts])


def test_more_room_leads_no_mode_beyond_what_the_controller_samples() -> None:
    """A mode at the end of what is looked for got twice the room, twice: a file of 1.1 kHz at 2 kHz cannot be read."""
    _, record = _with_offset(0.0)
    layout = parameters(with_units(AXIS, [record]), 1)
    nyquist = 0.5 / AXIS.sample_time
    for _ in range(3):
        (item,) = (one for one in parameters_of(AdditionalMode, layout.machine.priors) if one.name == "frequency")
        most = bounds_of(item)[1]
        assert most < nyquist
        effects = in_order((*AXIS.effects, AdditionalMode(1e-3, most, 0.02)))
        candidate = Candidate(layout, static_equilibrium_start(layout, [record]), effects)
        assert ("additional_mode", "frequency") in [(one.part, one.name) for one in at_bounds(candidate)]
        roomy = roomier(fit(candidate, [record], iterations=1), [record])
        layout = roomy.candidate.layout
    judged_file(machine_of(AXIS, roomy.candidate), starts_of(roomy.candidate))


def test_the_file_keeps_the_machine_files_priors_and_leaves_no_constant_force() -> None:
    _, record = _with_offset(5.0)
    found = finished(_searched(record), [record])
    machine = machine_of(AXIS, found.candidate)
    assert machine.priors == AXIS.priors
    file = judged_file(machine, starts_of(found.candidate))
    left = errors_of(file.candidate, [record], smooth(file.candidate, [record])).gap()
    before = judged_file(AXIS, starts_of(found.candidate)).candidate
    delivered = errors_of(before, [record], smooth(before, [record])).gap()
    assert delivered.force == pytest.approx(5.0, rel=0.05)  # a constant counts
    assert left.force < 0.1
