"""What is proposed where nothing has a name: an experiment over the coordinate that tells, and none twice."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.experiments import propose
from diagnosis.experiments.information import information_of
from diagnosis.experiments.menu import menu
from diagnosis.experiments.propose import Proposal, along, next_experiment, showing, virtual
from diagnosis.experiments.schedules import suite
from diagnosis.experiments.within_limits import Bounds, experiments
from models.machine import load
from models.records.record import Record
from models.simulation.simulator import simulate
from tests.diagnosis.test_flexure import FILE as FLEXURE

MACHINE = load()


def _asked(coordinate: str | None, records: list[Record]) -> Proposal:
    found = along(coordinate, MACHINE, records)
    assert found is not None
    return found


@pytest.mark.parametrize(("coordinate", "says"), [("position", "long strokes"), ("velocity", "a speed ladder")])
def test_what_was_run_is_not_asked_for_again(coordinate: str, says: str) -> None:
    """A rail's joint: the same long strokes had been asked for with their own record on the table."""
    first = _asked(coordinate, [])
    assert f"Run, two times over, {says}" in first.sentence
    _, record = virtual(MACHINE, first.schedule)
    second = _asked(coordinate, [record])
    assert says not in second.sentence
    assert ", and the records have the motions that vary it. Run one stroke" in second.sentence
    _, repeated = virtual(MACHINE, second.schedule)
    assert _asked(coordinate, [repeated]).sentence == first.sentence
    assert along(coordinate, MACHINE, [record, repeated]) is None


@pytest.mark.parametrize(
    ("coordinate", "says"), [("time", "a hold"), ("dwell", "a dwell sweep"), ("acceleration", "a multisine")]
)
def test_what_a_kind_of_motion_does_not_tell_is_asked_for(coordinate: str, says: str) -> None:
    """The rests, or the excitation, of motions of one kind may all be alike."""
    first = _asked(coordinate, [])
    assert f"Run, two times over, {says}" in first.sentence
    _, record = virtual(MACHINE, first.schedule)
    assert _asked(coordinate, [record]).sentence == first.sentence


def test_without_a_coordinate_it_is_asked_whether_the_force_repeats() -> None:
    assert "and no single coordinate explains the residual. Run one stroke" in _asked(None, []).sentence


def test_what_is_asked_of_an_axis_on_a_stated_spring_is_within_its_thrust() -> None:
    """Strokes of 6 mm on a flexure would have taken 2650 N of a drive of 72 N."""
    wide = Bounds(6e-3, FLEXURE.drive.rated_speed, FLEXURE.drive.rated_thrust)
    for one in [*(found.schedule for found in (*menu(FLEXURE), *experiments(FLEXURE, wide))), suite(FLEXURE)]:
        record = simulate(FLEXURE, FLEXURE.feedback_only(), one.target, given=one.given, seed=0).record
        assert np.abs(record.command).max() < FLEXURE.drive.rated_thrust, one.name
        assert np.abs(record.position - record.reference).max() < 0.2 * max(np.ptp(record.reference), 1e-6), one.name


def test_experiments_are_of_the_machine_with_what_its_file_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hardening spring, which goes beside a stated one, ended in a KeyError."""
    (long,) = (one for one in menu(FLEXURE) if "position" in one.coordinates)
    fitted, record = virtual(FLEXURE, long.schedule)
    assert set(fitted.candidate.effects) == set(FLEXURE.effects)
    far = np.abs(record.reference).max()
    held = record.command[record.reference > 0.9999 * far].mean()
    assert held == pytest.approx(sum(one.spring_to_ground() for one in FLEXURE.effects) * far, rel=0.1)
    (told,) = information_of(FLEXURE, [long], ("hardening_spring", "thrust_fall_off"))
    assert np.all(np.diag(told.distance) > 40)
    monkeypatch.setattr(propose, "menu", lambda _: (long,))
    for found in (next_experiment(["hardening_spring"], FLEXURE), showing(["thrust_fall_off"], FLEXURE)):
        assert found is not None
        assert "Run long strokes of 1.88 mm" in found.sentence
