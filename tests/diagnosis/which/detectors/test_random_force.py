"""Random forces, discriminated from forces that repeat with the motions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from diagnosis.model.fit import fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.records.motions import numbered, pieces
from diagnosis.records.units import contact_length, loop_time
from diagnosis.which.detectors.random_force import (
    as_seen,
    at_rest,
    evenness,
    levels,
    steadiness,
    strongest_random_force,
    with_sines,
)
from diagnosis.which.detectors.scan import partial_out
from models.effects.base import Effect, Numbers, Place, T, V, hook
from models.effects.parameter import parameter
from models.effects.priors import Priors
from models.effects.structure import FloorVibration
from models.plant import Mode
from tests.diagnosis.slow import leg, moved

SLOW = 0.02  # m/s, below which the leg counts as at rest


@hook
def _shaking(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    size = p[0] if abs(now[V]) > SLOW else p[2]
    return value + size * math.sin(2 * math.pi * p[1] * now[T])


@dataclass(frozen=True)
class Shaking(Effect):
    """A line of one size in motion and of another at rest."""

    name: ClassVar = "shaking"
    family: ClassVar = "structure"
    equation: ClassVar = "d"
    source: ClassVar = "a test"
    hooks: ClassVar = {Place.FORCE: _shaking}
    depends_on_time: ClassVar = True
    moving: float = parameter("N", "size in motion", 0.1, 10.0, "amplitude")
    frequency: float = parameter("Hz", "frequency", 1.0, 100.0, "shape", above=0)
    resting: float = parameter("N", "size at rest", 0.1, 10.0, "amplitude")


def test_a_force_that_is_there_after_some_motions_only_is_not_steady() -> None:
    rng, ts = np.random.default_rng(3), 5e-4
    t = np.arange(60_000) * ts
    floor = np.sin(2 * np.pi * 8.0 * t + 0.3 * np.cumsum(rng.standard_normal(t.size)) * ts**0.5)
    since = t % 10.0  # a motion every ten seconds, after which it decays
    slosh = np.exp(-since / 0.5) * np.sin(2 * np.pi * 8.0 * since)
    noise = 0.1 * rng.standard_normal(t.size)

    assert steadiness([floor + noise], 8.0, ts) > 0.8
    assert steadiness([slosh + noise], 8.0, ts) < 0.2


def test_an_axis_rests_once_its_reference_has_stood_still_for_a_while() -> None:
    """5.5 loop times of the leg are as many samples; a slow move is none beside a fast one, nor is the scale's step."""
    machine = leg(500.0)
    record = moved(machine, seed=2, count=3000)
    samples = round(5.5 * loop_time(machine) / record.sample_time)
    contact = contact_length(machine)
    way = np.concatenate([np.zeros(500), np.linspace(0, 0.3, 100), np.full(900, 0.3)])
    slow = 0.3 + contact * np.concatenate([np.linspace(0, 2, 500), np.full(1000, 2)])
    reference = np.concatenate([way, slow])
    found = at_rest(replace(record, reference=reference, feedforward=np.zeros(3000)), machine)
    begins = [501, 600 + samples, 1501, 2000 + samples]
    assert found[: begins[0]].all()
    assert not found[begins[0] : begins[1] - 1].any()
    assert found[begins[1] : begins[2]].all()
    assert not found[begins[2] + samples : begins[3] - samples].any()
    assert found[begins[3] :].all()
    noisy = reference + 0.01 * contact * np.sin(np.arange(3000))
    assert np.mean(at_rest(replace(record, reference=noisy, feedforward=np.zeros(3000)), machine) == found) > 0.95
    excited = replace(record, reference=reference, feedforward=np.sin(np.arange(3000)))
    assert not at_rest(excited, machine)[1:].any(), "what the feedforward excites does not rest"


def test_a_floor_shakes_as_much_at_rest_as_in_motion() -> None:
    """Gains of a force that is there at all times, of one in motion only and of one at rest only, beside chance."""
    rng = np.random.default_rng(8)
    resting = np.arange(9000) % 30 < 20
    always, moving, still = (
        0.3 * there + rng.standard_normal(9000) for there in (np.ones(9000), 3.0 * ~resting, 1.5 * resting)
    )
    low, high = evenness(always, resting)
    assert 0.5 < low < 1 < high
    for locked in (moving, still):
        assert evenness(locked, resting)[1] < 0.3
    assert evenness(always / 30, resting)[0] < 0.5 < evenness(always / 30, resting)[1], "so small a gain tells neither"
    assert evenness(always, np.zeros(9000, bool)) == (0.0, np.inf), "nothing tells where the axis never rests"
    assert evenness(np.zeros(0), np.zeros(0, bool)) == (0.0, np.inf)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_line_that_is_there_in_motion_only_is_no_floor(share: float) -> None:
    """Nearly a third of the friction in motion, and a share of that at rest."""
    machine = leg(500.0)
    machine = replace(machine, scale=replace(machine.scale, resolution=1e-7, noise=3e-8))
    record = moved(replace(machine, effects=(Shaking(0.2, 37.0, 0.2 * share),)), seed=2, count=6000)
    layout = parameters(machine, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), [record])
    found = strongest_random_force(fitted, [record], partial_out(fitted, numbered(pieces([record]), [record])))
    assert found is not None
    assert found.resonance.frequency == pytest.approx(37.0, abs=0.2)
    assert found.gain > 300
    if share:
        assert found.even == pytest.approx((1.0, 1.0), abs=0.2)
    else:
        assert found.even[1] < 0.5


@pytest.mark.parametrize("size", [1.0, 0.025, 40.0])
def test_levels_go_with_what_the_white_force_hides_and_the_friction_holds(size: float) -> None:
    found = np.array(levels(0.08 * size, 16.5 * size)) / size
    assert found == pytest.approx([0.01, 0.0316, 0.1, 0.316], rel=1e-2)
    assert levels(0.08e-2, 16.5)[-1] == pytest.approx(0.316, rel=1e-2)
    assert len(levels(16.5, 16.5)) == len(found)


@pytest.mark.parametrize("rate", [62.5, 4.0])
def test_slow_records_are_searched_below_half_their_rate(rate: float) -> None:
    """Where the usual 30 Hz lies beyond what such records hold; at 4 Hz nothing is left to search."""
    machine = leg(rate)
    record = moved(machine, seed=2).part(0, 400)
    layout = parameters(machine, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), [record])
    number = numbered(pieces([record]), [record])
    found = strongest_random_force(fitted, [record], partial_out(fitted, number))
    assert (found is None) == (rate < 5)
    if found is not None:
        assert found.resonance.frequency < 0.4 * rate
        assert np.isfinite(found.steady)


@pytest.mark.parametrize("share", [0.0513, 0.1377, 0.2919])
def test_a_line_is_found_wherever_the_record_shows_it(share: float) -> None:
    """Of an axis without modes, at a share of the sampling rate beyond what such a loop's usual range reaches, and
    narrower than the steps of any grid of that range."""
    machine = leg(500.0)
    machine = replace(machine, scale=replace(machine.scale, resolution=1e-7, noise=3e-8))
    frequency = share / machine.sample_time
    shaken = replace(machine, effects=(FloorVibration(0.1 * (share / 0.05) ** 2, frequency, 1.0),))
    record = moved(shaken, seed=2, count=6000)
    layout = parameters(machine, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), [record])
    found = strongest_random_force(fitted, [record], partial_out(fitted, numbered(pieces([record]), [record])))
    assert found is not None
    assert found.resonance.frequency == pytest.approx(frequency, abs=1e-2)
    assert found.gain > 100
    assert found.steady > 0.5


@pytest.mark.parametrize("about", [None, 46.4, 85.0])
def test_above_half_of_the_lowest_mode_a_line_is_found_where_it_is_looked_for(about: float | None) -> None:
    """What a wrong mode leaves would pass for one: but where a mode is about to be named, a line is looked for."""
    machine = leg(500.0)
    (rigid,) = machine.plant.modes
    soft = replace(machine.plant, modes=(rigid, Mode(0.1 * rigid.gain, 62.0, 0.03)))
    machine = replace(machine, plant=soft, scale=replace(machine.scale, resolution=1e-7, noise=3e-8))
    record = moved(replace(machine, effects=(FloorVibration(0.6, 47.0, 1.0),)), seed=2, count=6000)
    layout = parameters(machine, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), [record])
    own = partial_out(fitted, numbered(pieces([record]), [record]))
    found = strongest_random_force(fitted, [record], own, about)
    assert found is not None
    if about == 46.4:
        assert found.resonance.frequency == pytest.approx(47.0, abs=1e-2)
        assert found.gain > 1000
    else:
        assert abs(found.resonance.frequency - 47.0) > 1.0


@pytest.mark.parametrize("size", [0.3, 3.0, 10.0])
def test_a_line_is_as_large_as_it_is(size: float) -> None:
    """Beyond the levels that are tried, too, which end at a fiftieth of the friction: 0.34 N had been told of 1 N, at
    47.9 Hz for 48."""
    machine = leg(500.0)
    machine = replace(machine, scale=replace(machine.scale, resolution=1e-7, noise=3e-8))
    shaken = replace(machine, effects=(FloorVibration(size, 37.13, 1.0),))
    records = [moved(shaken, seed=seed, count=6000) for seed in (2, 3)]
    layout = parameters(machine, 2)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), records)
    found = strongest_random_force(fitted, records, partial_out(fitted, numbered(pieces(records), records)))
    assert found is not None
    assert found.resonance.frequency == pytest.approx(37.13, abs=5e-3)
    with_it = fit(
        replace(fitted.candidate, random_forces=(found.resonance,)), records, paths=fitted.paths, walk=fitted.walk
    )
    (line,) = as_seen(with_it, records).candidate.random_forces
    (sine,) = with_sines(replace(fitted.candidate, random_forces=(line,))).effects
    assert isinstance(sine, FloorVibration)
    assert sine.amplitude == pytest.approx(size, rel=0.1)


def test_a_narrow_stated_range_hides_no_line_in_it_and_keeps_others_out() -> None:
    """Two lines; the weaker one is in the range that the machine states, which is hardly wider than the line."""
    machine = leg(500.0)
    ranges = Priors.of({("floor_vibration", "frequency"): (60.0, 61.0)}, machine.priors.units)
    machine = replace(machine, scale=replace(machine.scale, resolution=1e-7, noise=3e-8), priors=ranges)
    lines = (FloorVibration(0.3, 60.4, 1.0), FloorVibration(1.0, 41.0, 0.0))
    record = moved(replace(machine, effects=lines), seed=2, count=6000)
    layout = parameters(machine, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), [record])
    found = strongest_random_force(fitted, [record], partial_out(fitted, numbered(pieces([record]), [record])))
    assert found is not None
    assert found.resonance.frequency == pytest.approx(60.4, abs=0.2)
