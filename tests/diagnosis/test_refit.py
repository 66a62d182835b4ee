"""What the re-fit of the nominal parameters finds before any effect is looked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from diagnosis import refit as refit_module
from diagnosis.criteria import Criteria
from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.model.fit import fit, one_step, weights
from diagnosis.model.parameters import LOOSE_BOUND_STDS, applied, parameters
from diagnosis.model.residual import Candidate
from diagnosis.refit import refit_within, shifts, wrong_values
from models.effects.base import Effect
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging
from models.friction import elements
from models.machine import Machine, Tolerance
from models.plant import Mode
from tests.diagnosis.tables import recorded, schedules, table

MACHINE = table()
WEAK = replace(MACHINE, drive=replace(MACHINE.drive, rated_thrust=60.0))
PLAN = schedules(MACHINE)


@pytest.mark.parametrize("truth", [MACHINE, WEAK], ids=["follows", "does not"])
def test_whether_the_drive_follows_beyond_its_rating_is_read_off_the_records(truth: Any) -> None:
    records = recorded(truth, PLAN, seed=11)
    most = max(float(np.abs(record.command).max()) for record in records)
    assert most > WEAK.drive.rated_thrust
    found = refit_within(WEAK, records).candidate.nominal
    follows = truth is MACHINE
    assert found.drive.rated_thrust == (most if follows else WEAK.drive.rated_thrust)
    assert found.sources["drive.rated_thrust"].kind == ("identified" if follows else "paper")


def test_a_table_whose_contacts_are_all_much_softer_is_re_fitted() -> None:
    """By more than each contact's own tolerance and three times the level's."""
    friction = MACHINE.friction
    softer = elements(0.78 * np.array(friction.stiffness), np.array(friction.limit), friction.damping)
    records = recorded(replace(MACHINE, friction=softer), PLAN, seed=17, wrong=0.0)
    found = refit_within(MACHINE, records)
    assert np.mean(found.innovations**2) < 1.02
    assert sum(found.candidate.machine.friction.stiffness) == pytest.approx(sum(softer.stiffness), rel=0.02)


def test_a_load_that_was_left_on_the_table_is_re_fitted() -> None:
    """A quarter of its mass, far beyond the tolerance: otherwise the residual resembles a thrust ripple."""
    rigid, *flexible = MACHINE.plant.modes
    heavy = replace(MACHINE.plant, modes=(replace(rigid, gain=rigid.gain / 1.25), *flexible))
    records = recorded(replace(MACHINE, plant=heavy), PLAN, seed=18, wrong=0.0)
    found = refit_within(MACHINE, records)
    assert np.mean(found.innovations**2) < 1.02
    assert found.candidate.machine.plant.modes[0].gain == pytest.approx(rigid.gain / 1.25, rel=0.005)


def test_what_is_re_fitted_keeps_to_the_tolerance_of_the_machine_file() -> None:
    loose = replace(MACHINE, tolerance=Tolerance(offset=3.0))
    usual, wide = parameters(MACHINE, 1), parameters(loose, 1)
    (at,) = usual.of("amplifier_offset")
    assert [usual.deviation[at], wide.deviation[at], wide.high[at]] == [0.2, 3.0, LOOSE_BOUND_STDS * 3.0]
    rest = np.setdiff1d(np.arange(usual.count), at)
    assert np.array_equal(usual.high[rest], wide.high[rest])
    theta = np.zeros(wide.count)
    theta[at] = 5.0
    assert applied(wide, theta).tolerance == loose.tolerance


def test_an_offset_that_makes_most_of_the_gap_is_named_first() -> None:
    """Innovations hardly show it: what is constant, the filter's own unknown force follows."""
    shifted = replace(MACHINE, drive=replace(MACHINE.drive, offset=MACHINE.drive.offset + 1.0))
    found = refit_within(MACHINE, recorded(shifted, PLAN[1:], seed=19, wrong=0.0))
    loose = replace(Criteria(), parameter_min_gain=1e9)
    assert wrong_values(found, loose) == ()
    assert wrong_values(found, loose, floor=0.02) == ("amplifier_offset",)
    assert wrong_values(found, loose, floor=0.8) == ()  # no more than twice the floor's energy
    assert wrong_values(found, Criteria(), floor=0.02)[0] == "amplifier_offset"


@pytest.mark.parametrize(
    ("stated", "true"),
    [(ViscousFriction(20.0), ViscousFriction(23.0)), (Cogging(1.5, 0.035, 1.0), Cogging(3.0, 0.035, 1.0))],
)
def test_a_value_of_a_stated_effect_that_is_off_counts_as_one_of_the_plant_does(stated: Effect, true: Effect) -> None:
    file = replace(MACHINE, effects=(stated,))
    off = refit_within(file, recorded(MACHINE, PLAN[1:], [true], seed=1, wrong=0.0))
    assert wrong_values(off, Criteria()) == (stated.name,)
    assert shifts(off).gain() > Criteria().parameter_shift
    right = refit_within(file, recorded(MACHINE, PLAN[1:], [stated], seed=1, wrong=0.0))
    assert shifts(right).gain() < Criteria().parameter_shift
    assert wrong_values(right, Criteria()) == ()


@pytest.mark.parametrize("deviations", [5, -6])
def test_an_offset_far_beyond_its_tolerance_is_found_where_the_scale_resolves_it(deviations: int) -> None:
    """What is left is what the model neglects of this table on such a scale, whatever the offset."""
    left = []
    fine = replace(MACHINE, scale=replace(MACHINE.scale, noise=2e-10, resolution=1e-9))
    for more in (0, deviations):
        off = fine.drive.offset + more * fine.tolerances.offset
        truth = replace(fine, drive=replace(fine.drive, offset=off))
        records = recorded(truth, PLAN[1:], seed=7, wrong=0.0)
        found = refit_module.refit(parameters(fine, 1), records)
        left.append(float(np.mean(found.innovations**2)))
        assert found.candidate.machine.drive.offset == pytest.approx(off, abs=0.1 * fine.tolerances.offset)
    assert left[1] == pytest.approx(left[0], rel=0.05)


@pytest.mark.parametrize(("fine", "cheaper"), [(True, True), (True, False), (False, True)])
def test_starts_on_a_fine_scale_are_searched_under_a_faster_walk_too_and_the_better_fit_is_kept(
    fine: bool, cheaper: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = recorded(MACHINE, PLAN[1:], seed=19, wrong=0.0)
    machine = replace(MACHINE, scale=replace(MACHINE.scale, noise=1e-10, resolution=1e-10)) if fine else MACHINE
    layout = parameters(machine, 1)
    one = one_step(Candidate(layout, np.zeros(layout.count)), records)
    given = replace(one, innovations=np.full(one.innovations.size, 9.0), converged=True)
    other = replace(given, cost=given.cost + (-1.0 if cheaper else 1.0))
    monkeypatch.setattr(refit_module, "search", lambda fitted, _: fitted.candidate)
    monkeypatch.setattr(refit_module, "fit", lambda *_, **__: given)
    monkeypatch.setattr(refit_module, "_forgiving", lambda *_: other)
    assert refit_module.with_new_starts(given, records) is (other if fine and cheaper else given)


@pytest.mark.parametrize("fine", [False, True])
def test_starts_are_found_before_values_where_a_fine_scale_leaves_more_than_noise(
    fine: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = recorded(MACHINE, PLAN, seed=19, wrong=0.0)
    machine = replace(MACHINE, scale=replace(MACHINE.scale, noise=1e-10, resolution=1e-10)) if fine else MACHINE
    layout = parameters(machine, len(records))
    some, count = one_step(Candidate(layout, np.zeros(layout.count)), records), sum(r.position.size for r in records)
    quiet, loud = (replace(some, innovations=np.full(count, size), cost=count * size**2) for size in (0.9, 9.0))
    for first, second, kept, steps in (
        (quiet, loud, quiet, [3]),
        (loud, quiet, quiet, [3, 0]),
        (loud, loud, loud, [3, 0]),
    ):
        fits, asked = iter((first, second)), list[int]()

        def begun(*given: Any, fits: Any = fits, asked: list[int] = asked) -> Any:
            asked.append(given[2])
            return next(fits)

        monkeypatch.setattr(refit_module, "_first_fit", begun)
        monkeypatch.setattr(refit_module, "with_new_starts", lambda found, _: found)
        assert refit_module.refit(layout, records) is (kept if fine else first)
        assert asked == (steps if fine else [3])


def _on_a_spring(gain: float, frequency: float) -> Machine:
    """A table that reads a nanometre, with one mode: of this gain, in parts of the rigid body's [1], and frequency
    [Hz]."""
    rigid = MACHINE.plant.modes[MACHINE.plant.rigid]
    modes = rigid, Mode(gain * rigid.gain, frequency, 0.015)
    scale = replace(MACHINE.scale, resolution=5e-9, noise=3e-9)
    return replace(MACHINE, scale=scale, plant=replace(MACHINE.plant, modes=modes))


def test_beneath_another_load_a_mode_may_be_far_from_the_file_s() -> None:
    """A user's payload had moved one from 106.7 to 78.3 Hz, beyond the re-fit's bounds: 87.4 Hz, another mode bent, and
    a drive that was "rougher than its model". Here the bounds alone had given 99.5 Hz and 2.6 times the damping."""
    given, truth = _on_a_spring(0.5, 110.0), _on_a_spring(0.9, 80.0)
    plan = (together("short", [amplitude_ladder(given, (5e-6, 20e-6, 100e-6)), strokes(given, 45e-3, (0.2,))]),)
    found = refit_within(given, recorded(truth, plan, seed=4, wrong=0.0)).candidate
    mode, true = found.machine.plant.modes[1], truth.plant.modes[1]
    assert mode.frequency == pytest.approx(true.frequency, rel=2e-3)
    assert mode.gain == pytest.approx(true.gain, rel=0.02)
    assert mode.damping == pytest.approx(true.damping, rel=0.1)
    usual = parameters(given, 1)
    assert abs(found.theta[found.layout.of("mode_frequency")][0]) > usual.high[usual.of("mode_frequency")][0]


@pytest.mark.parametrize(
    ("share", "rests", "taken"), [(0.05, True, True), (0.23, True, False), (0.05, False, False), (1.0, True, False)]
)
def test_a_mode_that_makes_up_for_something_else_gets_no_more_room(
    share: float, rests: bool, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where with more of it most is left as before, or where the mode runs on, the bounds stay: a law is missing."""
    given, plan = _on_a_spring(0.5, 110.0), PLAN[:1]
    records = recorded(given, plan, seed=4)
    layout = parameters(given, 1)
    theta = np.zeros(layout.count)
    theta[layout.of("mode_frequency")] = layout.low[layout.of("mode_frequency")]
    begun = fit(Candidate(layout, theta), records, iterations=0)
    n = float(np.sum(weights(records)))
    at_bound = replace(begun, innovations=begun.innovations * np.sqrt(100 * n / np.sum(begun.innovations**2)))
    left = at_bound.innovations * np.sqrt((1 + 99 * share) / 100)
    candidate = Candidate(layout, np.zeros(layout.count) if rests else theta)
    freed = replace(at_bound, candidate=candidate, innovations=left)
    monkeypatch.setattr(refit_module, "freed", lambda *_: freed)
    assert refit_module._with_other_modes(at_bound, records) is (freed if taken else at_bound)
