"""The nominal parameters: how far they may go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.experiments.schedules import strokes
from diagnosis.model.at_bounds import at_bounds, with_more_room
from diagnosis.model.fit import _step_bounds
from diagnosis.model.parameters import (
    LOOSE_BOUND_STDS,
    MASS_BOUND_STDS,
    PRIOR_BOUND_STDS,
    applied,
    bounded,
    moved,
    parameters,
    priors,
)
from diagnosis.model.residual import Candidate
from diagnosis.refit import refit
from models.friction import elements
from models.machine import Machine, Provenance, load
from tests.diagnosis.tables import recorded, table

MACHINE = table()


def test_a_negative_gain_keeps_its_sign_whatever_the_fit_does() -> None:
    """The parameters are logarithms of a factor, which no step turns round."""
    *others, last = MACHINE.plant.modes
    machine = replace(MACHINE, plant=replace(MACHINE.plant, modes=(*others, replace(last, gain=-last.gain))))
    layout = parameters(machine, 1)
    for theta in (layout.low, layout.high):
        modes = applied(layout, theta).plant.modes
        assert modes[-1].gain < 0 < modes[0].gain
    theta = np.where(layout.of("mode_gain")[-1] == np.arange(layout.count), 0.1, 0.0)
    assert applied(layout, theta).plant.modes[-1].gain == pytest.approx(-np.exp(0.1) * last.gain, rel=1e-14)


@pytest.mark.parametrize("deviations", [-2.0, 2.0])
def test_a_value_that_moved_up_is_larger_the_payloads_mass_as_well(deviations: float) -> None:
    layout = parameters(MACHINE, 1)

    def gone(name: str) -> np.ndarray:
        return np.where(layout.of(name)[0] == np.arange(layout.count), deviations * layout.deviation, 0.0)

    for name in ("payload_mass", "friction_level"):
        away = moved(layout, gone(name))
        machine, at = applied(layout, gone(name)), layout.of(name)[0]
        ratios = {
            "payload_mass": machine.plant.mass / MACHINE.plant.mass,
            "friction_level": machine.friction.coulomb_force / MACHINE.friction.coulomb_force,
        }
        assert np.log(ratios[name]) == pytest.approx(away[at] * layout.deviation[at], rel=1e-9)
        assert np.count_nonzero(away) == 1


def test_a_contact_may_start_at_its_fitted_limit() -> None:
    """Which may be larger than the file's: clipped to that one, no step of a precise axis' re-fit was taken."""
    layout = parameters(MACHINE, 2)
    theta = np.where(np.isin(layout.names, ["presliding_limit"]), layout.high, 0.0)
    limit = np.array(applied(layout, theta).friction.limit)
    assert np.all(limit > np.array(MACHINE.friction.limit))
    theta[layout.of("initial_friction_state")] = np.tile(limit, 2)
    assert np.allclose(bounded(layout, theta), theta, rtol=1e-12)


def test_no_contact_slips_beyond_the_travel() -> None:
    """An element that a file knows badly went to 157 m on an axis of 300 mm: it was a cable's spring."""
    friction = elements([1e5, 60.0], [2e-5, 50e-3])
    known = Provenance("identified", "a record", std=(2e-6, 45e-3))
    drive = replace(MACHINE.drive, travel=0.3)
    machine = replace(MACHINE, friction=friction, drive=drive, sources={"friction.limit": known})
    layout = parameters(machine, 2)
    within = applied(layout, bounded(layout, layout.high)).friction.limit
    assert within[1] == pytest.approx(0.3)
    assert within[0] < 1e-3
    beyond = parameters(replace(machine, friction=elements([1e5, 60.0], [2e-5, 0.4])), 1)
    assert applied(beyond, bounded(beyond, beyond.low)).friction.limit[1] < 0.3  # it may become shorter
    starts = layout.high[layout.of("initial_friction_state")]
    assert starts[[1, 3]] == pytest.approx([0.3, 0.3])
    free = parameters(replace(machine, drive=replace(drive, travel=0.0)), 2)
    assert applied(free, bounded(free, free.high)).friction.limit[1] > 0.5


@pytest.mark.parametrize("share", [0.5, 0.9, 0.995])  # of the Nyquist frequency
def test_no_re_fit_leads_a_mode_beyond_what_the_controller_samples(share: float) -> None:
    """A drawn machine's mode of 415 Hz went to 580 Hz at 1 kHz: its file could not be read, so there was no answer."""
    nyquist = 0.5 / MACHINE.sample_time
    modes = (*MACHINE.plant.modes[:1], replace(MACHINE.plant.modes[1], frequency=share * nyquist))
    machine = replace(MACHINE, plant=replace(MACHINE.plant, modes=modes))
    layout = parameters(machine, 1)
    hit = [one for one in at_bounds(Candidate(layout, layout.high, ())) if one.name == "mode_frequency"]
    for bounds in (layout, with_more_room(Candidate(layout, layout.high, ()), hit).layout):
        highest = applied(bounds, bounded(bounds, bounds.high)).plant.modes[1].frequency
        assert highest < nyquist
        assert highest >= share * nyquist * (1 - 1e-12)


def test_no_contact_starts_beyond_its_fitted_limit() -> None:
    """There a step of the fit would change nothing, although it was promised to."""
    layout = parameters(MACHINE, 2)
    theta = np.where(np.isin(layout.names, ["presliding_limit"]), layout.low, 0.0)
    limit = np.tile(np.array(applied(layout, theta).friction.limit), 2)
    theta[layout.of("initial_friction_state")] = 1.01 * limit
    assert np.allclose(bounded(layout, theta)[layout.of("initial_friction_state")], limit, rtol=1e-12)
    theta[layout.of("initial_friction_state")] = -1.01 * limit
    assert np.allclose(bounded(layout, theta)[layout.of("initial_friction_state")], -limit, rtol=1e-12)


def test_a_wrong_thrust_constant_is_found_where_the_mass_is_known() -> None:
    """The friction's force in newtons is right, and so it acts less in newtons of thrust reference."""
    wrong, right = 0.88, replace(MACHINE, drive=replace(MACHINE.drive, offset=1.0))
    truth = replace(
        right,
        plant=replace(right.plant, thrust_constant=wrong * right.plant.thrust_constant),
        friction=elements(
            np.array(right.friction.stiffness) / wrong, np.array(right.friction.limit), right.friction.damping
        ),
        drive=replace(right.drive, offset=1.0 / wrong),
    )
    known = replace(right, tolerance=replace(right.tolerance, mass=1e-3, thrust_constant=0.05))
    records = recorded(truth, [strokes(truth, 2e-3, (0.01, 0.02))], seed=3, wrong=0.0)
    found = refit(parameters(known, len(records)), records).candidate
    assert found.machine.plant.thrust_constant == pytest.approx(wrong, abs=0.01)
    assert found.machine.plant.modes[0].gain == pytest.approx(right.plant.modes[0].gain, rel=5e-3)
    assert found.machine.drive.offset == pytest.approx(1.0 / wrong, abs=0.2)
    assert "thrust_constant" not in parameters(right, 1).names


@given(st.floats(0, 1e-4), st.floats(-1, 1))
def test_no_dead_time_goes_below_zero(dead_time: float, share: float) -> None:
    machine = replace(MACHINE, plant=replace(MACHINE.plant, dead_time=dead_time))
    layout = parameters(machine, 1)
    theta = np.where(layout.of("dead_time")[0] == np.arange(layout.count), share * 1e-3, 0.0)
    found = applied(layout, bounded(layout, theta)).plant.dead_time
    assert 0.0 <= found <= dead_time + LOOSE_BOUND_STDS * layout.deviation[layout.of("dead_time")][0] * (1 + 1e-12)


def test_a_dead_time_that_is_neglected_may_be_any_that_a_drive_has() -> None:
    """Unless the file states how well it is known, or that there is none."""
    machine = load()
    none = replace(machine, plant=replace(machine.plant, dead_time=0.0))
    usual, half = machine.tolerances.dead_time, 0.5 * machine.sample_time
    assumed = {**machine.sources, "plant.dead_time": Provenance("assumed", "a guess")}
    given = {**machine.sources, "plant.dead_time": Provenance("datasheet", "the drive's manual")}
    stated = {**assumed, "tolerance.dead_time": Provenance("given", "measured")}
    for one, sources, expected in (
        (machine, assumed, usual), (none, assumed, half), (none, given, usual), (none, stated, usual)
    ):  # fmt: skip
        layout = parameters(replace(one, sources=sources), 1)
        assert layout.deviation[layout.of("dead_time")] == pytest.approx(expected)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_of_the_fit_takes_no_contact_beyond_its_fitted_limit(sign: int) -> None:
    """Also where the limit has shrunk below the start: no step is then the most that may be taken outwards."""
    records = recorded(MACHINE, (strokes(MACHINE, 2e-3, (0.01,)),), seed=3)
    layout = parameters(MACHINE, 1)
    theta, start = np.zeros(layout.count), layout.of("initial_friction_state")
    limit = np.array(MACHINE.friction.limit)
    for share in (0.5, 1.0, 1.01):
        theta[start] = sign * share * limit
        low, high = _step_bounds(Candidate(layout, theta), layout.deviation, records)
        outwards = (high if sign > 0 else -low)[start] * layout.deviation[start]
        assert np.allclose(outwards, np.minimum(max(1 - share, 0.0) * limit, layout.deviation[start]), atol=1e-15)
        assert np.all((low <= 0) & (high >= 0))


def test_a_stated_deviation_widens_a_prior_and_never_narrows_it() -> None:
    """An identification that is too sure of its mass must not turn a load into an effect; one that hardly knows it must
    not either. Bounds are as far as the usual ones, or three of the wider deviations."""
    rigid = MACHINE.plant.rigid
    name, gain, usual = f"plant.modes.{rigid + 1}.gain", MACHINE.plant.modes[rigid].gain, parameters(MACHINE, 1)

    def stating(share: float) -> Machine:
        return MACHINE.with_value(name, gain, Provenance("identified", "a record", std=share * gain))

    sure, vague, lost = (parameters(stating(share), 1) for share in (1e-6, 0.2, 5.0))
    assert np.array_equal(sure.deviation, usual.deviation)
    assert np.array_equal(sure.high, usual.high)
    (at,) = usual.of("payload_mass")
    assert vague.deviation[at] == pytest.approx(0.2)
    assert vague.high[at] == pytest.approx(max(MASS_BOUND_STDS * usual.deviation[at], PRIOR_BOUND_STDS * 0.2))
    assert lost.deviation[at] == 1.0
    others = np.arange(usual.count) != at
    assert np.array_equal(vague.deviation[others], usual.deviation[others])
    told = {one.name: one for one in priors(vague)}
    assert (told["payload_mass"].origin, told["payload_mass"].deviations) == ("value", (0.2, 0.2))
    assert told["dead_time"].origin == "usual"
    assert {one.name: one.origin for one in priors(sure)}["payload_mass"] == "usual"


def test_contacts_that_stand_in_for_each_other_widen_no_prior() -> None:
    """Each is open by a half and their sum is sure, as the file says: priors of a half each would open the sum."""
    stiffness = MACHINE.friction.stiffness
    shares = tuple((1.0 if i % 2 else -1.0,) for i in range(len(stiffness)))
    said = Provenance("identified", "x", std=tuple(0.5 * one for one in stiffness), shares=shares)
    layout, usual = parameters(MACHINE.with_value("friction.stiffness", stiffness, said), 1), parameters(MACHINE, 1)
    assert np.array_equal(layout.deviation, usual.deviation)


def test_each_contact_has_the_prior_that_the_file_knows_it_by() -> None:
    limit = MACHINE.friction.limit
    each = tuple((0.001 if i else 0.3) * one for i, one in enumerate(limit))
    layout = parameters(MACHINE.with_value("friction.limit", limit, Provenance("identified", "x", std=each)), 2)
    own, start = layout.of("presliding_limit"), layout.of("initial_friction_state")
    assert layout.deviation[own] == pytest.approx([0.3, *[MACHINE.tolerance.limit] * (len(limit) - 1)])
    assert layout.high[start[0]] == pytest.approx(limit[0] * np.exp(PRIOR_BOUND_STDS * 0.3))
    assert layout.high[start[1]] == pytest.approx(limit[1] * np.exp(PRIOR_BOUND_STDS * MACHINE.tolerance.limit))
