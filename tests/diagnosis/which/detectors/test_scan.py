"""The catalogue scan: periods of any length, and columns that are known from the stage before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.criteria import Criteria
from diagnosis.model.fit import bounds_of, parameters_at_bounds
from diagnosis.records.motions import numbered, pieces
from diagnosis.refit import refit_within
from diagnosis.which.detectors.scan import partial_out, peaks, scan
from models.effects.base import Effect, parameters
from models.effects.friction_laws import PositionDependentFriction, Stribeck
from models.effects.motor import Cogging, ThrustRipple
from models.effects.priors import Priors
from models.effects.structure import AdditionalMode
from tests.diagnosis.tables import fitted_with, recorded, schedules, short, table

MACHINE = table()
PLAN = schedules(MACHINE)


@pytest.mark.parametrize("range_", [(1e-3, 4e-3), (1.9e-3, 2.1e-3), (1.999e-3, 2.001e-3)])
def test_a_period_is_found_in_however_narrow_a_range(range_: tuple[float, float]) -> None:
    place = np.linspace(0.0, 0.03, 20_000)
    found = peaks([(place, np.sin(2 * np.pi * place / 2e-3))], *range_, padded=8)
    assert found
    assert all(0.999 * range_[0] <= period <= 1.001 * range_[1] for period in found)


def test_long_waves_do_not_hide_a_short_one() -> None:
    """They are 30 times as strong, and there are more of them than lines are taken."""
    place = np.linspace(0.0, 0.03, 50_000)
    long = sum(np.sin(2 * np.pi * place / period) for period in (0.012, 9e-3, 7e-3, 5.5e-3, 4.5e-3, 3.5e-3))
    found = peaks([(place, 30 * long + np.sin(2 * np.pi * place / 4e-5))], 2e-5, 0.02)
    assert any(period == pytest.approx(4e-5, rel=2e-3) for period in found)


def test_a_screw_s_lead_is_found_without_a_word_in_the_file() -> None:
    """It is a tenth of the shortest usual pitch."""
    law = Cogging(1.0, 2.345e-3, 1.0)
    records = recorded(MACHINE, (short(MACHINE),), [law], seed=15)
    nominal = refit_within(MACHINE, records)
    found, _ = scan(nominal, records, partial_out(nominal, numbered(pieces(records), records)))
    assert found[0].effect.name == law.name
    (adopted,) = fitted_with(nominal, found[0].effect, records).candidate.effects
    assert adopted.values()[:2] == pytest.approx(law.values()[:2], rel=0.1)
    assert not parameters_at_bounds(adopted, MACHINE.priors)


@pytest.mark.parametrize(
    "law",
    [
        Cogging(1.0, 2.345e-3, 1.0),
        ThrustRipple(0.05, 2.345e-3, 1.0),
        PositionDependentFriction(0.1, 1.234e-3, 1.0),
    ],
    ids=lambda law: law.name,
)
def test_a_period_far_below_the_usual_ones_is_found_where_a_machine_states_it(law: Effect) -> None:
    """By a spectrum over the path, as no grid of periods would be near enough."""
    period = "length" if law.name == "position_dependent_friction" else "pitch"
    stated = replace(MACHINE, priors=Priors.of({(law.name, period): (1e-3, 5e-3)}))
    records = recorded(MACHINE, (short(MACHINE),), [law], seed=15)
    nominal = refit_within(stated, records)
    found, _ = scan(nominal, records, partial_out(nominal, numbered(pieces(records), records)))
    best = found[0].effect
    assert best.name == law.name
    fitted = fitted_with(nominal, best, records)
    (adopted,) = fitted.candidate.effects
    assert adopted.values()[:2] == pytest.approx(law.values()[:2], rel=0.1)
    assert adopted.values()[1] == pytest.approx(law.values()[1], rel=1e-3)
    assert not parameters_at_bounds(adopted, stated.priors)


@pytest.mark.parametrize("law", [AdditionalMode(-7e-3, 635.0, 0.01), AdditionalMode(7e-3, 590.0, 0.01)])
def test_a_mode_faster_than_the_usual_ones_is_found_with_the_sign_of_its_gain(law: AdditionalMode) -> None:
    (usual,) = (item for item in parameters(AdditionalMode, MACHINE.priors) if item.name == "frequency")
    assert law.frequency > 1.3 * usual.high
    records = recorded(MACHINE, (short(MACHINE),), [law], seed=15)
    nominal = refit_within(MACHINE, records)
    found, _ = scan(nominal, records, partial_out(nominal, numbered(pieces(records), records)))
    assert found[0].effect.name == law.name
    (adopted,) = fitted_with(nominal, found[0].effect, records).candidate.effects
    gain, frequency, _ = adopted.values()
    assert frequency == pytest.approx(law.frequency, rel=law.damping)
    assert np.sign(gain) == np.sign(law.gain)
    assert not parameters_at_bounds(adopted, MACHINE.priors)


@pytest.mark.parametrize("law", [AdditionalMode(2e-3, 67.0, 0.01), AdditionalMode(2e-3, 18.0, 0.03)])
def test_a_mode_slower_than_the_usual_ones_is_found(law: AdditionalMode, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also below where the loop crosses over, and to its width between the points of a grid."""
    (usual,) = (item for item in parameters(AdditionalMode, MACHINE.priors) if item.name == "frequency")
    assert usual.widest[0] == pytest.approx(0.25 / (2 * np.pi * MACHINE.priors.units.loop))
    assert usual.widest[0] < law.frequency < 0.7 * usual.low
    records = recorded(MACHINE, (short(MACHINE),), [law], seed=15)
    nominal = refit_within(MACHINE, records)
    monkeypatch.setattr("diagnosis.which.detectors.scan.VISIBLE_SIGNALS", {AdditionalMode.shown_in()})
    found, _ = scan(nominal, records, partial_out(nominal, numbered(pieces(records), records)))
    best = next(one for one in found if one.effect.name == law.name)
    assert isinstance(best.effect, AdditionalMode)
    assert best.effect.frequency == pytest.approx(law.frequency, rel=2 * law.damping)
    assert best.held_out == max(one.held_out for one in found)
    (adopted,) = fitted_with(nominal, best.effect, records).candidate.effects
    assert adopted.values() == pytest.approx(law.values(), rel=0.1)


def test_no_mode_is_sought_where_samples_do_not_tell_it() -> None:
    (usual,) = (item for item in parameters(AdditionalMode, MACHINE.priors) if item.name == "frequency")
    assert bounds_of(usual)[1] == pytest.approx(0.8 * 0.5 / MACHINE.sample_time)


def test_what_is_known_of_a_scan_tells_the_next_stage_what_its_own_columns_would() -> None:
    """An effect in the model changes the columns of others to second order only."""
    records = recorded(MACHINE, PLAN, [Cogging(1.5, 0.035, 1.0), Stribeck(0.1, 2e-3)], seed=13)
    nominal = refit_within(MACHINE, records)
    segment = numbered(pieces(records), records)
    _, known = scan(nominal, records, partial_out(nominal, segment))
    first = fitted_with(nominal, Cogging(1.5, 0.035, 1.0), records)
    projection = partial_out(first, segment)
    plain, reused = (
        {one.effect.name: one.held_out for one in scan(first, records, projection, known=k)[0]} for k in ({}, known)
    )
    assert max(plain, key=lambda name: plain[name]) == "stribeck"
    assert reused == pytest.approx(plain, rel=0.05, abs=0.1 * Criteria().min_gain)
