"""Block diagrams: an arrow ends where it is told to, and the diagrams show the machine that they are drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Polygon

from models.machine import load, to_json
from reports.blocks import ARROW_HEAD_MM, Sheet
from reports.report import select
from studies.diagrams import elements_figure, loop_figure, setup_figure


@pytest.fixture(scope="module")
def whole() -> dict[str, Any]:
    return {"machine": to_json(load()), "results": {"five": 5, "limits": [1e-6, 2e-6, 3e-6]}}


@pytest.mark.parametrize("end", [(50.0, 20.0), (10.0, 45.0), (10.0, 3.0)])
def test_an_arrows_head_touches_its_end_and_lies_on_its_line(end: tuple[float, float]) -> None:
    sheet, start = Sheet(50), (10.0, 20.0)
    sheet.arrow(start, end)
    (head,) = [patch for patch in sheet.axes.patches if isinstance(patch, Polygon)]
    corners = np.asarray(head.get_xy())[:3]
    along = (np.array(end) - start) / np.linalg.norm(np.array(end) - start)
    np.testing.assert_allclose(corners[0], end)
    np.testing.assert_allclose(np.mean(corners[1:], axis=0), np.array(end) - ARROW_HEAD_MM[0] * along)
    np.testing.assert_allclose((corners[1] - corners[2]) @ along, 0.0, atol=1e-12)


def words(figure: Any, whole: dict[str, Any]) -> set[str]:
    """All texts of a diagram, drawn from no more than the keys that it names."""
    return {text.get_text() for text in figure.draw(select(whole, figure)).axes[0].texts}


def test_the_loop_has_the_compensator_with_its_number_of_elements(whole: dict[str, Any]) -> None:
    assert "RFM, $N$ = 5" in words(loop_figure("results.five"), whole)
    assert "RFM, $N$ = 3" in words(loop_figure("results.limits"), whole)


def test_the_setup_and_the_friction_are_the_machines(whole: dict[str, Any]) -> None:
    assert {"vibration modes: 38 Hz, 81 Hz", "dead time $L$ = 1.061 ms"} <= words(setup_figure(), whole)
    assert "$K_{10}$, $D_{10}$, $F_{m10}$" in words(elements_figure(), whole)
