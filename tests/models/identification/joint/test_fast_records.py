"""Fast records beside a frequency response: one viscous friction of both."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from models.identification.estimate import Estimate
from models.identification.joint.fast_records import _with_the_response
from models.identification.joint.steps import Identified
from models.identification.modes import DRAG


def _after(*response: float) -> Identified:
    """What a response gave before: the drag and its deviation [N s/m], or nothing of it."""
    names = (DRAG,) if response else ()
    gave = Estimate(names, ("N s/m",) * len(names), np.array(response[:1]), np.diag(np.array(response[1:]) ** 2))
    return cast(Identified, SimpleNamespace(last=lambda _: SimpleNamespace(estimate=gave)))


def test_the_surer_drag_decides_and_a_disagreement_is_told() -> None:
    """A die bonder's axis (8 N s/m): 7.5 +- 1.2 of a sweep, and strokes of 40 um had put 41 +- 10 in its place."""
    together, said = _with_the_response(_after(7.53, 1.2), (41.1, 10.2))
    assert together is not None
    assert together[0] == pytest.approx(7.99, abs=0.01)
    assert together[1] == pytest.approx(3.9, abs=0.1)  # as wide as the two differ
    assert "41.1 N s/m ± 10 N s/m, and that of the frequency response, 7.53 N s/m ± 1.2 N s/m" in said[0]
    assert "differ by 3.3 standard deviations" in said[0]


def test_drags_that_agree_are_averaged_without_a_word() -> None:
    together, said = _with_the_response(_after(8.5, 1.0), (9.5, 1.0))
    assert together is not None
    assert together == pytest.approx((9.0, 2**-0.5))
    assert said == []


def test_what_one_of_them_does_not_show_the_other_does() -> None:
    """Strokes that show no drag had taken that of the response out of the file."""
    assert _with_the_response(_after(8.0, 1.0), None) == ((8.0, 1.0), [])
    assert _with_the_response(_after(), (8.0, 1.0)) == ((8.0, 1.0), [])
    assert _with_the_response(_after(), None) == (None, [])
