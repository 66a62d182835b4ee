"""A machine file with too few friction elements for its scale: they are halved, and nothing else is blamed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.friction_compensation import simplify
from diagnosis.baseline import refit_and_null
from diagnosis.diagnose import diagnosed
from diagnosis.experiments.schedules import amplitude_ladder, sequence
from diagnosis.friction_curve import curve_gain, halved, with_finer_friction
from diagnosis.improved import improved_machine
from diagnosis.model.fit import Fit
from diagnosis.records.motions import numbered, pieces
from diagnosis.records.units import loop_time, with_units
from diagnosis.refit import within_rating
from diagnosis.verdict import Outcome
from models.effects.base import Effect
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging
from models.friction import branch, elements, follow
from models.machine import FROM_ELEMENTS, Machine, load
from models.machine_file import to_toml
from models.machines.provenance import Provenance
from models.records.record import Record
from tests.diagnosis.tables import recorded

FEW = 4  # elements of the coarse file


def fine(count: int) -> Machine:
    """The paper's table with a scale of a nanometre and a friction of many elements, stiff at first, soft at last."""
    machine, limits = load(), np.geomspace(1e-6, 60e-6, count)
    stiffness = limits**-1.4
    stiffness *= machine.friction.coulomb_force / float(stiffness @ limits)
    scale = replace(machine.scale, resolution=1e-9, noise=3e-10)
    return replace(machine, scale=scale, friction=elements(stiffness, limits))


TRUTH = fine(24)
COARSE = replace(TRUTH, friction=simplify(TRUTH.friction, FEW))
PLAN = (sequence(TRUTH, repeats=1), amplitude_ladder(TRUTH, (2e-6, 5e-6, 20e-6, 60e-6, 150e-6)))


def test_elements_that_are_far_apart_have_halves_that_a_file_may_state(tmp_path: Path) -> None:
    """Two elements whose limits differ by a factor of 200: a deviation of half of that on the logarithm is 2.6."""
    wide = replace(TRUTH, friction=elements([1e6, 1e4], [1e-6, 2e-4]), presliding=FROM_ELEMENTS)
    path = tmp_path / "halved.toml"
    path.write_text(to_toml(halved(wide, float(np.log(200.0)))), encoding="utf-8")
    assert load(path).friction.limit == (1e-6, 1e-6, 2e-4, 2e-4)


def refitted(machine: Machine, records: tuple[Record, ...]) -> tuple[Fit, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    known = with_units(machine, records)
    return within_rating(known, records), numbered(pieces(records, loop_time(known)), records)


@pytest.fixture(scope="module")
def records() -> tuple[Record, ...]:
    return recorded(TRUTH, PLAN, seed=3, wrong=0.0)


@given(st.lists(st.floats(-1e-4, 1e-4), min_size=1, max_size=30))
def test_halves_act_as_the_elements_did(turns: list[float]) -> None:
    path = np.concatenate([[0.0], turns])
    twice = halved(COARSE, 0.5)
    assert len(twice.friction.limit) == 2 * FEW
    assert follow(twice.friction, path)[0] == pytest.approx(follow(COARSE.friction, path)[0], rel=1e-12, abs=1e-12)


def test_deviations_stay_with_their_elements() -> None:
    source = Provenance("identified", "a record", std=(4.0, 3.0, 2.0, 1.0))
    given_ = replace(COARSE, sources={"friction.stiffness": source, "friction.limit": source})
    found = halved(given_, 0.5).sources
    assert found["friction.stiffness"].std == (2.0, 2.0, 1.5, 1.5, 1.0, 1.0, 0.5, 0.5)
    assert found["friction.limit"].std == (4.0, 4.0, 3.0, 3.0, 2.0, 2.0, 1.0, 1.0)


def test_what_deviations_have_in_common_stays_with_their_elements(tmp_path: Path) -> None:
    """As in an improved.toml, which could not be diagnosed against: a list of four beside eight numbers."""
    rows = ((0.6, 0.8), (0.5, 0.0), (0.0, 0.3), (0.1, 0.2))
    source = Provenance("identified", "a record", std=(4.0, 3.0, 2.0, 1.0), shares=rows)
    twice = halved(replace(COARSE, sources={"friction.stiffness": source, "friction.limit": source}), 0.5)
    assert twice.sources["friction.limit"].shares == tuple(row for row in rows for _ in range(2))
    path = tmp_path / "halved.toml"
    path.write_text(to_toml(twice), encoding="utf-8")
    assert load(path).sources["friction.stiffness"].shares == twice.sources["friction.stiffness"].shares


def test_a_file_with_too_few_elements_gets_more_and_its_curve_comes_nearer(records: tuple[Record, ...]) -> None:
    fitted, segment = refitted(COARSE, records)
    found = with_finer_friction(fitted, records, segment)
    assert len(found.candidate.machine.friction.limit) >= 2 * FEW
    chi = [float(one.innovations @ one.innovations) / one.innovations.size for one in (fitted, found)]
    assert chi[0] > 10.0
    assert chi[1] < 0.25 * chi[0]
    distance = np.geomspace(1e-6, 1.2e-4, 60)
    true = branch(TRUTH.friction, distance)
    error = [float(np.std(branch(one.candidate.machine.friction, distance) - true)) for one in (fitted, found)]
    assert error[1] < 0.5 * error[0]


@pytest.mark.parametrize("effect", [None, Cogging(2.0, 4e-5, 0.3), ViscousFriction(60.0)])
def test_a_file_with_all_elements_keeps_them_whatever_else_is_wrong(effect: Effect | None) -> None:
    machine = fine(12)
    records = recorded(machine, PLAN, [effect] if effect else [], seed=3, wrong=0.0)
    fitted, segment = refitted(machine, records)
    if effect:
        assert float(fitted.innovations @ fitted.innovations) > 3.0 * fitted.innovations.size
    assert curve_gain(fitted, records, segment) < 0.3 * fitted.innovations.size


def test_what_is_handed_over_has_them_and_nothing_is_blamed(records: tuple[Record, ...]) -> None:
    found = diagnosed(refit_and_null(COARSE, records))
    assert found.outcome in {Outcome.PARAMETERS, Outcome.NONE}  # sixteen elements leave a little of the curve of 24
    assert (found.partly, found.effects) in [((), ()), ((), ("presliding_stiffness",))]
    assert found.baseline.delivered.friction == COARSE.friction
    better = improved_machine(found)
    assert len(better.friction.limit) >= 2 * FEW
    assert better.tolerance == COARSE.tolerance
    terms = found.how_far.terms
    assert terms.refitted < 0.3 * terms.delivered
