"""The report of an identification: its figures and captions (report.md)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import MaxNLocator, MultipleLocator, NullFormatter

from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from studies.wording import filters

Results = Mapping[str, Any]


def tell(whole: Results) -> Report:
    """The report on what results.json holds; with a figure for each kind of record present."""
    results = whole["results"]
    possible = (
        ("response", Figure("bode", BODE, ("results.response",), _bode)),
        ("response", Figure("stabilisation", STABILISATION, ("results.response",), _stabilisation)),
        ("hysteresis", Figure("hysteresis", HYSTERESIS, ("results.hysteresis",), _hysteresis)),
        ("motion", Figure("motion", MOTION, ("results.motion",), _motion)),
        ("dynamics", Figure("dynamics", DYNAMICS, ("results.dynamics",), _dynamics)),
        ("dynamics", Figure("friction", FRICTION, ("results.dynamics",), _friction)),
        ("round_trip", Figure("round_trip", ROUND_TRIP, ("results.round_trip",), _round_trip)),
    )
    figures = tuple(figure for part, figure in possible if part in results)
    there = {*(f"results.{part}" for part in results), "parameters"}
    tables = {name: keys for name, keys in TABLES.items() if ".".join(keys[0].split(".")[:2]) in there}
    title = f"Identification: {whole['machine']['name']}"
    question = "Which machine is this according to its records, and with what uncertainty?"
    return Report(title, question, Path(__file__).parent / "report.md", figures, filters(), tables)


TABLES = {
    "values": ("results.estimates",),
    "written": ("results.parameters",),
    "records": ("results.records",),
    "correlation": ("results.motion.correlation",),
    "published": ("results.dynamics.published",),
    "ladder": ("results.dynamics.ladder",),
    "correlation_dynamics": ("results.dynamics.correlation",),
    "coverage": ("results.round_trip",),
    "parameters": ("parameters",),
}
BODE = Markdown(
    "Measured frequency response and the $P_l$ fitted to it; below, the residuals, with the standard deviation of each "
    "measured line. A residual still holds what the ends of a single record leave, most of it at the lowest lines; the "
    "fit takes that out before it weighs what is left. Crosses: excluded lines."
)
STABILISATION = (
    "Stabilisation: the modes found with each number of modes. Dots: modes of the machine file. Crosses: candidates "
    "that are not modes, or that the lines do not need. Right: reduced chi-square."
)
HYSTERESIS = (
    "Left: friction force over position, measured and from the identified elements. Right: increase of force "
    "after a reversal from full slip, with two standard deviations either way."
)
MOTION = "Command of the motion record, and the residual of the simulated loop with the replayed controller."
DYNAMICS = (
    "Force of the record and of the identified model (above), and their difference (below). The model was fitted to "
    "the part left of the line; the part right of it is held out."
)
FRICTION = (
    "Left: all force but inertia, over speed, measured and from the identified friction and offset. Right: "
    "increase of force after a reversal from full slip, with two standard deviations either way."
)
ROUND_TRIP = (
    "Errors of all identified values of the simulated tables, over their stated standard deviations: share below each "
    "size, beside the one expected if the stated deviations are right. Above the line: deviations overstated. "
    "Dashed: the 95 % interval."
)


def _bode(whole: Results) -> Drawing:
    r = whole["results"]["response"]
    figure, axes = style.subplots(3, 1, 120, sharex=True, height_ratios=[2, 2, 1.3])
    magnitude, phase, rest = axes[:, 0]
    f, used = np.array(r["frequency_Hz"]), np.array(r["used"], bool)
    dots = {"linestyle": "none", "marker": "o", "markersize": 3.0, "color": style.SKY}
    out = {"linestyle": "none", "marker": "x", "markersize": 3.5, "color": style.LIMIT}
    line = {"color": style.VERMILION, "linestyle": "-"}
    both = ((magnitude, "m_per_N", 1.0), (phase, "deg", 1.0))
    for ax, unit, _ in both:
        measured, modelled = np.array(r[f"measured_{unit}"]), np.array(r[f"modelled_{unit}"])
        ax.plot(f[used], measured[used], label="measured", **dots)
        if not np.all(used):
            ax.plot(f[~used], measured[~used], label="left out", **out)
        ax.plot(f, modelled, label="$P_l$ identified", **line)
    magnitude.set_xscale("log")
    magnitude.set_yscale("log")
    magnitude.set_ylabel("magnitude [m/N]")
    magnitude.legend()
    phase.set_ylabel("phase [deg]")
    phase.yaxis.set_major_locator(MultipleLocator(90))
    rest.plot(f[used], 100 * np.array(r["residual"])[used], label="difference", **dots)
    deviation = np.array(r["deviation"], float)
    if np.all(np.isfinite(deviation)):
        rest.plot(f, 100 * deviation, color=style.BLACK, linestyle=(0, (4, 2)), label="standard deviation")
    rest.set_yscale("log")
    rest.set_ylabel("of magnitude [%]")
    rest.set_xlabel("frequency [Hz]")
    rest.legend()
    return figure


def _stabilisation(whole: Results) -> Drawing:
    r = whole["results"]["response"]
    figure, axes = style.subplots(1, 2, 60, sharey=True, width_ratios=[3, 1])
    ax, size = axes[0, 0], axes[0, 1]
    for order in r["orders"]:
        f, kept = np.array(order["frequency_Hz"]), np.array(order["kept"], bool)
        level = np.full(f.size, order["modes"])
        ax.plot(f[kept], level[kept], linestyle="none", marker="o", markersize=4, color=style.VERMILION)
        ax.plot(f[~kept], level[~kept], linestyle="none", marker="x", markersize=4, color=style.LIMIT)
    style.mark_limit(ax, r["modes"], "")
    ax.set_xscale("log")
    ax.set_xlim(0.5 * min(r["frequency_Hz"]), 2 * max(r["frequency_Hz"]))
    ax.yaxis.set_major_locator(MultipleLocator(1))
    ax.set_ylabel("modes fitted")
    ax.set_xlabel("frequency [Hz]")
    left = [order["chi_square"] for order in r["orders"]]
    size.plot(left, [order["modes"] for order in r["orders"]], marker="o")
    if max(left) > 10 * min(left):
        size.set_xscale("log")
        size.xaxis.set_minor_formatter(NullFormatter())
    else:  # labels within a decade would stand on one another
        size.xaxis.set_major_locator(MaxNLocator(3))
    size.set_xlabel("chi-square")
    return figure


def _legend_above(ax: Any) -> None:
    """A legend in a strip of its own above the curves."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.22 * (high - low))
    ax.legend(loc="upper center", ncols=2)


def _loop(ax: Any, r: Results) -> None:
    path = 1e6 * np.array(r["path_m"])
    measured = np.array(r["measured_N"])
    rest = measured - np.array(r["modelled_N"]) + np.array(r["rolling_N"])
    dots = {"linestyle": "none", "marker": "o", "markersize": 1.8}
    ax.plot(path, rest, color=style.SKY, label="measured", **dots)
    ax.plot(path, r["rolling_N"], color=style.VERMILION, linestyle="-", linewidth=1.0, label="elements")
    ax.set_xlabel("position [µm]")
    ax.set_ylabel("rolling friction [N]")
    _legend_above(ax)


def _curve(ax: Any, curve: Results) -> None:
    distance, climbed, std = (np.array(curve[key]) for key in ("distance_m", "climbed_N", "std_N"))
    ax.fill_between(1e6 * distance, climbed - 2 * std, climbed + 2 * std, color=style.SKY, alpha=0.6, linewidth=0)
    ax.plot(1e6 * distance, climbed, color=style.VERMILION, linestyle="-")
    ax.set_xscale("log")
    ax.set_xlabel("distance after the reversal [µm]")
    ax.set_ylabel("force climbed [N]")


def _hysteresis(whole: Results) -> Drawing:
    r = whole["results"]["hysteresis"]
    figure, axes = style.subplots(1, 2, 72)
    _loop(axes[0, 0], r)
    _curve(axes[0, 1], r["curve"])
    return figure


def _motion(whole: Results) -> Drawing:
    r = whole["results"]["motion"]
    figure, axes = style.subplots(2, 1, 75, sharex=True, height_ratios=[1.4, 1])
    axes[0, 0].plot(r["time_s"], r["command_N"], linewidth=0.8)
    axes[0, 0].set_ylabel("command [N]")
    axes[1, 0].plot(r["time_s"], r["residual_N"], linewidth=0.6, color=style.VERMILION, linestyle="-")
    axes[1, 0].set_ylabel("difference [N]")
    axes[1, 0].set_xlabel("time [s]")
    axes[1, 0].set_xlim(r["time_s"][0], r["time_s"][-1])
    return figure


def _dynamics(whole: Results) -> Drawing:
    r = whole["results"]["dynamics"]
    figure, axes = style.subplots(2, 1, 90, sharex=True, height_ratios=[1.4, 1])
    time, measured, modelled = (np.array(r[key]) for key in ("time_s", "measured_N", "modelled_N"))
    axes[0, 0].plot(time, measured, label="measured", linewidth=1.4, color=style.SKY, linestyle="-")
    axes[0, 0].plot(time, modelled, label="identified", linewidth=0.7, color=style.BLACK, linestyle="-")
    axes[0, 0].set_ylabel("force [N]")
    _legend_above(axes[0, 0])
    axes[1, 0].plot(time, measured - modelled, linewidth=0.6, color=style.VERMILION, linestyle="-")
    axes[1, 0].set_ylabel("difference [N]")
    axes[1, 0].set_xlabel("time [s]")
    for ax in axes[:, 0]:
        style.mark_limit(ax, r["half_s"], "", axis="x")
    place, box = axes[1, 0].get_xaxis_transform(), {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    for words, by, side in (("fitted", -4, "right"), ("judged", 4, "left")):
        axes[1, 0].annotate(
            words, (r["half_s"], 0.03), (by, 0), place, "offset points", fontsize=7, ha=side, bbox=box
        )  # fmt: skip
    axes[1, 0].set_xlim(time[0], time[-1])
    return figure


def _friction(whole: Results) -> Drawing:
    r = whole["results"]["dynamics"]
    over = r["over_speed"]
    figure, axes = style.subplots(1, 2, 72)
    ax, speed = axes[0, 0], 1e3 * np.array(over["speed_m_per_s"])
    dots = {"linestyle": "none", "marker": "o"}
    ax.plot(speed, over["measured_N"], color=style.SKY, markersize=1.8, label="measured", **dots)
    ax.plot(speed, over["modelled_N"], color=style.VERMILION, markersize=1.0, label="identified", **dots)
    ax.set_xlabel("speed [mm/s]")
    ax.set_ylabel("friction and offset [N]")
    _legend_above(ax)
    _curve(axes[0, 1], r["curve"])
    return figure


def _round_trip(whole: Results) -> Drawing:
    figure, axes = style.subplots(1, 1, 70)
    ax = axes[0, 0]
    for kind in whole["results"]["round_trip"]["kinds"]:
        size = np.sort(np.abs(kind["errors"]))
        if size.size:
            ax.step(size, np.arange(1, size.size + 1) / size.size, where="post", label=kind["record"])
    x = np.linspace(0, 3.5, 200)
    ax.plot(x, 2 * scipy.stats.norm.cdf(x) - 1, color=style.LIMIT, linestyle="-", linewidth=0.9, label="as stated")
    style.mark_limit(ax, 1.96, "", axis="x")
    style.mark_limit(ax, 0.95, "95 %")
    ax.set_xlim(0, 3.5)
    ax.set_ylim(0, 1.01)
    ax.set_xlabel("error [standard deviations]")
    ax.set_ylabel("share of the values")
    ax.legend(loc="lower right")
    return figure
