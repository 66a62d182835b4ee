"""The nested judgement, on synthetic innovations: what transfers, what does not, and what no other type shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.learned.curves_tried import Curve
from diagnosis.learned.learn import objection
from diagnosis.learned.left_out import Judgement, judgement, shown_from, summed
from diagnosis.records.units import units
from models.effects.measured import Measured
from models.machine import load

Array = NDArray[np.float64]

KNOTS = tuple(np.linspace(0.0, 1.0, 9).tolist())
TYPES = 4
MOTIONS, EACH = 24, 300  # six motions of each type
KIND = np.arange(MOTIONS) % TYPES
MOTION = np.repeat(np.arange(MOTIONS), EACH)
NAMES = ["slow", "fast", "long", "short"]


def judged(
    force: Callable[[Array, NDArray[np.int64]], Array], reach: tuple[float, ...] = (1.0,) * TYPES, noise: float = 1.0
) -> Judgement:
    """What is said of a force (n,) over place and type of motion, in white noise; reach: how far each type goes; noise:
    the squares that a complete model is said to leave, over those that it leaves."""
    rng = np.random.default_rng(1)
    of_sample = KIND[MOTION]
    place = rng.random(MOTION.size) * np.array(reach)[of_sample]
    hats = np.column_stack([np.interp(place, KNOTS, row) for row in np.eye(len(KNOTS))])
    e = rng.standard_normal(MOTION.size) + force(place, of_sample)
    curve = Curve(Measured("position", KNOTS, (0.0,) * len(KNOTS)), hats, np.ones(len(hats)))
    tests = [summed(curve, -hats, e, MOTION, KIND, least=20.0)]
    return judgement(dict.fromkeys(range(TYPES), tests), e**2 - noise, MOTION, KIND, NAMES)


def test_a_law_that_all_types_share_closes_the_gap_of_each() -> None:
    found = judged(lambda place, _: 3.0 * np.sin(5 * place))
    assert found.closure > 0.95
    assert found.share == pytest.approx(1.0)
    assert {one.motions for one in found.by_type} == set(NAMES)
    assert all(one.closure > 0.9 for one in found.by_type)
    assert sum(one.share for one in found.by_type) == pytest.approx(1.0, abs=0.05)
    assert not objection(found, Criteria())


def test_a_force_that_is_another_in_each_type_does_not_transfer() -> None:
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    found = judged(lambda place, of_sample: 3.0 * signs[of_sample] * np.sin(5 * place))
    assert found.closure < 0.2
    assert objection(found, Criteria()).startswith("on types of motion that were not used it closes ")


def test_beyond_the_reach_of_the_other_types_nothing_is_judged() -> None:
    """The force acts at places where one type alone goes."""
    found = judged(lambda place, _: np.where(place > 0.6, 3.0, 0.0), reach=(1.0, 0.5, 0.5, 0.5))
    assert found.share < 0.1
    assert "record motions of other strokes and speeds over the same range" in objection(found, Criteria())


def test_noise_closes_nothing() -> None:
    rng = np.random.default_rng(2)
    noise = np.asarray(1.5 * rng.standard_normal(MOTION.size), np.float64)
    found = judged(lambda _, __: noise)
    assert abs(found.closure) < 0.05
    assert found.interval[0] <= found.closure <= found.interval[1]


def test_a_type_of_motion_with_less_than_the_noise_has_nothing_to_close() -> None:
    """Its lack is not taken off the gap of the others, of which a curve would then close more than there is."""
    quiet = judged(lambda place, of_sample: np.where(of_sample == 0, 3.0, 0.0) * np.sin(5 * place), noise=1.4)
    assert 0 <= quiet.share <= 1 + 1e-9
    assert sum(one.share for one in quiet.by_type) <= 1 + 1e-9
    assert quiet.closure < 0.2  # the others show nothing of the law


def test_rests_do_not_count_as_motions_in_the_interval() -> None:
    """Six motions and 60 rests had an interval of 0.21 where six motions alone have one of 0.26."""

    def width(rests: int) -> float:
        motions, each = 6, 100
        size = np.append(1 + 0.25 * np.random.default_rng(3).standard_normal(motions), np.zeros(rests))
        kind, motion = np.append(np.arange(motions) % 3, np.full(rests, 3)), np.repeat(np.arange(size.size), each)
        hats = np.tile([0.0, 1.0, 0.0], (motion.size, 1))
        columns = -hats * (motion < motions)[:, None]
        curve = Curve(Measured("position", (0.0, 1.0, 2.0), (0.0, 0.0, 0.0)), hats, np.ones(len(hats)))
        test = summed(curve, columns, size[motion], motion, kind, least=20.0)
        above = size[motion] ** 2 + 0.3 * (motion < motions)
        low, high = judgement({0: [test], 1: [test], 2: [test]}, above, motion, kind, ["a", "b", "c", ""]).interval
        return high - low

    assert width(60) == width(0) > 0.1


@pytest.mark.parametrize("sample_time", [1 / 8000, 1 / 2000, 1 / 250, 1 / 62.5])
def test_what_other_types_show_does_not_hang_on_the_sample_time(sample_time: float) -> None:
    """Four moves of 1 s over the same 100 mm: of a record at 62.5 Hz nothing had counted as shown."""
    time = np.arange(0, 1.0, sample_time)
    place = np.tile(0.05 * (1 - np.cos(np.pi * time)), 4)
    knots = np.linspace(0.0, 0.1, 36)
    hats = np.column_stack([np.interp(place, knots, row) for row in np.eye(knots.size)])
    curve = Curve(Measured("position", tuple(knots), (0.0,) * knots.size), hats, np.ones(len(hats)))
    known = replace(units(load()), sample=sample_time)
    motion, kind = np.repeat(np.arange(4), time.size), np.array([0, 1, 2, 2])
    shown = summed(curve, hats, np.ones(place.size), motion, kind, shown_from(known)).shown
    assert np.mean(shown) > 0.7
    assert shown_from(units(load())) == pytest.approx(20.0, rel=1e-3)


@pytest.mark.parametrize(("coordinate", "symmetry"), [("acceleration", "odd"), ("command", "plain")])
def test_a_straight_line_over_the_acceleration_is_a_mass_and_no_law(coordinate: Any, symmetry: Any) -> None:
    rng = np.random.default_rng(2)
    values = 3.0 * rng.standard_normal(4000)
    ends = (0.0, 10.0) if symmetry == "odd" else (-12.0, 10.0)
    knots = np.linspace(*ends, 11)
    size = np.abs(values) if symmetry == "odd" else values
    hats = np.column_stack([np.interp(size, knots, row) for row in np.eye(knots.size)])
    hats = hats[:, 1:] * np.sign(values)[:, None] if symmetry == "odd" else hats
    curve = Curve(Measured(coordinate, tuple(knots), (0.0,) * knots.size, symmetry), hats, np.ones(len(hats)))
    own, line = curve.own_part(np.ones(values.size, bool)), knots[-hats.shape[1] :]
    assert np.allclose(own @ line, 0.0, atol=1e-9)
    cubic = own @ (line**3 - 2.0 * line)
    assert np.allclose(cubic, own @ line**3)
    assert abs(hats @ line @ hats @ cubic) < 1e-9 * np.linalg.norm(hats @ line) * np.linalg.norm(hats @ cubic)
    plain = Curve(
        Measured("speed", curve.law.knots, curve.law.force, symmetry), hats, np.ones(len(hats))
    )  # a drag is in no machine file
    assert np.array_equal(plain.own_part(np.ones(values.size, bool)), np.eye(line.size))


def test_the_mean_part_of_the_thrust_is_a_thrust_constant_and_no_law() -> None:
    """Weighted by the energy of the thrust, so that what is left has none of the thrust's own force in it."""
    rng = np.random.default_rng(3)
    time, thrust = np.linspace(0.0, 10.0, 4000), 3.0 * rng.standard_normal(4000)
    knots = np.linspace(0.0, 10.0, 11)
    hats = np.column_stack([np.interp(time, knots, row) for row in np.eye(knots.size)])
    curve = Curve(Measured("time", tuple(knots), (0.0,) * knots.size, "thrust"), hats, thrust)
    own = curve.own_part(np.ones(time.size, bool))
    assert np.allclose(own @ np.ones(knots.size), 0.0, atol=1e-12)
    left = curve.acting @ own @ knots
    assert abs(left @ thrust) < 1e-9 * np.linalg.norm(left) * np.linalg.norm(thrust)
    drag = Curve(Measured("time", tuple(knots), (0.0,) * knots.size, "drag"), hats, thrust)
    assert np.array_equal(drag.own_part(np.ones(time.size, bool)), np.eye(knots.size))
