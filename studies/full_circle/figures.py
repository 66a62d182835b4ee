"""Figures of the circle on one's own axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure as Drawing

from reports import style

Results = Mapping[str, Any]

DRAWN_ERRORS: Final = (("settling", 1e3, "settling of the slowest motion [ms]"), ("dispersion", 1e6, "3$\\sigma$ [µm]"))


def expected(whole: Results) -> Drawing:
    """What each design is expected to achieve, with its interval, and what was measured."""
    redesign, verified = whole["results"]["redesign"], whole["results"]["verified"]
    rows = redesign["designs"]
    figure, axes = style.subplots(1, 2, 26 + 8 * len(rows), sharey=True)
    taken = next(i for i, one in enumerate(rows) if one["taken"])
    place = np.arange(len(rows))[::-1]
    names = [f"{one['name']}\n(to run)" if one["taken"] else one["name"] for one in rows]
    for ax, (key, factor, label) in zip(axes[0], DRAWN_ERRORS, strict=True):
        low, middle, high = (factor * np.array([one[key][name] for one in rows]) for name in ("low", "median", "high"))
        said = f"expected, {redesign['level']:.0%}"
        ax.hlines(place, low, high, color=style.BLUE, linewidth=4.0, alpha=0.35, label=said)
        ax.plot(middle, place, linestyle="none", marker="o", color=style.BLUE, label="median")
        for which, row, marker, name in (("before", 0, "s", "in place"), ("after", taken, "D", "redesign")):
            found = verified[which]
            if found is not None:
                value = factor * found["settling_s" if key == "settling" else "dispersion_m"]
                look = {"marker": marker, "markerfacecolor": "none", "markersize": 7, "color": style.VERMILION}
                ax.plot(value, place[row], linestyle="none", label=f"measured, {name}", **look)
        if key == "settling":
            limit = factor * redesign["specified"]["settling_s"]
            ax.axvline(limit, color=style.LIMIT, linestyle=(0, (4, 2)), linewidth=1.0, label="specified")
        ax.set_xlim(0, None)
        ax.set_xlabel(label)
        ax.grid(axis="y", visible=False)
        ax.set_ylim(-0.6, len(rows) - 0.4)
    axes[0, 0].set_yticks(place, names)
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, fontsize=6.5)
    return figure


def motions(whole: Results) -> Drawing:
    """The errors of the motions over time, before and after: measured where there is a record, else as expected."""
    pictures, redesign = whole["results"]["pictures"], whole["results"]["redesign"]
    figure, axes = style.subplots(1, 2, 70, sharey=True)
    wanted = redesign["specified"]
    for ax, which, title in ((axes[0, 0], "current", "design in place"), (axes[0, 1], "redesign", "design to run")):
        measured = pictures["measured"][which]
        shown = measured or pictures["expected"][which]
        draw_errors(ax, shown, wanted)
        ax.set_title(f"{title},\n{'measured' if measured else 'simulated on the improved machine'}", fontsize=7.5)
    axes[0, 0].set_ylabel("error towards the target [µm]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4)  # where it hides no curve
    return figure


def draw_errors(ax: Any, shown: Results, wanted: Results) -> None:
    """Errors of motions over the time from the step, turned with the motion, and the specification."""
    time = 1e3 * np.array(shown["time_s"])
    seen = set[bool]()
    for error, reversal in zip(shown["error_m"], shown["reversal"], strict=True):
        ax.plot(
            time,
            1e6 * np.array(error),
            color=style.VERMILION if reversal else style.BLUE,
            linestyle=(0, (5, 1.5)) if reversal else "-",
            linewidth=0.8,
            label=None if reversal in seen else "after a reversal" if reversal else "same direction",
        )
        seen.add(reversal)
    tolerance, settled = 1e6 * wanted["tolerance_m"], 1e3 * wanted["settling_s"]
    for level in (-tolerance, tolerance):
        ax.axhline(level, color=style.LIMIT, linestyle=(0, (4, 2)), linewidth=0.8)
    ax.axvline(settled, color=style.LIMIT, linestyle=(0, (4, 2)), linewidth=0.8, label="specification")
    ax.set_ylim(-6 * tolerance, 6 * tolerance)
    ax.set_xlim(0, min(time[-1], 4 * settled) if time.size else 1)
    ax.set_xlabel("time from the step [ms]")
