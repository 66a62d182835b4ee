"""The free form of a law: its members, and what a ridge regression on them gains where nothing was fitted."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.which.detectors.scan import FOLDS, NuisanceProjection
from diagnosis.which.free_form import HARMONICS, MEMBERS, SHAPE_RANGE_FACTOR, members, ridge_regression
from models.effects.base import Effect, parameters
from models.effects.catalogue import every
from models.effects.friction_laws import DwellBreakaway, Stribeck
from models.effects.motor import Cogging
from models.effects.priors import USUAL
from models.effects.structure import FloorVibration

N = 600


@pytest.mark.parametrize("kind", every().values(), ids=lambda kind: kind.name)
def test_a_free_form_has_few_members_of_its_own_class(kind: type[Effect]) -> None:
    found = members(kind.typical(), USUAL)
    assert 0 < len(found) <= MEMBERS
    assert {type(one) for one in found} == {kind}


@pytest.mark.parametrize("law", [Stribeck(0.1, 2e-3), DwellBreakaway(0.1, 1.0, 3e-6)], ids=lambda law: law.name)
def test_its_shapes_go_far_beyond_their_usual_range(law: Stribeck | DwellBreakaway) -> None:
    for item in parameters(type(law)):
        sizes = [getattr(one, item.name) for one in members(law, USUAL)]
        if item.role == "shape":
            assert min(sizes) == pytest.approx(item.low / SHAPE_RANGE_FACTOR)
            assert max(sizes) == pytest.approx(item.high * SHAPE_RANGE_FACTOR)
        else:
            assert set(sizes) == {getattr(law, item.name)}


def test_what_repeats_has_its_overtones_for_a_free_form() -> None:
    """Shorter periods of the same origin, or whole multiples of a frequency: no other period, which would draw
    anything."""
    pitches = [one.values()[1] for one in members(Cogging(1.0, 0.03, 1.0), USUAL)]
    assert pitches == pytest.approx([0.03 / n for n in range(1, HARMONICS + 1)])
    frequencies = [one.values()[1] for one in members(FloorVibration(1.0, 5.0, 1.0), USUAL)]
    assert frequencies == pytest.approx([5.0, 10.0, 15.0])


def _projection(e: np.ndarray) -> NuisanceProjection:
    segment = np.arange(e.size) // (e.size // 12)
    nothing = np.zeros((e.size, 0))
    return NuisanceProjection(e, segment, np.arange(12) % FOLDS, nothing, (np.zeros((0, 0)), True))


def test_what_a_sum_of_members_draws_is_gained_on_motions_left_out_and_noise_is_not() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((N, 8))
    columns /= np.linalg.norm(columns, axis=0)
    truth, noise = 30.0 * rng.standard_normal(8), rng.standard_normal(N)
    gain, parts = ridge_regression(columns, _projection(noise - columns @ truth))
    assert gain == pytest.approx(float(truth @ (columns.T @ columns) @ truth), rel=0.1)
    assert parts == pytest.approx(truth, abs=5.0)
    assert ridge_regression(columns, _projection(noise))[0] < 10.0
