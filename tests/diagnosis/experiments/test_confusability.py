"""What records can discriminate: known confusions, distances that simulated effects attain, the next experiment."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.criteria import Criteria
from diagnosis.experiments import schedules as experiments
from diagnosis.experiments.confusability import (
    Confusability,
    confusability,
    distances,
    grid,
    products,
    to_json,
)
from diagnosis.experiments.menu import menu
from diagnosis.experiments.propose import along, next_experiment, showing, virtual
from diagnosis.experiments.schedules import quickest
from diagnosis.model.fit import weights
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate, columns, evaluate
from diagnosis.records.motions import numbered, pieces
from diagnosis.where.locate import locate
from diagnosis.where.sentences import words
from diagnosis.which.detectors.scan import by_segment, finding_of, partial_out, quadratures
from models.controller import Controller
from models.effects.base import Effect
from models.effects.catalogue import every, looked_for
from models.effects.motor import Cogging
from models.effects.priors import USUAL
from models.machine import DEFAULT, load
from models.simulation.simulator import simulate
from studies.command import to_text
from tests.diagnosis.units import Change
from tests.diagnosis.where.cases import case, fitted, run, table

THRESHOLD = Criteria().distinguishable


@pytest.fixture(scope="module")
def several() -> Confusability:
    """Of records with moves of several sizes and rests."""
    records, fit = case("")
    return confusability(fit, records)


@pytest.fixture(scope="module")
def short() -> Confusability:
    """Of the 20 um sequence alone."""
    machine = table()
    records = run(machine, (), [experiments.sequence(machine, 1)])
    return confusability(fitted(machine, records), records)


def test_what_short_strokes_can_not_show_is_said(short: Confusability, several: Confusability) -> None:
    along = {"cogging", "cable_spring", "thrust_ripple", "position_dependent_friction"}
    assert along <= set(short.not_identifiable)
    assert "friction_relaxation" not in short.not_identifiable
    assert not along & set(several.not_identifiable)


def test_an_error_of_the_scales_length_shows_in_no_record(several: Confusability) -> None:
    assert "scale_gain_error" in several.not_identifiable
    i = several.names.index("scale_gain_error")
    assert several.distance[i, i] < 1


def test_no_other_effect_comes_nearer_than_its_own_absence(several: Confusability) -> None:
    alone = np.diag(several.distance)
    known = np.isfinite(several.distance)
    assert np.all((several.distance <= alone[:, None] * (1 + 1e-9)) | ~known)
    assert np.all(alone >= 0)


@pytest.mark.parametrize("name", ["viscous_friction", "cogging", "gain_asymmetry", "position_dependent_friction"])
def test_the_distance_is_what_the_simulated_effect_gains(name: str) -> None:
    """The effect in the closed loop, and what its own law then gains beside the re-fitted nominal model."""
    records, fit = case(name)
    projection = partial_out(fit, numbered(pieces(records), records))
    effect = every()[name].typical()
    given = projection(
        columns(fit.candidate, [(effect,)], records, fit.paths, fit.residuals) * weights(records)[:, None]
    )
    gain = finding_of(effect, *by_segment(given, projection), projection, USUAL).gain
    assert gain == pytest.approx(_expected(effect), rel=0.35)
    assert gain > THRESHOLD


def _expected(effect: Effect) -> float:
    """The squared distance from nothing, at the simulated phase; that of the matrix is the mean of both quadratures."""
    records, fit = case("")
    found = products(fit, records, [effect.name])
    (_, where), *_ = found.of(effect.name)
    phase = getattr(effect, "phase", 0.0)
    parts = np.array([np.cos(phase), np.sin(phase)])[: len(where)]
    return float(parts @ found.product[np.ix_(where, where)] @ parts)


def test_limits_are_in_proportion_to_the_distance(several: Confusability) -> None:
    for i, (_, limit, typical) in enumerate(several.limits):
        assert limit / typical * several.distance[i, i] == pytest.approx(np.sqrt(THRESHOLD))


def test_jitter_shows_only_where_motions_repeat() -> None:
    machine = table()
    found = {}
    for repeats in (1, 3):
        records = run(machine, (), [experiments.sequence(machine, repeats)])
        one = confusability(fitted(machine, records), records)
        found[repeats] = one.limits[one.names.index("timing_jitter")][1]
    assert np.isinf(found[1])
    assert np.isfinite(found[3])


def test_two_names_for_one_column_are_equivalent(several: Confusability) -> None:
    """A table on which two effects are the same by construction: their distance is 0 both ways."""
    records, fit = case("")
    found = products(fit, records, ["viscous_friction", "stribeck"])
    twins = tuple((f"{name} twin", effect, where) for name, effect, where in found.place)
    twin = replace(found, place=(*found.place, *twins))
    names = ("viscous_friction", "viscous_friction twin", "stribeck")
    distance = distances(twin, names)
    assert distance[0, 1] < 1e-3 * distance[0, 0]
    assert distance[1, 0] < 1e-3 * distance[0, 0]
    assert distance[0, 2] > 0.5 * distance[0, 0]
    assert "viscous_friction" in several.names


def test_effects_left_out_are_no_part_of_it() -> None:
    records, fit = case("")
    found = confusability(fit, records, left_out=("play", "timing_jitter"))
    assert not {"play", "timing_jitter"} & set(found.names)
    assert len(found.names) == len(fit.candidate.nominal.kinds) - 2


def test_with_every_effect_left_out_there_is_nothing_to_be_mistaken_for() -> None:
    records, fit = case("")
    found = confusability(fit, records, left_out=looked_for())
    assert (found.names, found.equivalent, found.not_identifiable) == ((), (), ())


def test_the_grid_begins_with_the_typical_point() -> None:
    for kind in every().values():
        assert grid(kind)[0] == kind.typical()
        assert len(set(grid(kind))) == len(grid(kind))


def test_the_json_holds_the_matrix(several: Confusability) -> None:
    plain = json.loads(to_text(to_json(several)))
    kinds = table().kinds
    assert len(plain["distance"]) == len(plain["names"]) == len(kinds)
    assert {row["effect"] for row in plain["limits"]} == set(kinds)


def test_relaxation_and_a_drift_of_the_scale_are_separated_by_dwells() -> None:
    machine = load()
    found = next_experiment(["friction_relaxation", "scale_drift"], machine)
    assert found is not None
    assert found.schedule.name == "dwell sweep"
    assert "rests of 0.06" in found.sentence
    assert found.reaches > THRESHOLD


def test_the_proposal_holds_when_it_is_run() -> None:
    """Cogging in the closed loop over the proposed schedule: a cable spring then explains less, by the distance."""
    machine = table()
    found = next_experiment(["cogging", "cable_spring"], machine)
    assert found is not None
    assert "stroke" in found.sentence
    cogging = Cogging.typical()
    records = run(machine, (cogging,), [found.schedule])
    fit = fitted(machine, records)
    projection = partial_out(fit, numbered(pieces(records), records))
    gains = {}
    for effect in (cogging, every()["cable_spring"].typical()):
        variants = [(one,) for one in quadratures(effect)]
        given = projection(
            columns(fit.candidate, variants, records, fit.paths, fit.residuals) * weights(records)[:, None]
        )
        gains[effect.name] = finding_of(effect, *by_segment(given, projection), projection, USUAL).gain
    assert gains["cogging"] - gains["cable_spring"] > THRESHOLD


def test_what_no_experiment_shows_asks_for_a_gauge() -> None:
    found = next_experiment(["scale_gain_error"], load())
    assert found is not None
    assert "external gauge" in found.sentence
    assert found.reaches < THRESHOLD


def test_nothing_to_tell_apart_needs_no_experiment_and_none_of_these_follows_the_coordinate() -> None:
    assert next_experiment([], load()) is None
    for coordinate, says in (("since_reversal", "nested loops"), (None, "the same every time")):
        found = along(coordinate, load())
        assert found is not None
        assert says in found.sentence


def test_every_coordinate_has_its_experiment() -> None:
    records, fit = case("cogging")
    known = pieces(records)
    for one in locate(fit, records, known).dependence.coordinates:
        found = along(one.name, load())
        assert found is not None
        assert f"depends most on {words(one.name)}." in found.sentence


def test_what_records_could_not_show_gets_the_experiment_that_shows_most_of_it(short: Confusability) -> None:
    hidden = [name for name in short.not_identifiable if name in {"cogging", "cable_spring", "thrust_ripple"}]
    found = showing(hidden, load())
    assert found is not None
    assert all(name.replace("_", " ") in found.sentence for name in hidden)
    assert showing(["scale_gain_error"], load()) is None


@pytest.mark.parametrize("file", [DEFAULT, DEFAULT.with_name("emps.toml")])
def test_the_menu_keeps_to_the_ratings(file: Path) -> None:
    machine = load(file)
    for one in menu(machine):
        path = one.schedule.given.position
        speed = np.abs(np.diff(path)) / machine.sample_time
        assert np.max(speed) <= 1.001 * machine.drive.rated_speed, one.words
        assert np.max(np.abs(one.schedule.given.feedforward)) <= machine.drive.rated_thrust, one.words
        assert path[0] == 0
        assert path[-1] == pytest.approx(0, abs=1e-12), one.words


def test_the_menu_is_in_the_sizes_of_the_machine() -> None:
    """A table a hundred times as small, with a thousandth of the force and ten times as fast, is asked for the same in
    its units; only a hold lasts as long as on any other."""
    machine, change = load(), Change(force=1e-3, length=1e-2, time=0.1)
    for usual, small in zip(menu(machine), menu(change.machine(machine)), strict=True):
        if usual.words.startswith("a hold"):
            continue
        one, two = usual.schedule.given, small.schedule.given
        assert two.position.size == pytest.approx(one.position.size, abs=8)  # half samples round either way
        assert np.ptp(two.position) == pytest.approx(1e-2 * np.ptp(one.position))
        assert np.ptp(two.feedforward) == pytest.approx(1e-3 * np.ptp(one.feedforward), rel=0.1)


def test_the_menu_of_long_strokes_reaches_beyond_them_and_no_record_is_endless() -> None:
    """An axis whose strokes are thousands of presliding distances long, in 0.6 s: neither strokes of micrometres nor
    minutes of rest."""
    machine = load(DEFAULT.with_name("emps.toml"))
    schedules = [one.schedule for one in menu(machine)]
    assert max(np.ptp(one.given.position) for one in schedules) == pytest.approx(3 * machine.specification.stroke)
    assert max(one.target.size for one in schedules) < 130_000


def test_the_loop_can_run_the_menu() -> None:
    """On the nominal table, the command within the rated thrust and the table where the reference is."""
    machine = load()
    controller = Controller(machine.sample_time, machine.control.pid, machine.control.reference_delay, (1.0,), (0.0,))
    for one in menu(machine):
        record = simulate(machine, controller, one.schedule.target, given=one.schedule.given).record
        assert np.max(np.abs(record.command)) < machine.drive.rated_thrust, one.words
        error = record.position - record.reference
        assert np.max(np.abs(error)) < 0.1 * max(float(np.ptp(record.reference)), 1e-3), one.words


def test_a_move_at_a_share_of_the_thrust_takes_that_share() -> None:
    machine = load()
    planned = experiments.schedule("move", machine, [experiments.Move(1e-3, quickest(machine, 1e-3, 0.5), 0.1)])
    assert np.max(planned.given.feedforward) == pytest.approx(0.5 * machine.drive.rated_thrust, rel=0.1)


def test_the_schedule_is_written_as_a_record_of_references() -> None:
    machine = load()
    planned = experiments.amplitude_ladder(machine, (2e-6, 5e-6))
    text = experiments.to_csv(planned, machine.sample_time)
    assert text.startswith("time_s,target_m,reference_m,feedforward_N\n")
    rows = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    assert rows.shape == (planned.target.size, 4)
    assert rows[:, 2] == pytest.approx(planned.given.position, rel=1e-6, abs=1e-12)
    assert rows[:, 3] == pytest.approx(planned.given.feedforward, rel=1e-6, abs=1e-6)
    assert np.diff(rows[:, 0]) == pytest.approx(machine.sample_time, rel=1e-4)


def test_a_virtual_record_is_explained_by_the_nominal_machine() -> None:
    fit, _ = virtual(load(), experiments.amplitude_ladder(load(), (10e-6,)))
    assert np.mean(fit.innovations[100:] ** 2) < 1.5


def test_an_offset_in_the_machine_file_is_known_and_the_parameter_adds_to_it() -> None:
    table = load()
    pulled = replace(table, drive=replace(table.drive, offset=2.0))
    fit, record = virtual(pulled, experiments.amplitude_ladder(pulled, (10e-6,)))
    assert record.command[0] == pytest.approx(2.0, abs=0.5)  # what the integral holds from the start
    assert np.mean(fit.innovations[100:] ** 2) < 1.5
    layout = parameters(table, 1)  # the same record with a file that states none
    theta = np.zeros(layout.count)
    theta[layout.of("amplifier_offset")] = 2.0
    adding, nothing = (Candidate(layout, one) for one in (theta, np.zeros(layout.count)))
    assert adding.machine.drive.offset == 2.0
    assert np.array_equal(evaluate(adding, [record], fit.paths)[0].innovations[100:], fit.innovations[100:])
    assert evaluate(nothing, [record], fit.paths)[0].force - fit.residuals[0].force == pytest.approx(2.0)
