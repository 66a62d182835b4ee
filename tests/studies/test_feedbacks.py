"""Studies on a machine whose feedback is a cascade with filters: what each keeps of it, and what it says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from design.controller import default_controller
from design.family import family
from design.pid.front import assessed_point
from diagnosis.where.controller import replayed
from models.controller import load as load_controller
from models.machine import Machine, load
from models.machine_file import to_toml
from models.simulation.simulator import simulate
from studies.catalogue import STUDIES
from studies.identify_machine.own_records import motions
from studies.options import BadInputError
from studies.pid_tradeoff.rows import nonsmooth, point_row
from studies.study import machine_for
from tests.models.feedback.axis import CASCADE, FILTERS, axis


def machine() -> Machine:
    table = axis(filters=FILTERS)
    specification = replace(table.specification, settling_time=12e-3, reference_settling_time=8e-3, interval=0.2)
    return replace(table, specification=specification, drive=replace(table.drive, offset=0.0))


def test_a_deadbeat_design_says_that_the_feedback_is_kept_and_writes_its_law(tmp_path: Path) -> None:
    table = machine()
    answer = STUDIES.deadbeat_design(table, quick=True)
    assert all(check.holds for check in answer.checks)
    kept = table.control.without_feedforward().in_words
    assert answer.results["feedback"] == kept
    assert "feedforward" not in kept
    assert ("feedback kept, its reference entering as the position does", kept) in answer.summary
    path = tmp_path / "controller.json"
    path.write_text(json.dumps(answer.files["controller.json"]), encoding="utf-8")
    controller = load_controller(path)
    assert controller == default_controller(table)
    assert controller.law is not None
    with pytest.raises(
        BadInputError, match=r"controller\.json: its feedback is not a plain PID; state it in the machine"
    ):
        STUDIES.deadbeat_design(table, controller=path, quick=True)


def test_a_study_that_designs_around_a_pid_refuses_another_feedback() -> None:
    with pytest.raises(BadInputError, match=r"^--machine: a P/PI cascade with 85 1/s, .* designs around a plain PID"):
        STUDIES.trajectory_optimisation(machine(), quick=True)


def test_the_trade_off_judges_the_loop_that_is_stated() -> None:
    table = machine()
    members = family(table, 0.0, 0.0)
    present, pid = (assessed_point("present", table.control.pid, members, law) for law in (table.control.law, None))
    runs = nonsmooth(table, default_controller(table), (present, pid))
    stated, other = (point_row(table, members, *one) for one in zip((present, pid), runs, strict=True))
    assert stated["feedback"] == table.control.in_words
    assert other["feedback"] is None
    assert stated["kp_N_per_m"] == other["kp_N_per_m"]  # of the nearest PID, as the report says
    assert stated["ms"] == max(loop.ms.value for loop in present.loops)
    assert abs(stated["ms"] / other["ms"] - 1) > 0.01  # the filters' lag is in it
    assert stated["settling_s"] != other["settling_s"] or stated["noise_N"] != other["noise_N"]


def test_a_machine_file_with_a_cascade_is_used_as_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "axis.toml"
    path.write_text(to_toml(machine()), encoding="utf-8")
    study = STUDIES.deadbeat_design
    assert machine_for(study.options(machine=path))[0].control == machine().control


def test_the_records_that_are_identified_are_made_by_the_law_that_is_replayed() -> None:
    """The deadbeat's form of the cascade would make others, with which the fit of a motion diverges."""
    table = machine()
    record = motions(table, 0)
    assert replayed(table, record).replays
    assert not replayed(table, simulate(table, default_controller(table), record.target).record).replays


def test_a_cascade_that_a_program_puts_in_a_machine_goes_into_its_file_alone(tmp_path: Path) -> None:
    table = load().with_part("control.cascade", CASCADE, {})
    path = tmp_path / "table.toml"
    path.write_text(to_toml(table), encoding="utf-8")
    assert load(path).control == table.control
    assert "[control.pid]" not in to_toml(table)
