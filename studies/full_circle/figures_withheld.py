"""Figures of the circle on withheld machines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure as Drawing

from reports import style
from studies.full_circle.figures import draw_errors

Results = Mapping[str, Any]

DRAWN_ERRORS: Final = (("settling", "settling of the slowest motion"), ("dispersion", "3$\\sigma$"))
DRAWN_WAYS: Final = (("after", "redesign"), ("refit", "re-fit only"), ("pid", "PID only"), ("learning", "ten rounds"))


def machines(whole: Results) -> Drawing:
    """Every machine before, after and with the truth, as shares of what was specified."""
    rows = whole["results"]["cases"]
    figure, axes = style.subplots(1, 2, 30 + 4.5 * max(len(rows), 3), sharey=True)
    place = np.arange(len(rows))[::-1]
    for ax, key, label, size in (
        (axes[0, 0], "settling_s", "settling of the slowest motion / specified", "specified_s"),
        (axes[0, 1], "dispersion_m", "3$\\sigma$ / before", None),
    ):
        for y, row in zip(place, rows, strict=True):
            unit = row[size] if size else max(row["before"][key], 1e-300)
            before, after = (row[name][key] / unit for name in ("before", "after"))
            ax.annotate("", (after, y), (before, y), arrowprops={"arrowstyle": "->", "color": style.LIMIT, "lw": 0.8})
            ax.plot(before, y, linestyle="none", marker="s", color=style.VERMILION, label="before" if y == 0 else None)
            ax.plot(after, y, linestyle="none", marker="o", color=style.BLUE, label="after" if y == 0 else None)
            if row["truth"] is not None:
                ax.plot(row["truth"][key] / unit, y, linestyle="none", marker="D", markerfacecolor="none",
                        color=style.BLACK, label="with the truth" if y == 0 else None)  # fmt: skip
        ax.axvline(1.0, color=style.LIMIT, linestyle=(0, (4, 2)), linewidth=0.9)
        ax.margins(x=0.08)  # a marker at the end is whole
        ax.set_xlim(0, None)
        ax.set_xlabel(label)
        ax.grid(axis="y", visible=False)
        ax.set_ylim(-0.6, max(len(rows), 1) - 0.4)
    axes[0, 0].set_yticks(place, [row["case"].replace("machine-", "machine ") for row in rows])
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, fontsize=7)
    return figure


def shares(whole: Results) -> Drawing:
    """The share recovered on each machine by each way, with the medians."""
    found = whole["results"]["shares"]
    figure, axes = style.subplots(1, 2, 55, sharey=True)
    for ax, (name, label) in zip(axes[0], DRAWN_ERRORS, strict=True):
        for at, (way, _) in enumerate(DRAWN_WAYS):
            values = np.clip(found[way][name]["values"], -1.0, 1.5)
            spread = at + np.linspace(-0.15, 0.15, len(values)) if len(values) else np.zeros(0)
            ax.plot(values, spread, linestyle="none", marker=style.MARKERS[at], color=style.COLOURS[at], alpha=0.6)
            if found[way][name]["median"] is not None:
                ax.plot([np.clip(found[way][name]["median"], -1, 1.5)] * 2, [at - 0.35, at + 0.35], color=style.BLACK,
                        linestyle="-", linewidth=1.6)  # fmt: skip
        ax.axvline(1.0, color=style.LIMIT, linestyle=(0, (4, 2)), linewidth=0.9)
        ax.axvline(0.0, color=style.LIMIT, linestyle="-", linewidth=0.6)
        ax.set_xlim(-1.05, 1.55)
        ax.set_xlabel(f"share recovered of {label}")
        ax.grid(axis="y", visible=False)
    axes[0, 0].set_yticks(range(len(DRAWN_WAYS)), [said for _, said in DRAWN_WAYS])
    axes[0, 0].invert_yaxis()
    return figure


def names(whole: Results) -> Drawing:
    """The share of single effects that each policy had rightly and surely named after so much machine time."""
    found = whole["results"]["policies"]
    times = np.array(found["times_s"])
    figure, axes = style.subplots(1, 1, 62)
    ax = axes[0, 0]
    for at, (name, one) in enumerate(found["of"].items()):
        curve = one["right_over_time"]
        shown = [100 * point["hits"] / point["tries"] for point in curve]
        low, high = (100 * curve[-1][end] for end in ("low", "high"))
        ax.step(times, shown, where="post", color=style.COLOURS[at], label=name, linewidth=1.4)
        beside = times[-1] + 1.2 * (1 + at)
        ax.plot([beside, beside], [low, high], color=style.COLOURS[at], linestyle="-", linewidth=1.2)
        ax.plot(beside, shown[-1], linestyle="none", marker=style.MARKERS[at], color=style.COLOURS[at])
    ax.set_xlim(0, times[-1] + 1.2 * (len(found["of"]) + 1))
    ax.set_ylim(-2, 102)
    ax.set_xlabel("machine time [s]")
    ax.set_ylabel("rightly named [%]")
    ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=len(found["of"]), fontsize=7)
    return figure


def story(number: int) -> Any:
    """What draws the errors of a machine's motions before and after."""

    def drawn(whole: Results) -> Drawing:
        one = whole["results"]["stories"][number]
        figure, axes = style.subplots(1, 2, 60, sharey=True)
        for ax, which, title in ((axes[0, 0], "before", "before"), (axes[0, 1], "after", "in the end")):
            draw_errors(ax, one["pictures"][which], one["specified"])
            ax.set_title(title)
        axes[0, 0].set_ylabel("error towards the target [µm]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4, fontsize=6.5)
        return figure

    return drawn
