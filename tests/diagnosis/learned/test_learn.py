"""A law without a name: learned, judged on types of motion that were not used, handed over or refused."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.closure import NoiseFloor, held_out_closure
from diagnosis.criteria import Criteria
from diagnosis.diagnose import Diagnosis, diagnosed, to_json
from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.handover.files import Content
from diagnosis.handover.final_fit import finished
from diagnosis.handover.gate import held_out
from diagnosis.handover.posterior import unexplained_force
from diagnosis.how_far import errors_of
from diagnosis.improved import improved_machine
from diagnosis.learned import curves_tried, learn
from diagnosis.learned.curves_tried import Curve, coordinate_values
from diagnosis.learned.learn import Learned, columns_of, in_the_model, learned, little_judged, objection
from diagnosis.learned.left_out import Choice, Judgement, summed
from diagnosis.model.fit import Fit
from diagnosis.model.roughness import variance_by_record
from diagnosis.model.unknown_force import unknown_less_mean
from diagnosis.null import Null
from diagnosis.records.motions import MotionKind, pieces
from diagnosis.records.units import loop_time, units, with_units
from diagnosis.refit import refit_within
from diagnosis.verdict import Outcome
from diagnosis.which.detectors.scan import partial_out
from diagnosis.which.stage import Stage
from models.effects.base import Effect
from models.effects.catalogue import looked_for
from models.effects.measured import Measured
from models.machine import from_table
from models.machine_file import to_toml
from models.records.record import Record
from tests.diagnosis.learned.outsiders import Brake, Bump, Joint, OneSided
from tests.diagnosis.tables import recorded, table
from tests.diagnosis.units import Change
from tests.diagnosis.where.cases import case

MACHINE = table()
BUMP = Bump(3.0, 9e-3, 2.5e-3)
PLAN = together(
    "places",
    [
        amplitude_ladder(MACHINE, (20e-6, 100e-6)),
        strokes(MACHINE, 20e-3, (0.2,)),
        strokes(MACHINE, 14e-3, (0.06,)),
        strokes(MACHINE, 30e-3, (0.1,)),
    ],
)

SPRING = OneSided(600.0, 12e-3, 1e-3)
NULL = Null(dict.fromkeys(looked_for(), (0.0,)), ((1.0,),), (5.0,))


@pytest.fixture(scope="module")
def baseline() -> Baseline:
    """Records of a table with the bump, without the simulation of what chance gains, as no effect is tried."""
    records = recorded(MACHINE, (PLAN,), [BUMP], seed=5)
    machine = with_units(MACHINE, records)
    return Baseline(refit_within(machine, records), records, pieces(records, loop_time(machine)), NULL)


@pytest.fixture(scope="module")
def found(baseline: Baseline) -> Diagnosis:
    return diagnosed(baseline, disabled=list(looked_for()))


@pytest.fixture(scope="module")
def floor(found: Diagnosis, baseline: Baseline) -> NoiseFloor:
    return held_out_closure(found.stages, baseline, 0).floor


@pytest.fixture(scope="module")
def shown(found: Diagnosis) -> Mapping[str, Any]:
    content: Mapping[str, Any] = to_json(found)["learned"]
    return content


def test_where_no_effect_fits_the_law_is_learned_with_its_coordinate(
    found: Diagnosis, shown: Mapping[str, Any]
) -> None:
    assert found.outcome is Outcome.NONE
    assert (shown["coordinate"], shown["unit"], shown["symmetry"]) == ("position", "m", "plain")
    knots, low, high = np.array(shown["knots"]), *np.array(shown["band"]).T
    truth = np.array([BUMP.force(knot) for knot in knots])
    assert np.array(shown["values"]) == pytest.approx(truth, abs=0.1 * BUMP.size)
    assert np.all((low <= shown["values"]) & (high >= shown["values"]))
    assert np.max(high - low) < 0.25 * BUMP.size


def test_it_closes_the_gap_on_types_of_motion_that_were_not_used(shown: Mapping[str, Any]) -> None:
    assert shown["closure"] > 0.9
    assert Criteria().learned_min_closure < shown["closure_interval"][0] <= shown["closure"]
    strokes_only = [one for one in shown["by_type"] if one["motions"].startswith("moves of 18 to 56 mm")]
    assert len(strokes_only) > 1
    assert all(one["closure"] > 0.8 and one["coordinate"] == "position" for one in strokes_only)
    assert shown["adopted"]
    assert shown["reason"] is None


def test_the_file_with_it_improves_the_closed_loop(found: Diagnosis) -> None:
    better = improved_machine(found, "a test")
    (law,) = better.effects
    assert isinstance(law, Measured)
    assert better.sources["effects.measured.force"].kind == "identified"
    assert from_table(tomllib.loads(to_toml(better)), Path("improved.toml")).effects == better.effects
    files = {file.name: file.held_out.gap() for file in found.how_far.handover.files}
    assert files["measured law"].force < 0.2 * files["re-fitted"].force
    assert files["measured law"].position < 0.6 * files["re-fitted"].position


def test_how_far_is_told_of_the_file_with_the_law(found: Diagnosis) -> None:
    """It was told of the search, which has no effect: of a gap that goes from 0.51 to 0.02 N, all was left."""
    told = to_json(found)
    far, terms = told["how_far"], told["how_far"]["closure_terms"]
    assert far["adopted_file"] == far["stages"][-1]["added"] == "measured law"
    assert far["gap_after"] == far["gap_improved"]
    files = {one["file"]: one["held_out"]["force_N"] for one in far["files"]}
    assert (terms["refitted"], terms["after"]) == (files["re-fitted"], files["measured law"])
    r, e, f = (terms[name] ** 2 for name in ("refitted", "after", "floor"))
    assert far["closure"] == pytest.approx((r - e) / (r - f))
    assert far["closure"] > 0.9
    assert far["closure_interval"][0] <= far["closure"] <= far["closure_interval"][1]
    assert told["verdict"]["unexplained_fraction"] == pytest.approx(1 - far["closure"])


def test_the_law_is_judged_on_motions_that_its_table_has_not_seen() -> None:
    """A curve through the noise of a healthy table: its table had been the same for all motions that were left out."""
    records = recorded(MACHINE, (PLAN,), [], seed=5)
    machine = with_units(MACHINE, records)
    nominal = refit_within(machine, records)
    healthy = Baseline(nominal, records, pieces(records, loop_time(machine)), NULL)
    time = np.concatenate([np.arange(one.position.size) * one.sample_time for one in records])
    knots = np.linspace(0.0, time[-1], 150)
    hats = np.column_stack([np.interp(time, knots, row) for row in np.eye(knots.size)])
    curve, kind = (
        Curve(Measured("time", tuple(knots), (0.0,) * knots.size), hats, np.ones(len(hats))),
        np.zeros(len(healthy.pieces), int),
    )
    projection = partial_out(nominal, healthy.segment)
    columns = columns_of(curve, nominal, healthy, projection)
    test = summed(curve, columns, projection.e, healthy.segment, kind, least=20.0)
    fitted, inside = in_the_model(Choice(test, 1e-6, 0.0), nominal, healthy)
    everything = np.ones(kind.size, bool)
    through = Learned(None, knots, knots, None, fitted, choice=inside)
    law = replace(through, law=through.fitted_to(everything, healthy))
    assert law.law in fitted.candidate.effects
    made, plain = finished(fitted, records), finished(nominal, records)
    without_law = held_out(plain, healthy).gap().force
    assert held_out(made, healthy).gap().force < 0.97 * without_law  # as it was
    assert held_out(made, healthy, law).gap().force >= 0.995 * without_law


def test_the_force_that_predictions_lack_is_that_of_the_file_which_is_handed_over(found: Diagnosis) -> None:
    """It had been asked of the search, whose last model has no law: the noise of the smoother was told as a force. And
    a file that leaves a force leaves none beside the white force that its own fit makes of it."""
    assert np.max(variance_by_record(found.final)) > Criteria().rough_variance
    assert unexplained_force(found) == ()
    handover = found.how_far.handover
    refitted = handover.named(Content.REFITTED)
    assert refitted is not None
    assert np.max(variance_by_record(refitted.fitted)) < Criteria().rough_variance
    without_law = replace(found, how_far=replace(found.how_far, handover=replace(handover, adopted=refitted)))
    (left,) = unexplained_force(without_law)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(refitted.gap.force, rel=1e-6)


def test_a_machine_that_has_it_has_no_gap_left(found: Diagnosis, baseline: Baseline) -> None:
    """The file is diagnosed as any: the law stays as it is, and all other values may move."""
    again = with_units(improved_machine(found, "a test"), baseline.records)
    fitted = refit_within(again, baseline.records)
    left = errors_of(fitted.candidate, baseline.records, fitted.paths).gap()
    assert left.force < 2 * found.how_far.floor.force


def test_the_same_machine_in_other_units_learns_the_same_law(
    baseline: Baseline, floor: NoiseFloor, found: Diagnosis
) -> None:
    change = Change(force=1 / 40, length=3.0, time=0.5)
    records = tuple(map(change.record, baseline.records))
    machine = with_units(change.machine(MACHINE), records)
    cut = pieces(records, loop_time(machine))
    told = replace(floor, innovations=tuple(change.length * one for one in floor.innovations))
    nominal = refit_within(machine, records)
    there = learned(nominal, told, Baseline(nominal, records, cut, NULL))
    here = found.learned
    assert here is not None
    assert here.law is not None
    assert there.law is not None
    assert (there.law.coordinate, there.law.symmetry) == (here.law.coordinate, here.law.symmetry)
    assert there.law.knots == pytest.approx([change.length * knot for knot in here.law.knots])
    size = change.force * BUMP.size
    assert there.law.force == pytest.approx([change.force * force for force in here.law.force], abs=0.01 * size)
    assert there.judgement is not None
    assert here.judgement is not None
    assert there.judgement.closure == pytest.approx(here.judgement.closure, abs=0.01)


def test_a_joint_of_the_rail_is_learned_where_it_is() -> None:
    """Narrower than even knots over the way, and it turns with the direction: an axis of a user had 0.17 N over 42 mm
    in place of 4.5 N, as what a nominal value does was taken off the law."""
    joint = Joint(0.4, 9e-3, 6e-4)
    records = recorded(MACHINE, (PLAN,), [joint], seed=5)
    machine = with_units(MACHINE, records)
    base = Baseline(refit_within(machine, records), records, pieces(records, loop_time(machine)), NULL)
    rail = diagnosed(base, disabled=list(looked_for()))
    law, coulomb = rail.learned, MACHINE.friction.coulomb_force
    assert law is not None
    assert law.law is not None
    assert (law.law.coordinate, law.law.symmetry, law.reason) == ("position", "directional", "")
    truth = np.array([joint.force(knot, coulomb) for knot in law.law.knots])
    assert np.array(law.law.force) == pytest.approx(truth, abs=0.15 * joint.part * coulomb)
    assert min(law.law.force) < -0.75 * joint.part * coulomb
    assert np.min(np.diff(law.law.knots)) < 0.5 * np.max(np.diff(law.law.knots))
    files = {file.name: file.held_out.gap() for file in rail.how_far.handover.files}
    assert rail.how_far.handover.adopted.name == "measured law"
    assert files["measured law"].force < 0.3 * files["re-fitted"].force


def test_a_brake_beside_the_way_is_learned_as_a_drag_where_it_is() -> None:
    """No curve over one coordinate is such a law: of a zone with eddy currents half was closed."""
    brake = Brake(60.0, 9e-3, 2.5e-3)
    records = recorded(MACHINE, (PLAN,), [brake], seed=5)
    machine = with_units(MACHINE, records)
    base = Baseline(refit_within(machine, records), records, pieces(records, loop_time(machine)), NULL)
    zone = diagnosed(base, disabled=list(looked_for()))
    law = zone.learned
    assert law is not None
    assert law.law is not None
    assert law.judgement is not None
    assert (law.law.coordinate, law.law.symmetry, law.reason) == ("position", "drag", "")
    assert law.judgement.closure > 0.9
    assert law.to_json("")["values_unit"] == "N s/m"
    truth = np.array([brake.coefficient(knot) for knot in law.law.knots])
    assert np.array(law.law.force) == pytest.approx(truth, abs=0.03 * brake.drag)
    assert zone.how_far.handover.adopted.name == "measured law"
    assert improved_machine(zone).effects == (law.law,)


def test_the_curves_to_choose_from_where_a_type_is_left_out_are_found_without_it(
    baseline: Baseline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shortlist had been one of all types: where there is no law, it made a closure of -0.32 one of -0.13."""
    kinds = list(dict.fromkeys(piece.kind for piece in baseline.pieces))
    kind = np.array([kinds.index(piece.kind) for piece in baseline.pieces])
    types = [number for number, one in enumerate(kinds) if not one.rests]
    out = types[0]
    segment, records = baseline.segment, baseline.records

    def named() -> dict[int | None, list[tuple[str, str]]]:
        found = curves_tried.shortlists(baseline.nominal, records, segment, kind, types)
        return {number: [one.named for one in shortlist] for number, shortlist in found.items()}

    def of_another_law(fit: Fit, records: Sequence[Record]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        force, used = unknown_less_mean(fit, records)
        return np.where(kind[segment] == out, -5.0 * force, force), used

    before = named()
    monkeypatch.setattr(curves_tried, "unknown_less_mean", of_another_law)
    after = named()
    assert set(before) == {None, *types}
    assert after[None] != before[None]
    assert after[out] == before[out]


def test_a_law_that_one_type_of_motion_alone_shows_is_refused(baseline: Baseline, floor: NoiseFloor) -> None:
    """All long strokes counted as one type: no other one goes to the bump."""
    far = MotionKind(3e-2, 0.1)
    alike = [replace(one, kind=far) if one.kind.stroke > 1e-3 else one for one in baseline.pieces]
    alone = learned(baseline.nominal, floor, replace(baseline, pieces=tuple(alike)))
    assert alone.reason.startswith("only ")
    assert "record motions of other strokes and speeds over the same range" in alone.reason
    assert alone.judgement is not None
    assert alone.judgement.share < 0.3


def test_too_few_types_of_motion_are_refused_at_once(baseline: Baseline, floor: NoiseFloor) -> None:
    alike = [replace(one, kind=MotionKind(1e-2, 0.1)) for one in baseline.pieces]
    none = learned(baseline.nominal, floor, replace(baseline, pieces=tuple(alike)))
    assert none.law is None
    assert none.reason.startswith("the records hold 1 type of motion")
    assert none.to_json("")["adopted"] is False


@pytest.fixture(scope="module")
def leaning() -> Baseline:
    """Records of a table that leans on a spring from one place on."""
    records = recorded(MACHINE, (PLAN,), [SPRING], seed=5)
    machine = with_units(MACHINE, records)
    return Baseline(refit_within(machine, records), records, pieces(records, loop_time(machine)), NULL)


def test_a_law_over_the_position_that_only_falls_is_a_spring_in_another_form(leaning: Baseline) -> None:
    others = set(looked_for()) - {"cogging", "cable_spring"}
    found = diagnosed(leaning, disabled=list(others))
    assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("cable_spring",))
    shown = to_json(found)
    assert shown["verdict"]["form"] == {"cable_spring": "other"}
    assert shown["verdict"]["partly"] == []
    assert shown["how_far"]["shares"] == {"cable_spring": 1.0}
    assert shown["learned"]["adopted"]
    assert shown["learned"]["judged_by"] == "innovations"
    row = shown["which"][0]
    assert (row["effect"], row["parameters"], row["adequate"]) == ("cable_spring", {}, True)
    truth = [SPRING.force(place) for place in row["measured"]["at"]]
    level = np.median(np.array(row["measured"]["values"]) - truth)  # the offset's
    assert np.array(row["measured"]["values"]) - level == pytest.approx(truth, abs=0.1)
    (law,) = improved_machine(found, "a test").effects
    assert isinstance(law, Measured)
    assert list(law.force) == pytest.approx(row["measured"]["values"], abs=1e-3)


def test_a_spring_that_is_named_by_its_stiffness_gets_its_curve_where_it_is_bent() -> None:
    """As what is left is of its kind, though a straight one does not close it."""
    records = recorded(MACHINE, (PLAN,), [OneSided(400.0, 8e-3, 1e-3)], seed=5)
    machine = with_units(MACHINE, records)
    cut = pieces(records, loop_time(machine))
    others = set(looked_for()) - {"cogging", "cable_spring"}
    found = diagnosed(Baseline(refit_within(machine, records), records, cut, NULL), disabled=list(others))
    assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("cable_spring",))
    assert [type(effect) for effect in found.final.candidate.added_effects] == [Measured]
    assert found.how_far.closure > 0.98  # 0.92 by a stiffness


def test_where_a_spring_may_not_be_named_its_curve_stays_without_a_name(leaning: Baseline) -> None:
    found = diagnosed(leaning, disabled=list(set(looked_for()) - {"cogging"}))
    assert (found.outcome, found.effects) == (Outcome.NONE, ())
    assert found.learned is not None
    assert found.learned.pulls_back(0.05)


def test_a_slow_law_that_chi_square_hardly_shows_is_judged_by_the_unknown_force(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The filter's own random force follows the spring: what the innovations are above the floor is chance."""
    plan = together("far", [strokes(MACHINE, 30e-3, (speed,)) for speed in (0.03, 0.1, 0.2)])
    weak = replace(SPRING, stiffness=20.0)

    def judged(effects: Sequence[Effect]) -> Learned:
        records = recorded(MACHINE, (plan,), effects, seed=5)
        machine = with_units(MACHINE, records)
        nominal = refit_within(machine, records)
        beside = Baseline(nominal, records, pieces(records, loop_time(machine)), NULL)
        return learned(nominal, held_out_closure([Stage(nominal)], beside, 0).floor, beside)

    shown = []
    surely_above = learn._surely_above

    def asked(above: NDArray[np.float64], floor: NoiseFloor, criteria: Criteria) -> bool:
        shown.append(surely_above(above, floor, criteria))
        return shown[-1]

    monkeypatch.setattr(learn, "_surely_above", asked)
    found = judged([weak])
    assert shown == [False]
    assert found.to_json("")["judged_by"] == "unknown force"
    assert found.law is not None
    assert (found.law.coordinate, found.law.symmetry, found.reason) == ("position", "plain", "")
    assert found.pulls_back(0.05)
    assert found.judgement is not None
    assert found.judgement.closure > 0.9
    assert found.judgement.share > 0.9
    assert all(one.closure > 0.8 for one in found.judgement.by_type)
    truth = np.array([weak.force(knot) for knot in found.law.knots])
    force = np.array(found.law.force)
    assert force - np.median(force - truth) == pytest.approx(truth, abs=0.05)
    assert judged([]).reason == "the gap is too small beside the noise floor to judge a law"


@pytest.mark.parametrize(
    ("force", "coordinate", "symmetry", "reason", "pulls"),
    [
        ((0.0, 0.0, -1.0), "position", "plain", "", True),
        ((0.0, 0.05, -1.0), "position", "plain", "", True),  # a rise within the band
        ((0.0, 0.13, -1.0), "position", "plain", "", True),  # and by a thirtieth of the fall beyond it
        ((0.0, 0.16, -1.0), "position", "plain", "", False),
        ((0.0, -1.0, 0.0), "position", "plain", "", False),
        ((-1.0, 0.0, 1.0), "position", "plain", "", False),
        ((0.0, -0.02, -0.05), "position", "plain", "", False),  # no fall beyond the band
        ((0.0, 0.0, -1.0), "speed", "plain", "", False),
        ((0.0, 0.0, -1.0), "position", "directional", "", False),
        ((0.0, 0.0, -1.0), "position", "plain", "only half of it is shown", False),
    ],
)
def test_a_spring_is_a_force_over_the_position_that_surely_falls_and_nowhere_rises(
    force: tuple[float, ...],
    coordinate: Literal["position", "speed"],
    symmetry: Literal["plain", "directional"],
    reason: str,
    pulls: bool,
) -> None:
    law = Measured(coordinate, (0.0, 1.0, 2.0), force, symmetry)
    values = np.array(force)
    assert Learned(law, values - 0.05, values + 0.05, None, None, reason).pulls_back(0.05) is pulls


@pytest.mark.parametrize(
    ("share", "closure", "low", "pulls"),
    [(0.18, 0.96, 0.45, True), (0.18, 0.96, -0.1, False), (0.18, 0.6, 0.45, False), (0.5, 0.6, 0.45, False)],
)
def test_a_spring_that_few_motions_judge_is_one_where_those_surely_close_some(
    share: float, closure: float, low: float, pulls: bool, leaning: Baseline
) -> None:
    """The first is of a drawn machine whose motions hardly overlap (seed 202624)."""
    judged = Judgement(closure, (low, 1.0), share, ())
    assert little_judged(judged, Criteria()) == pulls
    fitted = leaning.nominal if little_judged(judged, Criteria()) else None
    law, values = Measured("position", (0.0, 1.0, 2.0), (0.0, 0.0, -1.0)), np.array([0.0, 0.0, -1.0])
    reason = objection(judged, Criteria())
    assert reason
    assert Learned(law, values - 0.05, values + 0.05, judged, fitted, reason).pulls_back(0.05) is pulls


def test_a_coordinate_goes_as_far_as_the_record_does() -> None:
    """A light rotor's accelerations are above 1e4 rad/s^2, and so were cut off there."""
    records, fit = case("")
    known = units(fit.candidate.nominal, records)
    usual = coordinate_values("acceleration", fit, records, known)
    quick = replace(
        fit, residuals=tuple(replace(one, path=one.path._replace(speed=1e4 * one.path.speed)) for one in fit.residuals)
    )
    assert np.max(np.abs(usual)) > 1
    assert coordinate_values("acceleration", quick, records, known) == pytest.approx(1e4 * usual, rel=1e-9, abs=1e-6)
