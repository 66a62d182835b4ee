"""Elements found again from the hysteresis they make, from noisy measurements and from published facts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from models.friction import branch, elements, follow
from models.identification.hysteresis import branch_of_facts, identify, prediction_error

TRUTH = elements([4e5, 2.5e5, 1e5], [3e-6, 9e-6, 8e-5])


def loops(corners: tuple[int, ...], points: int = 150) -> np.ndarray:
    """A path [m] between corners [um]."""
    return np.concatenate([np.linspace(a, b, points, endpoint=False) for a, b in pairwise(corners)]) * 1e-6


PATH = loops((0, 120, -120, 120, 60, 100, -120))
HELD_OUT = loops((0, 120, -120, -30, -80, 40, 10, 70, -120))


def test_elements_are_found_again_exactly_from_exact_data() -> None:
    found = identify(PATH, follow(TRUTH, PATH)[0], 3)
    assert found.friction.limit == pytest.approx(TRUTH.limit, rel=1e-4)
    assert found.friction.stiffness == pytest.approx(TRUTH.stiffness, rel=1e-4)
    assert found.rms_error < 1e-4


def test_the_unknown_state_before_the_first_extreme_does_no_harm() -> None:
    strained = follow(TRUTH, PATH, state=[-3e-6, -5e-6, 4e-5])[0]
    found = identify(PATH, strained, 3)
    assert found.friction.limit == pytest.approx(TRUTH.limit, rel=1e-4)


def test_noisy_elements_are_within_their_deviations_which_are_not_idle() -> None:
    """Over 12 noise seeds, two deviations hold nearly all of the true values, and are small against them."""
    inside, small = [], []
    for seed in range(12):
        noise = 0.1 * np.random.default_rng(seed).standard_normal(PATH.size)
        found = identify(PATH, follow(TRUTH, PATH)[0] + noise, 3)
        for values, true, std in (
            (found.friction.stiffness, TRUTH.stiffness, found.stiffness_std),
            (found.friction.limit, TRUTH.limit, found.limit_std),
        ):
            inside.append(np.abs(np.array(values) - true) < 2 * std)
            small.append(std < 0.05 * np.array(true))
    assert 0.85 <= np.mean(inside) <= 1.0
    assert np.all(small)


def test_inner_loops_that_the_fit_has_not_seen_are_followed() -> None:
    noise = 0.1 * np.random.default_rng(1).standard_normal(PATH.size)
    found = identify(PATH, follow(TRUTH, PATH)[0] + noise, 3)
    assert prediction_error(found.friction, HELD_OUT, follow(TRUTH, HELD_OUT)[0]) < 0.05
    coarse = identify(PATH, follow(TRUTH, PATH)[0] + noise, 1)
    assert prediction_error(coarse.friction, HELD_OUT, follow(TRUTH, HELD_OUT)[0]) > 0.5


def test_damping_is_found_where_the_speed_is_known() -> None:
    """f_i = clip(K z + D z') with the sticking element's z' = v: a sinusoid at two amplitudes shows K, X and D."""
    time = np.linspace(0, 4, 4000)
    path = np.where(time < 2, 1.0, 0.5) * 20e-6 * np.sin(2 * np.pi * 1.0 * time)
    velocity = np.gradient(path, time)
    k, x, d = 2e5, 6e-6, 3e3
    z = follow(elements([1.0], [x]), path)[0]
    force = np.clip(k * z + d * velocity, -k * x, k * x)
    found = identify(path, force, 1, velocity=velocity)
    assert found.friction.damping[0] == pytest.approx(d, rel=0.02)
    assert found.friction.stiffness[0] == pytest.approx(k, rel=0.01)
    assert found.friction.limit[0] == pytest.approx(x, rel=0.01)
    assert identify(path, force, 1).friction.damping[0] == 0


def test_published_facts_are_two_elements_exactly() -> None:
    """T_fc, K_e1, K_e2 and the boundary: K = 700 N/mm up to 2 x 10 um, and 100 N/mm up to 2 x 95 um."""
    found = identify(*branch_of_facts(16.5, 8e5, 1e5, 20e-6), 2)
    assert found.friction.stiffness == pytest.approx([7e5, 1e5], rel=1e-6)
    assert found.friction.limit == pytest.approx([10e-6, 95e-6], rel=1e-6)
    assert branch(found.friction, [20e-6, 190e-6]) == pytest.approx([16.0, 33.0])


def test_more_elements_follow_better() -> None:
    truth = elements(np.full(12, 5e4), np.geomspace(1e-6, 5e-5, 12))
    force = follow(truth, PATH)[0]
    errors = [identify(PATH, force, count).rms_error for count in (1, 2, 4, 8)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.05 * errors[0]


@pytest.mark.parametrize(
    ("path", "force", "says"),
    [
        (PATH[:5], PATH[:5], "eight at least"),
        (PATH, PATH[:-1], "as many displacements as forces"),
        (np.zeros(50), np.arange(50.0), "is constant"),
        (PATH, np.where(PATH > 1e-4, np.nan, PATH), "not finite"),
        (PATH, -follow(TRUTH, PATH)[0], "check the signs"),
    ],
)
def test_a_curve_without_friction_is_said(path: np.ndarray, force: np.ndarray, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        identify(path, force, 2)
