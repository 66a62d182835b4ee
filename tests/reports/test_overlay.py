"""What two drawings of one figure show when one is laid over the other."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from reports import style
from reports.overlay import lay_over

TIME = np.linspace(0, 1, 11)


def drawing(scale: float) -> Figure:
    """Every kind of artist that a report's figures use, at a scale."""
    figure, axes = style.subplots(2, 2)
    axes[0, 0].plot(TIME, scale * TIME, drawstyle="steps-post")
    axes[0, 0].plot(TIME, scale * TIME**2, linestyle="none", marker="s")
    style.mark_limit(axes[0, 0], 2.0 * scale, "limit")
    style.tolerance_band(axes[0, 0], 0.0, 0.1 * scale, "tolerance")
    axes[0, 1].bar(["a", "b"], [scale, 2 * scale])
    axes[1, 0].fill_between(TIME, 0 * TIME, scale * TIME)
    axes[1, 0].scatter(TIME, scale * TIME)
    axes[1, 0].vlines([0.5], 0, scale)
    axes[1, 1].imshow(np.full((2, 2), scale))
    return figure


def grey(axes: Axes) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """The points of the lines beneath."""
    return [np.asarray(line.get_xydata()) for line in axes.lines if line.get_zorder() < 1]


def shapes(axes: Axes) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    return [np.asarray(patch.get_path().vertices) for patch in axes.patches if isinstance(patch, PathPatch)]


def test_lines_and_markers_of_before_stand_beneath_in_grey() -> None:
    axes = lay_over(drawing(1.0), drawing(3.0)).axes[0]
    line, markers = (line for line in axes.lines if line.get_zorder() < 1 and line.get_transform() == axes.transData)
    assert np.asarray(line.get_ydata()) == pytest.approx(3 * TIME)
    assert line.get_drawstyle() == "steps-post"
    assert markers.get_linestyle() == "None"
    assert markers.get_marker() == "s"
    assert to_rgba(line.get_color()) == to_rgba(style.LIMIT)
    assert axes.get_ylim()[1] > 3


def test_bars_and_bands_and_points_are_carried_over_and_stay_visible() -> None:
    figure = lay_over(drawing(1.0), drawing(3.0))
    bars = shapes(figure.axes[1])
    assert [np.max(bar[:, 1]) for bar in bars] == pytest.approx([3, 6])
    assert all(
        to_rgba(patch.get_facecolor())[3] == 0 for patch in figure.axes[1].patches if isinstance(patch, PathPatch)
    )
    assert figure.axes[1].get_ylim()[1] > 6
    (band,) = shapes(figure.axes[2])
    assert np.max(band[:, 1]) == pytest.approx(3)
    (points,) = grey(figure.axes[2])
    assert points[:, 1] == pytest.approx(3 * TIME)
    assert len(figure.axes[2].collections) == 3 + 1  # its own, and the vertical line of before


def test_a_limit_is_repeated_only_where_it_moved() -> None:
    moved, same = lay_over(drawing(1.0), drawing(3.0)).axes[0], lay_over(drawing(1.0), drawing(1.0)).axes[0]
    assert len(shapes(moved)) == 1  # the tolerance
    assert len(shapes(same)) == 0
    ends = [line for line in moved.lines if line.get_zorder() < 1 and line.get_transform() != moved.transData]
    assert sorted(float(np.asarray(line.get_ydata())[0]) for line in ends) == pytest.approx([-0.3, 0.3, 6.0])
    assert not [line for line in same.lines if line.get_zorder() < 1 and line.get_transform() != same.transData]


def test_axes_of_other_units_are_not_laid_over_each_other() -> None:
    """Of a stroke of 20 µm and one of 20 mm, also where the unit stands at the panel beside it."""

    def drawn(unit: str) -> Figure:
        figure, axes = style.subplots(1, 2, sharey=True)
        for ax in axes[0]:
            ax.plot(TIME, TIME)
        axes[0, 0].set_ylabel(f"distance [{unit}]")
        return figure

    assert [len(grey(axes)) for axes in lay_over(drawn("µm"), drawn("µm")).axes] == [1, 1]
    other = lay_over(drawn("mm"), drawn("µm"))
    assert [len(grey(axes)) for axes in other.axes] == [0, 0]
    assert {text.get_text() for text in other.axes[1].texts} == {"before: not drawn (it has other units)"}


def test_what_cannot_be_laid_over_is_said_in_the_figure() -> None:
    figure = lay_over(drawing(1.0), drawing(3.0))
    assert [text.get_text() for text in figure.axes[3].texts] == ["before: not drawn (AxesImage)"]
    other, _ = style.subplots(1, 2)
    assert "before: 2 panels, here 4" in {text.get_text() for text in lay_over(drawing(1.0), other).axes[-1].texts}
