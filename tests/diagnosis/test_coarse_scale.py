"""Where the re-fit would move values of a table with nothing wrong, it is weighed until it moves them no more."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import baseline as module
from diagnosis.baseline import Baseline, refit_and_null
from diagnosis.diagnose import diagnosed
from diagnosis.handover.files import starts_of
from diagnosis.handover.final_fit import Finished, finished
from diagnosis.handover.gate import File, as_delivered, is_believed, is_right
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.null import NULL_DRAWS, Null
from diagnosis.records.motions import pieces
from diagnosis.records.units import loop_time, with_units
from diagnosis.refit import refit_under, refit_within
from models.effects.catalogue import looked_for
from models.effects.friction_laws import ViscousFriction
from tests.diagnosis.tables import recorded, short, table

MACHINE = table()
BIASED = {"friction_level": -5.4, "payload_mass": -4.2, "dead_time": 1.5}


class Chance:
    """A null whose tables are moved by BIASED, unless their weights are at least those of so rough a drive."""

    def __init__(self, layout: Any, roughness: tuple[float, ...], enough: float) -> None:
        names = [name for name in layout.names if name != "initial_friction_state"]
        size = max(roughness, default=1.0) < enough
        scatter = 0.1 * np.random.default_rng(1).standard_normal((NULL_DRAWS, len(names)))
        moved = scatter + np.array([size * BIASED.get(name, 0.0) for name in names])
        self.usual = None
        self.found = Null({}, ((1.0,),) * NULL_DRAWS, (4.0,) * NULL_DRAWS, (), tuple(map(tuple, moved.tolist())))

    def completed(self, _: object) -> Null:
        return self.found


@pytest.mark.parametrize(("enough", "taken"), [(1.0, ()), (2.0, (3.0,)), (5.0, (10.0,)), (99.0, (10.0,))])
def test_the_weights_are_those_under_which_no_value_is_moved(
    enough: float, taken: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def begun(layout: Any, *_: object, roughness: tuple[float, ...] = (), **__: object) -> Chance:
        asked.append(roughness)
        return Chance(layout, roughness, enough)

    monkeypatch.setattr(module, "start_null", begun)
    records = recorded(MACHINE, (short(MACHINE),), seed=3)
    found = refit_and_null(MACHINE, records)
    assert found.nominal.candidate.roughness == taken
    assert asked[-1] == taken
    assert list(found.biased) == (["friction_level", "payload_mass"] if taken else [])
    assert found.null.bias().max() <= (2.0 if enough < 99.0 else 10.0)
    if taken:
        assert found.biased["friction_level"] == pytest.approx(-5.4, abs=0.2)


def test_a_value_that_is_moved_by_a_few_tolerances_hides_no_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """A dead time that was moved by 2.0 and a contact's stiffness by 2.4 had made the weights ten times as large, so
    that nothing had a name on two machines of the trial."""
    monkeypatch.setitem(BIASED, "friction_level", -2.4)
    monkeypatch.setitem(BIASED, "payload_mass", 0.0)
    monkeypatch.setattr(module, "start_null", lambda layout, *_, **__: Chance(layout, (), 99.0))
    records = recorded(MACHINE, (short(MACHINE),), seed=3)
    found = refit_and_null(MACHINE, records)
    assert found.nominal.candidate.roughness == ()
    assert list(found.biased) == ["friction_level"]  # told, and no file that moves it far is handed over
    assert not found.weighed_for_bias


def test_what_is_found_beside_such_weights_does_not_lower_them() -> None:
    """Chi-square per sample is below 1 under them, by which a rough drive's would be estimated anew."""
    records = recorded(MACHINE, (short(MACHINE),), [ViscousFriction(400.0)], seed=3, wrong=0.0)
    machine = with_units(MACHINE, records)
    nominal = refit_under(refit_within(machine, records), records, 3.0)
    names = dict.fromkeys(looked_for(), (0.0,))
    chance = Null(names, ((1.0,),) * NULL_DRAWS, (4.0,) * NULL_DRAWS)
    found = diagnosed(
        Baseline(nominal, records, pieces(records, loop_time(machine)), chance, biased={"payload_mass": -4.0}),
        disabled=[name for name in looked_for() if name != "viscous_friction"],
    )
    assert "viscous_friction" in (*found.effects, *found.partly)
    assert found.final.candidate.roughness == (3.0,)


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
        fitted, records, (), Null({}, ((1.0,),), (4.0,)), biased={"payload_mass": -4.0} if biased else {}
    )
    assert is_believed(file, baseline) == (believed or not biased)
    assert is_believed(replace(file, finished=None), baseline)
