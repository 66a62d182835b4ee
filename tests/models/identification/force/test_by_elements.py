"""Friction elements from slow records of any speed and scale, and the zero-phase low-pass of their fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cheby1, sosfilt_zi, sosfiltfilt

from models.friction import branch, deflections, elements, follow
from models.identification.force import by_elements
from models.identification.force.by_elements import _fitted, _lag_beside_the_scale, identify
from models.identification.force.fit import DAMPING
from models.identification.force.linear import FEWEST, prepared, slopes
from models.identification.force.signals import Terms, fast_band, limit_range, slow_band, there_and_back
from models.identification.unusable import UnusableError
from models.records.record import Record

FORCE = 4.0  # N
LIMITS = np.geomspace(0.1e-6, 25e-6, 60)
MANY = elements(FORCE * LIMITS**-1.3 / np.sum(LIMITS**-0.3), LIMITS)


def loops(sample_time: float, step: float = 1e-9, drag: float = 0.0) -> Record:
    """Two loops of 4000 samples over 110 um and four inner ones, read in steps [m]; drag [N s/m]. No mass."""
    angle = 2 * np.pi * np.arange(16_001) / 4000
    path = 55e-6 * np.where(angle < 4 * np.pi, np.sin(angle), 0.25 * np.sin(2 * angle))
    force = follow(MANY, path)[0] + drag * np.gradient(path, sample_time)
    still = np.zeros(path.size)
    return Record(sample_time, path, path, still, force, step * np.round(path / step))


def test_elements_do_not_depend_on_how_fast_the_loops_were() -> None:
    """Friction does not depend on the speed, so that a band in hertz, the same for all, would be wrong."""
    bands = [slow_band(loops(ts)) for ts in (1.25e-4, 1.25e-3)]
    assert bands == pytest.approx([160.0, 16.0], rel=1e-3)
    faster, slower = (
        identify(loops(ts), Terms(mass=0.0), pass_band=band).friction
        for ts, band in zip((1.25e-4, 1.25e-3), bands, strict=True)
    )
    assert slower.limit == pytest.approx(faster.limit, rel=1e-6)
    assert slower.stiffness == pytest.approx(faster.stiffness, rel=1e-6)


def test_limits_are_looked_for_beside_those_of_the_machine_file() -> None:
    """Between 0.4 um and 22 mm for every axis, of metres or radians: contacts of 0.05 urad came out at 0.2 urad, with a
    deviation of nothing like it. One that ends where the search did is told."""
    path = 5e-4 * np.sin(2 * np.pi * np.arange(16_001) / 8000)
    few = elements(10 / np.geomspace(50e-9, 1e-6, 3), np.geomspace(50e-9, 1e-6, 3))
    record = Record(5e-4, path, path, np.zeros(path.size), follow(few, path)[0], path)
    terms = Terms(mass=0.0, likely_limit=1e-6)
    assert limit_range(prepared(record, terms, 900.0, np.inf)) == pytest.approx((4e-9, 2.25e-4), rel=1e-3)
    assert identify(record, terms, pass_band=900.0, most=1).least == 0
    far = identify(record, Terms(mass=0.0), pass_band=900.0, most=1)
    assert far.least == pytest.approx(2e-6, rel=1e-3)
    assert far.friction.limit[0] <= far.least


@pytest.mark.parametrize("drift", [0.0, 1e-3])
def test_loops_on_a_way_have_the_band_of_loops(drift: float) -> None:
    """Their way was the largest line: of 20 loops along 1 mm in 40 s the band was 2 Hz in place of 40."""
    time = 1e-3 * np.arange(40_000)
    path = 2e-4 * np.sin(np.pi * time) + drift * time / 40
    assert slow_band(Record(1e-3, path, path, path, path, path)) == pytest.approx(40.0, rel=0.01)
    places = 2e-4 * np.sin(np.pi * time) + drift * np.floor(time / 10)
    assert slow_band(Record(1e-3, places, places, places, places, places)) == pytest.approx(40.0, rel=0.01)


def test_contacts_are_the_same_in_another_unit_of_length_and_none_is_far_shorter_than_a_step() -> None:
    """Of an axis that turns, read in steps of 2.4 urad, a contact of 0.2 urad was found: the shortest of a table."""
    record = loops(1.25e-4, step=1e-6)
    wide = replace(record, position=25 * record.position)
    near, far = (identify(one, Terms(mass=0.0), pass_band=160.0).friction for one in (record, wide))
    assert min(far.limit) > 0.2 * 25 * 1e-6
    assert min(far.limit) == pytest.approx(25 * min(near.limit), rel=0.02)
    distance = np.geomspace(1e-6, 6e-5, 80)
    assert np.abs(branch(far, 25 * distance) - branch(near, distance)).max() < 0.01 * FORCE


def strokes(seconds: float, wait: float, sample_time: float = 1e-3) -> Record:
    """Strokes of 50 mm to and fro, each in so many seconds, and as long a wait [s] behind each."""
    share = np.linspace(0, 1, round(seconds / sample_time))
    there = np.append(share**3 * (10 - 15 * share + 6 * share**2), np.ones(round(wait / sample_time)))
    path = 0.05 * np.tile(np.append(there, 1 - there), 3)
    return Record(sample_time, *[path] * 5)


def test_the_band_of_a_fast_record_is_that_of_its_motion() -> None:
    """In units of its own time and way, hardly of its scale's noise, not of the wait, and below the lowest mode."""
    record = strokes(0.25, 2.0)
    band = fast_band(record, np.inf)
    assert 30 < band < 60
    assert band > 2 * slow_band(record)
    assert fast_band(replace(record, sample_time=100 * record.sample_time), np.inf) == pytest.approx(band / 100)
    assert fast_band(replace(record, position=7 * record.position), np.inf) == pytest.approx(band)
    assert fast_band(strokes(0.25, 4.0), np.inf) == pytest.approx(band, rel=0.05)
    assert fast_band(strokes(0.5, 2.0), np.inf) == pytest.approx(0.5 * band, rel=0.05)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(record.position.size)
    assert fast_band(replace(record, position=record.position + noise), np.inf) == pytest.approx(band, rel=0.1)
    assert fast_band(record, 0.5 * band) == pytest.approx(0.35 * band)


def test_quick_loops_on_a_fine_scale_show_the_curve_better_than_a_band_for_slow_ones_lets_them() -> None:
    record, distance = loops(1.25e-4), np.geomspace(1e-7, 6e-5, 80)

    def error(band: float) -> float:
        found = identify(record, Terms(mass=0.0), pass_band=band).friction
        return float(np.std(branch(found, distance) - branch(MANY, distance))) / FORCE

    assert error(slow_band(record)) < 0.02
    assert error(slow_band(record)) < 0.4 * error(20.0)
    assert min(identify(record, Terms(mass=0.0), pass_band=slow_band(record)).friction.limit) < 0.2e-6


def test_viscous_friction_that_is_known_is_taken_off() -> None:
    record, plain = loops(1.25e-4, drag=12.0), loops(1.25e-4)
    found = identify(record, Terms(mass=0.0, drag=12.0), pass_band=80.0)
    without = identify(plain, Terms(mass=0.0), pass_band=80.0)
    assert found.friction.limit == pytest.approx(without.friction.limit, rel=0.02)
    assert found.slip_force()[0] == pytest.approx(FORCE, rel=1e-3)


@pytest.mark.parametrize("band", [0.01, 0.2, 0.7])
@pytest.mark.parametrize("shape", [(FEWEST, 1), (5000, 3)])
def test_the_low_pass_is_scipy_s_to_the_last_digit(band: float, shape: tuple[int, int]) -> None:
    sections = cheby1(8, 0.05, band, output="sos")
    walk = np.cumsum(np.random.default_rng(1).standard_normal(shape), axis=0)
    found = there_and_back(sections, sosfilt_zi(sections), walk)
    assert np.array_equal(found, sosfiltfilt(sections, walk, axis=0))


@pytest.mark.parametrize("late", [8, 16])
def test_a_delay_of_many_samples_is_found_beside_the_likely_one(late: int) -> None:
    """At 10 kHz the delay had ended at five samples, and 12 kg came out as 12.4 with no word on it."""
    given, likely = strokes(0.1, 0.05, 1e-4), 1e-3
    few = elements(10 / np.geomspace(20e-6, 60e-6, 2), np.geomspace(20e-6, 60e-6, 2))
    force = follow(few, given.position)[0] + 12 * np.gradient(np.gradient(given.position, 1e-4), 1e-4)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(force.size)
    record = replace(given, command=np.append(force[late:], np.full(late, force[-1])) + noise)
    terms = Terms(viscous=True, delay=True, likely_delay=likely, likely_limit=60e-6)
    found = identify(record, terms, pass_band=100.0, fit_until=0.8).estimate
    assert found.value("delay") == pytest.approx(late * 1e-4, abs=1e-5)
    assert found.value("mass") == pytest.approx(12.0, rel=2e-3)
    with pytest.raises(
        UnusableError, match=r"after the command, or more: sought was up to 500 µs to either side of 5 m"
    ):
        identify(record, replace(terms, likely_delay=5e-3), pass_band=500.0, fit_until=0.8)


def test_strokes_that_grow_are_fitted_where_the_memory_has_ended() -> None:
    """The farthest one comes behind the part that is fitted: no sample was left, which NumPy told."""
    given = strokes(0.1, 0.05, 1e-3)
    grown = np.concatenate([size * given.position for size in (1.0, 1.5, 2.0)])
    few = elements(10 / np.geomspace(20e-6, 60e-6, 2), np.geomspace(20e-6, 60e-6, 2))
    force = follow(few, grown)[0] + 12 * np.gradient(np.gradient(grown, 1e-3), 1e-3)
    noisy = force + 1e-3 * np.random.default_rng(1).standard_normal(force.size)
    record = Record(1e-3, grown, grown, np.zeros(force.size), noisy, grown)
    found = identify(record, Terms(likely_limit=60e-6), pass_band=100.0, fit_until=0.5 * grown.size * 1e-3)
    assert found.estimate.value("mass") == pytest.approx(12.0, rel=0.02)
    assert 0.3 < np.mean(found.used) < 0.7


FEW = elements(0.8 / np.geomspace(3e-6, 25e-6, 5), np.geomspace(3e-6, 25e-6, 5))


def read_by(error: float, period: float, lag: float = 0.0) -> Record:
    """Loops over five elements that are damped by a lag [s] times their stiffness, read by a scale with a periodic
    error [m]: two wide ones, and four inner ones at half of their speed."""
    record, stiffness, limits = loops(5e-4), np.array(FEW.stiffness), np.array(FEW.limit)
    path, noise = record.reference, np.random.default_rng(1).standard_normal(record.reference.size)
    speed = np.gradient(path, record.sample_time)
    ahead = deflections(limits, path, np.zeros(limits.size)) + lag * speed[:, None]
    reading = path + error * np.sin(2 * np.pi * path / period + 0.4)
    command = np.clip(ahead, -limits, limits) @ stiffness + 0.01 * noise
    return replace(record, command=command, position=1e-9 * np.round(reading / 1e-9))


@pytest.mark.parametrize(("error", "period"), [(0.2e-6, 100e-6), (0.4e-6, 150e-6)])
def test_an_error_of_the_scale_is_no_damping(error: float, period: float) -> None:
    """Alone, a lag of five deviations fits it: a wide loop and an inner one see other errors, at other speeds."""
    record, terms = read_by(error, period), Terms(mass=0.0, damped=True)
    misled = _fitted(record, terms, 20.0, np.inf, 20).estimate
    assert misled.value(DAMPING) > 4 * misled.deviation(DAMPING)
    found = identify(record, terms, pass_band=20.0)
    assert not found.damped
    assert found.lag is not None
    assert abs(found.lag[0]) < 3 * found.lag[1] < 0.3e-3


@pytest.mark.parametrize("error", [0.0, 0.2e-6])
def test_damping_beside_an_error_of_the_scale_is_within_its_deviation(error: float) -> None:
    found = identify(read_by(error, 100e-6, 5e-3), Terms(mass=0.0, damped=True), pass_band=20.0)
    assert found.damped
    assert found.lag is not None
    assert abs(found.lag[0] - 5e-3) < 3 * found.lag[1]
    assert found.lag[1] == pytest.approx(found.estimate.deviation(DAMPING))


def test_damping_on_which_the_gains_of_passes_disagree_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was taken where each of the two is sure: then "0.0445 ms times K, with a deviation of 5.3 ms" was printed."""
    monkeypatch.setattr(by_elements, "_lag_beside_the_scale", lambda *_: (20e-3, 1e-4))
    found = identify(read_by(0.0, 100e-6, 5e-3), Terms(mass=0.0, damped=True), pass_band=20.0, most=2)
    assert not found.damped


def test_a_step_that_the_gains_of_passes_leave_open_is_no_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """With columns that depend on each other it had come to -9.1e8 ms, which was printed, or passed for a bound."""
    record, terms = read_by(0.0, 100e-6, 5e-3), Terms(mass=0.0, damped=True)
    fit = _fitted(record, terms, 20.0, np.inf, 2)
    weak = np.where(np.array(fit.estimate.names) == DAMPING, 1e-9, 1.0)
    monkeypatch.setattr(by_elements, "slopes", lambda *given: slopes(*given) * weak)
    freed = _lag_beside_the_scale(prepared(record, terms, 20.0, np.inf), fit)
    assert freed == pytest.approx((fit.estimate.value(DAMPING), 100 * record.sample_time))
