"""The design beside the feedback that runs already: the same motions, its own reference, a warning where it wins."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from design.controller import bare_controller, default_controller
from design.validation import sequence, validate
from models.machine import load
from models.records.record import motions
from models.simulation.simulator import simulate
from studies.catalogue import STUDIES
from studies.deadbeat_design.in_place import beside_in_place, in_place_row
from tests.studies.test_feedbacks import machine


def test_the_feedback_in_place_takes_its_reference_as_the_file_says() -> None:
    """A cascade with a feedforward of its own: settled as its simulation with the target as reference settles."""
    table = machine()
    judged = validate(table, default_controller(table))
    found = beside_in_place(table, judged, table.specification.stroke, 0)
    target = sequence(table, None, judged.periods)
    response = simulate(table, table.feedback_only(), target)
    last = motions(target)[-len(judged.achieved) :]
    for motion, settled in zip(last, found["settling_s"], strict=True):
        off = abs(response.position[motion.start : motion.stop] - motion.target) > table.specification.tolerance
        late = max((at for at, outside in enumerate(off) if outside), default=-1)
        assert settled == pytest.approx((late + 1) * table.sample_time, abs=1.5 * table.sample_time)
    without = replace(table, control=table.control.without_feedforward())
    assert beside_in_place(without, judged, table.specification.stroke, 0)["settling_s"] != found["settling_s"]


def test_a_design_that_meets_its_specification_is_no_warning_where_a_step_is_sooner() -> None:
    table = load()
    judged = validate(table, default_controller(table))
    found = beside_in_place(table, judged, table.specification.stroke, 0)
    assert found["median_s"] < found["design_median_s"] < table.specification.settling_time
    assert found["slowest_s"] > table.specification.settling_time
    assert found["later"] == []
    assert not in_place_row(found)[0].startswith("WARNING")


def test_a_design_that_settles_later_than_what_runs_already_is_a_warning() -> None:
    """A feedforward whose thrust is turned: its motions begin in the wrong direction."""
    table = load()
    bare = bare_controller(table)
    turned = replace(bare, d_ff=tuple(-40 * one for one in bare.d_ff))
    found = beside_in_place(table, validate(table, turned), table.specification.stroke, 0)
    assert found["later"] == ["slowest", "median"]
    name, said = in_place_row(found)
    assert name.startswith("WARNING")
    assert "do not put this design in its place" in said


def test_one_that_never_settles_is_told_so() -> None:
    found = {"slowest_s": math.inf, "median_s": 0.1, "design_slowest_s": math.inf, "design_median_s": 0.3}
    assert "slowest motion never, median 100 ms" in in_place_row({**found, "later": []})[1]
    assert "this design never and 300 ms" in in_place_row({**found, "later": ["median"]})[1]


def test_the_study_tells_it() -> None:
    answer = STUDIES.deadbeat_design(load(), quick=True)
    found = answer.results["in_place"]
    assert len(found["settling_s"]) == len(answer.results["with"]["motions"])
    assert in_place_row(found) in answer.summary
