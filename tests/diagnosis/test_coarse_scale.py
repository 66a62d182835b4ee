"""Where a scale is coarse for the contacts: what acts slowly shows, and values that the re-fit bends are not wrong."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import baseline as module
from diagnosis.baseline import Baseline, refit_and_null
from diagnosis.criteria import Criteria
from diagnosis.diagnose import diagnose
from diagnosis.handover.files import starts_of
from diagnosis.handover.final_fit import Finished, finished
from diagnosis.handover.gate import File, as_delivered, beside_doubted, is_believed, is_right
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.null import NULL_DRAWS, Null
from diagnosis.records.motions import pieces
from diagnosis.records.units import (
    WALK,
    WALK_OF_FRICTION,
    friction_force,
    loop_time,
    slow_walk,
    white_force,
    with_units,
)
from diagnosis.records.units import noise as reading_noise
from diagnosis.refit import refit_within, shifts, wrong_values
from diagnosis.verdict import Outcome
from diagnosis.where.controller import Replayed
from models.effects.friction_laws import PositionDependentFriction, ViscousFriction
from tests.diagnosis.tables import recorded, schedules, short, table

MACHINE = table()
BIASED = {"friction_level": -5.4, "payload_mass": -4.2, "dead_time": 1.5}  # [tolerances]


class Chance:
    """A null whose tables are moved by BIASED."""

    def __init__(self, layout: Any) -> None:
        self.usual = lambda: (1.0,)
        self.found = Null({}, ((1.0,),) * NULL_DRAWS, (4.0,) * NULL_DRAWS, (), moved(layout))

    def completed(self, _: object) -> Null:
        return self.found


def moved(layout: Any) -> tuple[tuple[float, ...], ...]:
    names = [name for name in layout.names if name != "initial_friction_state"]
    scatter = 0.1 * np.random.default_rng(1).standard_normal((NULL_DRAWS, len(names)))
    return tuple(map(tuple, (scatter + np.array([BIASED.get(name, 0.0) for name in names])).tolist()))


def test_a_value_that_is_moved_where_nothing_is_wrong_is_told_and_hides_no_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside a dead time that was moved by 6 tolerances the weights had been three times as large, so that nothing had
    a name on one machine of the trial."""
    monkeypatch.setattr(module, "start_null", lambda layout, *_, **__: Chance(layout))
    records = recorded(MACHINE, (short(MACHINE),), seed=3)
    found = refit_and_null(MACHINE, records)
    assert found.nominal.candidate.roughness == ()
    assert list(found.biased) == ["friction_level", "payload_mass"]
    assert found.biased["friction_level"] == pytest.approx(-5.4, abs=0.2)


def test_a_rough_drive_has_no_such_values() -> None:
    records = recorded(MACHINE, (short(MACHINE),), seed=3)
    layout = parameters(with_units(MACHINE, records), 1)
    chance = Null({}, ((1.0,),) * NULL_DRAWS, (4.0,) * NULL_DRAWS, (), moved(layout))
    smooth, rough = (Candidate(layout, np.zeros(layout.count), roughness=rough) for rough in ((), (3.0,)))
    names = [list(Baseline(SimpleNamespace(candidate=one), (), (), chance).biased) for one in (smooth, rough)]  # type: ignore[arg-type]
    assert names == [["friction_level", "payload_mass"], []]


def test_a_shift_counts_beyond_what_the_re_fit_moves_where_nothing_is_wrong() -> None:
    """Else a table with nothing wrong has wrong values."""
    records = recorded(MACHINE, (short(MACHINE),), seed=3, wrong=0.0)
    fitted = refit_within(MACHINE, records)
    layout = fitted.candidate.layout
    values = np.array(layout.names) != "initial_friction_state"
    bias = np.array([BIASED.get(name, 0.0) for name in np.array(layout.names)[values]])
    theta = fitted.candidate.theta.copy()
    theta[values] += bias * layout.deviation[values]
    bent = replace(fitted, candidate=replace(fitted.candidate, theta=theta))
    assert shifts(bent).gain() > Criteria().parameter_shift
    assert wrong_values(bent, Criteria())
    assert shifts(bent, bias).gain() == pytest.approx(shifts(fitted).gain())
    assert wrong_values(bent, Criteria(), bias=bias) == wrong_values(fitted, Criteria()) == ()


@pytest.mark.parametrize("coarser", [1.0, 4.0, 40.0, 400.0])
def test_the_unknown_force_walks_no_faster_on_a_coarse_scale(coarser: float) -> None:
    """By no more than a share of the friction in a loop time: what acts slowly is hidden by a force that walks."""
    machine = replace(MACHINE, scale=replace(MACHINE.scale, noise=coarser * reading_noise(MACHINE)))
    walks = slow_walk(machine) * white_force(machine) * np.sqrt(loop_time(machine) / machine.sample_time)
    assert walks <= 1.01 * WALK_OF_FRICTION * friction_force(machine)
    assert coarser > 1.5 or slow_walk(machine) == WALK


def test_friction_along_the_guide_has_its_name_on_a_coarse_scale() -> None:
    """On a scale with ten times the noise the friction level, the mass and a mode were "off"."""
    noisy = replace(MACHINE, scale=replace(MACHINE.scale, noise=4e-7))
    records = recorded(noisy, schedules(noisy), [PositionDependentFriction(0.015, 0.03, 1.0)], seed=5)
    found = diagnose(noisy, records, trusted=True)
    assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("position_dependent_friction",))
    assert found.final.candidate.added_effects[0].values() == pytest.approx([0.015, 0.03, 1.0], rel=0.15)


@pytest.mark.parametrize(("effects", "right"), [((), True), ((ViscousFriction(60.0),), False)])
def test_a_file_is_right_that_leaves_of_records_what_it_leaves_of_its_own(
    effects: tuple[ViscousFriction, ...], right: bool
) -> None:
    """Of 11 contacts of one machine that slip within less than its scale can tell, the starts alone had left 0.108 N of
    its own kind of records, for 0.035 N."""
    records = recorded(MACHINE, (short(MACHINE),), effects, seed=3, wrong=0.0)
    nominal = refit_within(with_units(MACHINE, records), records)
    baseline = Baseline(nominal, records, (), Null({}, ((1.0,),), (4.0,)))
    file = as_delivered(baseline, starts_of(finished(nominal, records).candidate))
    assert is_right(file, baseline, 0) == right
    elsewhere = as_delivered(baseline, [np.full(len(MACHINE.friction.limit), 1e-5)])
    assert elsewhere.gap.force > 1.5 * file.gap.force or not right


def test_an_offset_alone_is_handed_over_where_the_re_fit_is_not_believed() -> None:
    """A gas spring that lost 75 N, in a log that bends the mass: the machine as delivered had been handed over."""
    files = {}
    for load in (4.0, 0.0):
        heavy = replace(MACHINE, drive=replace(MACHINE.drive, offset=MACHINE.drive.offset + load))
        records = recorded(heavy, (short(MACHINE),), seed=4, wrong=0.0)
        nominal = refit_within(with_units(MACHINE, records), records)
        layout = nominal.candidate.layout
        null = Null({}, ((1.0,),) * NULL_DRAWS, (4.0,) * NULL_DRAWS, (), moved(layout))
        baseline = Baseline(nominal, records, pieces(records, loop_time(MACHINE)), null)
        delivered = as_delivered(baseline, starts_of(finished(nominal, records).candidate))
        files[load] = beside_doubted(baseline, delivered)
        log = replace(Replayed(True, 1.0, 1.0, 0.1, 5, "a remedy", 0.0), mislogged=True)
        assert beside_doubted(replace(baseline, known_replays=(log,)), delivered) == []
    (file,) = files[4.0]
    assert file.machine.drive.offset == pytest.approx(4.0, abs=0.1)
    assert files[0.0] == []


@pytest.mark.parametrize(("tolerances", "believed"), [(2.5, True), (-3.5, False)])
@pytest.mark.parametrize("biased", [True, False])
def test_a_file_that_moves_such_a_value_far_is_not_handed_over(tolerances: float, believed: bool, biased: bool) -> None:
    records = recorded(MACHINE, (short(MACHINE),), seed=3, wrong=0.0)
    layout = parameters(with_units(MACHINE, records), 1)
    theta = np.zeros(layout.count)
    theta[layout.of("payload_mass")] = tolerances * layout.deviation[layout.of("payload_mass")]
    fitted: Any = SimpleNamespace(candidate=Candidate(layout, theta, ()))
    nothing: Any = None
    file = File("re-fitted", nothing, nothing, nothing, Finished(fitted))
    baseline = Baseline(
        fitted, records, (), Null({}, ((1.0,),) * NULL_DRAWS, (4.0,) * NULL_DRAWS, (), moved(layout) if biased else ())
    )
    assert is_believed(file, baseline) == (believed or not biased)
    assert is_believed(replace(file, finished=None), baseline)
    plain = Replayed(True, 1.0, 1.0, 0.1, 5, "a remedy", 0.0)
    for log in (replace(plain, command_late=2), replace(plain, mislogged=True)):
        assert not is_believed(file, replace(baseline, known_replays=(log,)))
