"""The RFM: as many elements as asked for, close to the machine's friction, inner loops included."""

from __future__ import annotations

import numpy as np
import pytest

from design.friction_compensation import simplify
from models.friction import branch, elements, follow
from models.machine import load

TABLE = load().friction


def test_five_elements_follow_ten() -> None:
    rfm = simplify(TABLE, 5)
    distance = np.linspace(0, 250e-6, 500)
    assert len(rfm.limit) == 5
    assert rfm.coulomb_force == pytest.approx(TABLE.coulomb_force, rel=1e-12)
    assert np.max(np.abs(branch(rfm, distance) - branch(TABLE, distance))) < 0.05 * TABLE.coulomb_force


def test_more_elements_follow_better() -> None:
    distance = np.linspace(0, 250e-6, 500)
    errors = [np.max(np.abs(branch(simplify(TABLE, n), distance) - branch(TABLE, distance))) for n in (1, 2, 5, 20)]
    assert errors == sorted(errors, reverse=True)


def test_loops_that_the_fit_has_not_seen_are_followed_too() -> None:
    """Every history is built of branches (Masing), so a good branch is good for inner loops."""
    path = (
        np.concatenate([np.linspace(a, b, 200) for a, b in ((0, 80), (80, 50), (50, 70), (70, 20), (20, 100))]) * 1e-6
    )
    ours, theirs = follow(simplify(TABLE, 5), path)[0], follow(TABLE, path)[0]
    assert np.max(np.abs(ours - theirs)) < 0.05 * TABLE.coulomb_force


def test_one_element_and_elements_without_stiffness_are_no_trouble() -> None:
    assert simplify(TABLE, 1).coulomb_force == pytest.approx(TABLE.coulomb_force)
    assert len(simplify(elements([0.0, 1e5], [1e-6, 1e-5]), 3).limit) == 3
