"""How figures look: one style for every report, told apart in black and white and by colour-blind readers.

The style is in force only while `save` draws. Figures are `matplotlib.figure.Figure`s made by `subplots`; pyplot
and its list of open figures are not used.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, Literal

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FuncFormatter, LogFormatterSciNotation

from reports.markup import RAISED
from reports.units import force_unit

TEXT_WIDTH = 160.0
"""Width of the text on paper, mm: figures are drawn at the size at which they are printed."""

# Okabe and Ito's palette for all kinds of colour vision, its yellow left out: too light for a line on white paper.
BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, SKY, ORANGE = "#CC79A7", "#56B4E9", "#E69F00"
LIMIT = "#555555"
"""Colour of specifications and limits, which are never a measured or computed line."""

COLOURS = (BLUE, VERMILION, BLACK, GREEN, PURPLE, ORANGE, SKY)
# Black-and-white print separates lines by their dashes, in points of line width.
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1)), (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "mathtext.fontset": "dejavusans",
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "axes.prop_cycle": cycler(color=COLOURS) + cycler(linestyle=DASHES),
    "lines.linewidth": 1.3,
    "lines.markersize": 4.0,
    "patch.linewidth": 0.6,
    "hatch.linewidth": 0.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#d4d4d4",
    "grid.linestyle": "-",
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "axes.unicode_minus": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.3,
    "legend.handlelength": 2.6,
    "figure.dpi": 72.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "path.simplify": True,
    # Letters as outlines look the same on every machine, and no reader needs the font.
    "svg.fonttype": "path",
    # Names inside the SVG follow from its content, not from chance.
    "svg.hashsalt": "report",
}


def save(
    draw: Callable[[Mapping[str, Any]], Figure],
    results: Mapping[str, Any],
    path: Path | IO[bytes],
    wording: Callable[[str], str] = str,
) -> None:
    """Writes what `draw` makes of `results` to `path` as SVG, in the report's style and without a date; `wording` is
    done to every text."""
    with mpl.rc_context(STYLE):
        figure = draw(results)
        for axes in figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                _write_powers(axis)
                _prefix(axis)
                if wording is not str:
                    _word(axis, wording)
        if wording is not str:
            for said in figure.findobj(Text):
                assert isinstance(said, Text)
                said.set_text(wording(said.get_text()))
        FigureCanvasSVG(figure)  # so that the layout is found with the letters of the file
        layout = figure.get_layout_engine()
        if layout is not None:  # done here, as savefig would draw everything once more for it
            layout.execute(figure)
            figure.set_layout_engine("none")
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})


def _prefix(axis: Axis) -> None:
    """Gives an axis of small forces [N] a prefix: matplotlib would write their common power of ten over the label."""
    label = axis.get_label_text()
    if label.endswith("[N]") and axis.get_scale() == "linear":
        factor, unit = force_unit(float(np.max(np.abs(axis.get_view_interval()))))
        if factor != 1.0:
            axis.set_major_formatter(FuncFormatter(lambda number, _: f"{factor * number:.6g}"))
            axis.set_label_text(f"{label[: -len('[N]')]}[{unit}]")


def _word(axis: Axis, wording: Callable[[str], str]) -> None:
    """Does the wording to what stands at the ticks in words, which the drawing asks its formatter for."""
    formatter = axis.get_major_formatter()
    if isinstance(formatter, FixedFormatter | FuncFormatter):
        axis.set_major_formatter(FuncFormatter(lambda number, place: wording(formatter(number, place))))


def warm_up() -> None:
    """Loads what the first figure would else wait for: the font, its letters and the grammar of formulas."""

    def every_letter(_results: Mapping[str, Any]) -> Figure:
        figure, axes = subplots()
        axes[0, 0].loglog([1e-3, 1.0], [1.0, 1e3], label="$x_1^2$")
        axes[0, 0].set_title("".join(chr(code) for code in range(33, 127) if chr(code) != "$"))
        axes[0, 0].legend()
        return figure

    save(every_letter, {}, io.BytesIO())


class _Powers(LogFormatterSciNotation):
    """Powers of ten in letters, 10⁻³: as formulas they took a third of the time of drawing."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick."""
        formula = str(super().__call__(x, pos))
        parts = re.fullmatch(r"\$\\mathdefault\{(.*?)(?:\^\{(-?\d+)\})?\}\$", formula)
        if parts is None:
            return formula
        return parts[1].replace(r"\times", "×") + (parts[2] or "").translate(RAISED)


def _write_powers(axis: Axis) -> None:
    """Gives a logarithmic axis its labels in letters."""
    if type(axis.get_major_formatter()) is LogFormatterSciNotation:
        axis.set_major_formatter(_Powers())
    if type(axis.get_minor_formatter()) is LogFormatterSciNotation:
        axis.set_minor_formatter(_Powers(minor_thresholds=(1, 0.4)))


def subplots(
    rows: int = 1,
    columns: int = 1,
    height_mm: float = 65.0,
    *,
    sharex: bool | Literal["none", "all", "row", "col"] = False,
    sharey: bool | Literal["none", "all", "row", "col"] = False,
    **grid: Any,
) -> tuple[Figure, np.ndarray[tuple[int, int], np.dtype[np.object_]]]:
    """A figure of the text's width with axes of shape (`rows`, `columns`), always two-dimensional.

    `grid` goes to the grid of axes: `width_ratios`, `height_ratios`.
    """
    figure = Figure(figsize=(TEXT_WIDTH / 25.4, height_mm / 25.4), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False, **grid)
    return figure, axes


def tolerance_band(ax: Axes, centre: float, half_width: float, label: str) -> None:
    """Draws the specification `centre` ± `half_width` (units of the y axis) over the whole width of `ax`."""
    ax.axhspan(centre - half_width, centre + half_width, facecolor="#e4e4e4", edgecolor="none", zorder=0.5, label=label)
    for edge in (centre - half_width, centre + half_width):
        ax.axhline(edge, color=LIMIT, linewidth=0.7, linestyle=(0, (4, 2)), zorder=1.5)


def mark_limit(
    ax: Axes, value: float, label: str, axis: Literal["x", "y"] = "y", *, end: Literal["top", "bottom"] = "top"
) -> None:
    """Draws a limit at `value` of the given axis: its `label` is beside the axes (y) or along the line (x), at the
    line's `end` where nothing else is drawn."""
    line: dict[str, Any] = {"color": LIMIT, "linewidth": 0.9, "linestyle": (0, (4, 2)), "zorder": 1.5}
    words: dict[str, Any] = {"fontsize": 7.0, "color": "#333333", "textcoords": "offset points", "ha": "left"}
    if axis == "y":
        ax.axhline(value, **line)
        # Beside the axes nothing is drawn that it could hide.
        ax.annotate(label, (1.0, value), xytext=(3, 0), xycoords=ax.get_yaxis_transform(), va="center", **words)
    else:
        ax.axvline(value, **line)
        words["bbox"] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}
        place = ax.get_xaxis_transform()
        height, inwards = (1.0, -2) if end == "top" else (0.0, 2)
        ax.annotate(label, (value, height), xytext=(3, inwards), xycoords=place, va=end, rotation=90, **words)
