"""The pattern and the candidates: conditions, ranges, what a candidate puts into a machine."""

from __future__ import annotations

import math

import numpy as np
import pytest

from design.controller import default_controller
from design.validation import assess, sequence, validate
from models.effects import base, catalogue
from models.ensemble import load_ensemble
from models.friction import branch
from models.machine import load
from models.records.record import Record, motions
from models.simulation.simulator import Response
from studies.paper_gap.candidates import COMPENSATOR, Range, beyond, every, wrong_friction
from studies.paper_gap.compute import spread
from studies.paper_gap.explore import ALONE, BESIDE, BEYOND, Case, Effort, explore
from studies.paper_gap.pattern import Outcome, Pattern, by_scale, outcome_of

PAPER = Pattern(tolerance=2e-6, step=1e-7, dispersion=2.4e-6, margin=0.24e-6)


def outcome(reversal: float, inching: float, sigma: float) -> Outcome:
    """An outcome with these errors and 3 sigma [um]."""
    return Outcome(0.02, (0.02, 0.03), reversal * 1e-6, inching * 1e-6, sigma * 1e-6)


@pytest.mark.parametrize(
    ("reversal", "inching", "sigma", "distance"),
    [
        (1.0, 2.1, 2.4, 0.0),
        (2.0, 5.0, 2.64, 0.0),
        (2.1, 2.1, 2.4, 0.1),
        (1.0, 2.0, 2.4, 0.1),
        (1.0, 0.6, 2.4, 1.5),
        (1.0, 2.1, 3.0, 0.36),
        (1.0, 2.1, 0.6, 1.56),
    ],
)
def test_the_distance_is_the_largest_miss(reversal: float, inching: float, sigma: float, distance: float) -> None:
    assert PAPER.distance(outcome(reversal, inching, sigma)) * 1e6 == pytest.approx(distance, abs=1e-9)


def test_inching_motions_that_err_alike_are_just_at_the_tolerance() -> None:
    """Errors of 2.1 um behind a reversal without error: 3 sigma by hand, and the pattern."""
    machine = load()
    target = sequence(machine, periods=2)
    reading = target + 2.1e-6
    for motion in motions(target):
        if motion.reversal:
            reading[motion.start : motion.stop] = motion.target
    signals = (target, target, np.zeros(target.size), np.zeros(target.size), reading)
    response = Response(Record(machine.sample_time, *signals), target, np.zeros(target.size), np.zeros(1))
    found = outcome_of(assess(machine, response, periods=2, reading="scale"))
    assert found.dispersion == pytest.approx(3 * 2.1e-6 * math.sqrt(4) / 5)
    assert found.reversal_settling == 0.0
    assert found.inching_settling == math.inf
    assert PAPER.distance(found) == 0.0


def test_the_outcome_by_the_scale_is_that_of_the_validation_to_its_resolution() -> None:
    """True positions of as many periods as it takes there, readings of the last of two periods here."""
    machine = load()
    controller = default_controller(machine)
    here = outcome_of(by_scale(machine, controller))
    there = validate(machine, controller)
    assert here.dispersion == pytest.approx(there.worst_dispersion, abs=1.5 * machine.scale.resolution)
    assert here.reversal_settling == pytest.approx(there.reversal.settling_time, abs=2e-3)


def test_ranges_are_those_of_the_priors() -> None:
    for name, kind in catalogue.looked_for().items():
        candidate = every()[name]
        assert [one.name for one in candidate.ranges] == [one.name for one in base.parameters(kind)]
        for one, prior in zip(candidate.ranges, base.parameters(kind), strict=True):
            numbers = [one.at(u) for u in (0.0, 0.3, 0.5, 0.7, 1.0)]
            assert min(numbers) >= prior.low - 1e-12 * prior.high
            assert max(numbers) == pytest.approx(prior.high)
            if one.signed:
                assert min(numbers) == pytest.approx(-prior.high)
                assert abs(one.at(0.5)) * prior.high == pytest.approx(prior.typical**2)
            else:
                assert min(numbers) == pytest.approx(prior.low)


def test_beyond_begins_where_the_prior_ends_and_stops_where_the_law_does() -> None:
    part = beyond(every()["friction_relaxation"], 10.0).ranges[0]
    assert part.low == pytest.approx(0.3)
    assert part.high < 1.0
    assert beyond(every()["cogging"], 10.0).ranges[0].high == pytest.approx(50.0)


def test_a_range_is_even_on_the_logarithm_or_in_itself() -> None:
    assert Range("a", "1", 1.0, 100.0).at(0.5) == pytest.approx(10.0)
    assert Range("a", "1", 1.0, 3.0, logarithmic=False).at(0.5) == pytest.approx(2.0)
    switch = Range("a", "1", 0.0, 1.0, logarithmic=False, whole=True)
    assert [switch.at(u) for u in (0.0, 0.4, 0.6, 1.0)] == [0.0, 0.0, 1.0, 1.0]


def test_the_looser_reading_leaves_out_the_inching_motions() -> None:
    in_time = outcome(1.0, 0.6, 2.4)
    assert PAPER.loose_distance(in_time) == 0.0 < PAPER.distance(in_time)
    assert PAPER.loose_distance(outcome(2.5, 3.0, 2.4)) * 1e6 == pytest.approx(0.5)
    assert PAPER.near(outcome(1.0, 0.6, 2.9))
    assert not PAPER.near(outcome(1.0, 0.6, 3.0))


def test_effects_and_parameters_change_the_table_and_designs_the_compensator_alone() -> None:
    machine = load()
    controller = default_controller(machine)
    for name, candidate in every().items():
        true, law = candidate.put((machine, controller), candidate.values([0.9] * len(candidate.ranges)))
        of_compensator = candidate.kind == COMPENSATOR or name.startswith("identified")
        assert (true == machine) == of_compensator, name
        assert (law == controller) != of_compensator, name
        assert law.without_compensation() == controller.without_compensation(), name
        assert true.control == machine.control, name


def test_a_wrong_friction_scales_force_and_length() -> None:
    machine = load()
    table = machine, default_controller(machine)
    true = wrong_friction().put(table, (0.2, -0.3))[0].friction
    assert true.coulomb_force == pytest.approx(1.2 * machine.friction.coulomb_force)
    distance = np.linspace(0, 300e-6, 50)
    np.testing.assert_allclose(branch(true, 0.7 * distance), 1.2 * branch(machine.friction, distance), rtol=1e-12)


def test_a_friction_that_is_identified_wrongly_is_the_compensators_not_the_tables() -> None:
    machine = load()
    one = every()["identified_friction"]
    true, law = one.put((machine, default_controller(machine)), (0.2, -0.3))
    assert true == machine
    assert law.friction_compensation is not None
    assert law.friction_compensation.coulomb_force == pytest.approx(1.2 * machine.friction.coulomb_force)
    assert max(law.friction_compensation.limit) == pytest.approx(0.7 * max(machine.friction.limit))
    assert one.believed(machine, (0.2, -0.3)).coulomb_force == pytest.approx(1.2 * machine.friction.coulomb_force)


def test_a_case_is_explored_alike_whatever_else_is() -> None:
    """The same seed gives the same draws; another one others; the search only adds to the draws."""
    machine = load()
    tables = [(machine, default_controller(machine))]
    case = Case("gain_asymmetry", BESIDE)
    blind = explore(tables, case, PAPER, Effort(3, 1, 1, 0), 7)
    more = explore(tables, case, PAPER, Effort(3, 1, 2, 1), 7)
    assert more[:3] == blind
    assert [one.found for one in more] == [False] * 3 + [True] * 2
    other = explore(tables, case, PAPER, Effort(3, 1, 1, 0), 8)
    assert [one.point for one in other] != [one.point for one in blind]
    near = min(blind, key=lambda one: one.distance)
    assert all(np.max(np.abs(np.array(one.point) - near.point)) < 0.7 for one in more[3:])


def test_a_case_varies_its_candidate_alone_beside_others_or_beyond_its_range() -> None:
    assert len(Case("viscous_friction", ALONE).candidate().ranges) == 1
    assert len(Case("viscous_friction", BESIDE).candidate().ranges) == 3
    assert Case("viscous_friction", BEYOND).candidate().ranges[0].low == pytest.approx(100.0)


def test_spread_tables_differ_and_the_machine_comes_first() -> None:
    members, machine = load_ensemble(), load()
    picked = spread(members, machine, 4)
    assert picked[0].control.pid == machine.control.pid
    assert len({one.name for one in picked}) == 4
    assert spread(members, machine, 60) == list(members)
