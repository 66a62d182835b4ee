"""The style that every figure has."""

from __future__ import annotations

import io

import pytest
from matplotlib.figure import Figure

from models.quantity import turned
from reports import style


@pytest.mark.parametrize(
    ("largest", "label", "tick"),
    [(20.0, "$d$ [N m]", ""), (2e-5, "$d$ [µN m]", "10"), (2e-8, "$d$ [nN m]", "10")],
)
def test_an_axis_of_small_forces_has_a_prefix(largest: float, label: str, tick: str) -> None:
    drawn: list[Figure] = []

    def draw(_: object) -> Figure:
        figure, axes = style.subplots()
        axes[0, 0].plot([0.0, 1.0], [0.0, largest])
        axes[0, 0].set_ylim(0.0, largest)
        axes[0, 0].set_ylabel("$d$ [N]")
        axes[0, 0].set_xlabel("position [mm]")
        drawn.append(figure)
        return figure

    style.save(draw, {}, io.BytesIO(), turned)
    ax = drawn[0].axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("position [mrad]", label)
    assert not tick or ax.yaxis.get_major_formatter()(0.5 * largest, 0) == tick


def test_words_at_ticks_have_the_units_of_the_axis() -> None:
    drawn: list[Figure] = []

    def draw(_: object) -> Figure:
        figure, axes = style.subplots()
        axes[0, 0].plot([0.0, 1.0], [0.0, 1.0])
        axes[0, 0].set_yticks([0.0, 1.0], ["rest", "moves of about 3 µm at about 30 mm/s"])
        drawn.append(figure)
        return figure

    style.save(draw, {}, io.BytesIO(), turned)
    said = [label.get_text() for label in drawn[0].axes[0].get_yticklabels()]
    assert said == ["rest", "moves of about 3 µrad at about 30 mrad/s"]
