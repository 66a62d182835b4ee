"""The figures of a diagnosis, each drawn from the content of results.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Drawing

from diagnosis.model.kalman import STARTING
from models.quantity import show
from reports import style
from reports.units import force_unit, length_unit, time_unit
from studies.gap_diagnosis.unknown_law import OVER
from studies.wording import effect

Results = Mapping[str, Any]

MAX_BARS = 12  # effects in a bar chart at most
DECADES = 300.0  # ratio of an axis' ends from which on only powers of ten are marked
LIGHT = "#c9dbe8"  # for bands and areas, light enough in print
LEARNED_LABEL = {"drag": "drag on the table", "thrust": "part of the thrust"}
GAPS = (
    ("force_N", force_unit, "unknown force"),
    ("position_m", length_unit, "position"),
    ("settling_s", time_unit, "settling"),
)


def waterfall(whole: Results) -> Drawing:
    """Force, position and settling stage by stage, with floor and ceiling."""
    far, ceiling = whole["results"]["how_far"], whole["results"]["where"]["details"]["ceiling"]["share"]
    stages = far["stages"]
    names = _stages([stage["added"] for stage in stages])
    known = [part for part in GAPS if any(stage[part[0]] is not None for stage in stages)]
    figure, axes = style.subplots(1, len(known), 34 + 7 * len(stages), sharey=True)
    rows = np.arange(len(stages))[::-1]
    for ax, (key, in_unit, label) in zip(axes[0], known, strict=True):
        factor, unit = in_unit(max(stage[key] or 0.0 for stage in stages))
        values = [np.nan if stage[key] is None else factor * stage[key] for stage in stages]
        ax.barh(rows, np.nan_to_num(values), height=0.6, facecolor=LIGHT, edgecolor=style.BLUE)
        for row, value in zip(rows, values, strict=True):
            text = "–" if np.isnan(value) else f"{float(f'{value:.2g}'):g}"
            ax.annotate(
                text, (np.nan_to_num(value), row), xytext=(3, 0), textcoords="offset points", va="center", fontsize=7
            )
        if far["floor"][key] is not None:
            ax.axvline(
                factor * far["floor"][key], color=style.LIMIT, linestyle=(0, (4, 2)), linewidth=1.0, label="floor"
            )
        largest = float(np.nanmax([*values, 0.0]))
        ax.set_xlim(0, 1.25 * largest if largest > 0 else 1.0)
        ax.set_xlabel(f"{label} [{unit}]")
        ax.grid(axis="y", visible=False)
        if key == "force_N":
            curves = factor * far["gap_refitted"]["force_N"] * max(1 - ceiling, 0.0) ** 0.5
            ax.axvline(curves, color=style.VERMILION, linestyle=(0, (1, 1.2)), linewidth=1.2, label="flexible curves")
    axes[0, 0].set_yticks(rows, names)
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=2, fontsize=6.5)
    return figure


def _stages(added: Sequence[str]) -> list[str]:
    """The stages in words: two without an effect, then what each adds."""
    names = [effect(name) for name in added[:2]]
    for i, name in enumerate(added[2:], start=2):
        names.append(f"with {'more ' * (name in added[2:i])}{effect(name)}")
    return names


def force(whole: Results) -> Drawing:
    """The unknown force over each record: slow with its band, fast as its extremes, and the reference."""
    records, known = whole["results"]["pictures"]["force"], whole["results"]["records"]
    figure, axes = style.subplots(2 * len(records), 1, 60 * len(records) + 10, height_ratios=[3, 1.2] * len(records))
    for i, (one, record) in enumerate(zip(records, known, strict=True)):
        ax, below = axes[2 * i, 0], axes[2 * i + 1, 0]
        time, slow, band = np.array(one["time_s"]), np.array(one["slow_N"]), 1.96 * one["slow_deviation_N"]
        ax.fill_between(
            time, one["fast_low_N"], one["fast_high_N"], facecolor="#dddddd", edgecolor="none",
            label=f"fast, its extremes (band ± {show(1.96 * one['fast_deviation_N'], 'N', 2)})",
        )  # fmt: skip
        ax.fill_between(time, slow - band, slow + band, facecolor="#7fb2d6", edgecolor="none", label="slow, 95 % band")
        ax.plot(time, slow, color=style.BLUE, linewidth=0.8, linestyle="-", label="slow")
        counts = time > STARTING * record["sample_time_s"]  # before that the smoother has not settled
        ends = np.concatenate([(slow - band)[counts], (slow + band)[counts], np.array(one["fast_low_N"])[counts],
                               np.array(one["fast_high_N"])[counts]])  # fmt: skip
        if ends.size and np.ptp(ends) > 0:
            ax.set_ylim(ends.min() - 0.05 * np.ptp(ends), ends.max() + 0.05 * np.ptp(ends))
        ax.set_title(record["name"])
        ax.set_ylabel("$d$ [N]")
        ax.tick_params(labelbottom=False)
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize=6.5)
        factor, unit = length_unit(float(np.max(np.abs(one["reference_m"]))))
        below.plot(time, factor * np.array(one["reference_m"]), color=style.BLACK, linewidth=0.8, linestyle="-")
        below.set_ylabel(f"$x_T^*$ [{unit}]")
        for part in (ax, below):
            part.set_xlim(0, time[-1])
        below.set_xlabel("time [s]")
    return figure


def courses(whole: Results) -> Drawing:
    """The force during the motions where it is largest."""
    rows = whole["results"]["pictures"]["courses"]
    figure, axes = style.subplots(2, len(rows), 80, height_ratios=[3, 1.2], sharex="col")
    for i, row in enumerate(rows):
        ax, below = axes[0, i], axes[1, i]
        time, mean = 1e3 * np.array(row["time_s"]), np.array(row["force_N"])
        spread = np.array(row["scatter_N"]) if row["motions"] > 1 else np.full(mean.size, 1.96 * row["deviation_N"])
        label = f"scatter of {row['motions']}" if row["motions"] > 1 else "95 % band"
        ax.fill_between(time, mean - spread, mean + spread, facecolor=LIGHT, edgecolor="none", label=label)
        ax.plot(time, mean, color=style.BLUE, linestyle="-", label="mean" if row["motions"] > 1 else "$d$")
        ax.set_title(row["name"].replace(" at ", "\nat "), fontsize=7)
        ax.margins(y=0.3)  # room for the legend above or below the curve
        ax.legend(loc="best")
        factor, unit = length_unit(float(np.max(np.abs(row["reference_m"]))))
        below.plot(time, factor * np.array(row["reference_m"]), color=style.BLACK, linestyle="-")
        below.set_ylabel(f"[{unit}]")
        below.set_xlabel("time [ms]")
    axes[0, 0].set_ylabel("$d$ [N]")
    return figure


def maps(whole: Results) -> Drawing:
    """Kinds of motion against phases: the force's size, and its share of the energy as a number."""
    table = whole["results"]["where"]["details"]["motion_by_phase"]
    time, size, share = (np.array(table[key]) for key in ("time", "rms_N", "share"))
    used, seen = np.flatnonzero(time.sum(axis=1) > 0), np.flatnonzero(time.sum(axis=0) > 0)
    pick = np.ix_(used, seen)
    shown = np.where(time[pick] > 0, size[pick], np.nan)
    figure, axes = style.subplots(1, 1, max(18 + 8 * len(used), 40))
    ax = axes[0, 0]
    image = ax.imshow(shown, aspect="auto", cmap="Blues", vmin=0)
    for row, column in np.ndindex(shown.shape):
        if np.isfinite(shown[row, column]):
            dark = shown[row, column] > 0.6 * np.nanmax(shown)
            ax.text(column, row, _percent(float(share[pick][row, column])), ha="center", va="center", fontsize=7,
                    color="white" if dark else "black")  # fmt: skip
    ax.set_yticks(range(len(used)), [table["motions"][i] for i in used])
    ax.set_xticks(range(len(seen)), [table["phases"][i] for i in seen], rotation=30, ha="right")
    ax.grid(visible=False)
    figure.colorbar(image, ax=ax, label="force, rms [N]")
    return figure


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else f"{100 * share:.1f} %"


def coordinates(whole: Results) -> Drawing:
    """What each coordinate explains on held-out motions, and the curve of the best one that has a curve."""
    rows = whole["results"]["where"]["details"]["coordinates"]
    figure, axes = style.subplots(1, 2, 70, width_ratios=[1.3, 1])
    ax, curve = axes[0]
    place = np.arange(len(rows))[::-1]
    share, low, high = (np.array([row[key] for row in rows]) for key in ("share", "low", "high"))
    ax.barh(place, share, height=0.6, facecolor=LIGHT, edgecolor=style.BLUE)
    ax.errorbar(share, place, xerr=[np.maximum(share - low, 0), np.maximum(high - share, 0)], fmt="none",
                ecolor=style.BLACK, elinewidth=0.8, capsize=2)  # fmt: skip
    turning = np.array([row["turning"] for row in rows])
    ax.plot(
        turning, place, linestyle="none", marker="D", markersize=3.5, color=style.VERMILION, label="directional part"
    )
    names = [effect(row["name"]) + (f" {show(row['pitch_m'], 'm', 3)}" if row["pitch_m"] else "") for row in rows]
    ax.set_yticks(place, [f"{name}, p = {row['p']:.2g}" for name, row in zip(names, rows, strict=True)])
    ax.set_xlim(0, 1)
    ax.set_xlabel("share of variance, held-out motions")
    ax.grid(axis="y", visible=False)
    ax.legend(loc="lower right")
    best = next((row for row in rows if len(row["knots"]) > 2), rows[0])
    _curve(curve, best)
    return figure


def _curve(ax: Any, row: Results) -> None:
    """The curve over a coordinate at its knots, evenly spaced where they span decades."""
    knots = np.array(row["knots"])
    positive = knots[knots > 0]
    even = positive.size > 3 and knots.max() / positive.min() > 100
    factor, unit = (1.0, row["unit"]) if even or row["unit"] != "m" else length_unit(float(np.max(np.abs(knots))))
    at = np.arange(knots.size) if even else factor * knots
    ax.plot(at, row["curve"], marker="o", label="both directions")
    if row["turned"]:
        ax.plot(at, row["turned"], marker="s", label="directional")
        ax.legend()
    if even:
        ax.set_xticks(at, [show(float(knot), unit, 2) for knot in knots], rotation=90)
    ax.set_xlabel(effect(row["name"]) if even else f"{effect(row['name'])} [{unit}]")
    ax.set_ylabel("$d$ [N]")


def spectra(whole: Results) -> Drawing:
    """Power spectral density of the fast force, and the share of variance that sines of the position explain."""
    pictures = whole["results"]["pictures"]
    figure, axes = style.subplots(1, 2, 60)
    ax, place = axes[0]
    line = pictures["spectrum"]
    ax.loglog(line["frequency_Hz"], line["force_N2_per_Hz"], label="unknown force, fast")
    ax.loglog(
        line["frequency_Hz"], line["noise_N2_per_Hz"], color=style.LIMIT, linestyle=(0, (4, 2)), label="noise alone"
    )
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("power density [N$^2$/Hz]")
    ax.legend()
    periods = pictures["periods"]
    if periods is None:
        place.text(0.5, 0.5, "too little travel\nfor a period over position", ha="center", va="center",
                   transform=place.transAxes)  # fmt: skip
        place.set_axis_off()
    else:
        factor, unit = length_unit(max(periods["period_m"]))
        place.semilogx(factor * np.array(periods["period_m"]), periods["share"])
        ticks = _ticks(factor * min(periods["period_m"]), factor * max(periods["period_m"]))
        place.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        place.minorticks_off()
        place.set_xlabel(f"period over position [{unit}]")
        place.set_ylabel("share of variance explained")
        place.set_ylim(0)
    return figure


def _ticks(low: float, high: float) -> list[float]:
    """The numbers of 1, 2 and 5 times a power of ten from low to high; only the powers where they span decades."""
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    factors = (1, 2, 5) if high / low < DECADES else (1,)
    return [float(tick) for tick in np.outer(powers, factors).ravel() if 0.99 * low <= tick <= 1.01 * high]


def gains(whole: Results) -> Drawing:
    """The effects' held-out gain in chi-square, with their thresholds; the named ones are marked."""
    results = whole["results"]
    named = set(results["verdict"]["effects"])
    rows = [row for row in results["which"] if row["held_out_gain"] is not None][:MAX_BARS]
    figure, axes = style.subplots(1, 1, 12 + 5.5 * max(len(rows), 4))
    ax = axes[0, 0]
    place = np.arange(len(rows))[::-1]
    least = 1.0
    for row, at in zip(rows, place, strict=True):
        inside = row["effect"] in named
        ax.barh(at, max(row["held_out_gain"], least), height=0.6, facecolor=LIGHT if not inside else style.SKY,
                edgecolor=style.BLUE, hatch="////" if inside else "")  # fmt: skip
        ax.plot([row["threshold"]] * 2, [at - 0.38, at + 0.38], color=style.VERMILION, linestyle="-", linewidth=1.6)
    ax.plot([], [], color=style.VERMILION, linestyle="-", linewidth=1.6, label="threshold")
    ax.bar(0, 0, facecolor=style.SKY, edgecolor=style.BLUE, hatch="////", label="named")
    ax.set_xscale("log")
    ax.set_xlim(least)
    ax.set_yticks(place, [effect(row["effect"]) for row in rows])
    ax.set_xlabel("held-out gain in chi-square")
    ax.grid(axis="y", visible=False)
    ax.legend(loc="lower right")
    return figure


def confusable(whole: Results) -> Drawing:
    """The chi-square by which each effect would win over each other for these records; marked where it is too small."""
    found = whole["results"]["confusability"]
    names = [effect(name) for name in found["names"]]
    distance = np.array([[np.nan if item is None else item for item in row] for row in found["distance"]], float)
    square, enough = distance**2, found["threshold"]
    figure, axes = style.subplots(1, 1, 135)
    ax = axes[0, 0]
    scale = LogNorm(0.1 * enough, 1e3 * enough, clip=True)
    image = ax.imshow(np.maximum(square, 1e-9), cmap="Greys_r", norm=scale, aspect="auto")
    look: dict[str, Any] = {"markersize": 4, "color": style.VERMILION, "linestyle": "none"}
    for row, column in np.argwhere(square < enough):
        if row == column:
            ax.plot(column, row, marker="o", **look)
        elif min(square[row, row], square[column, column]) >= enough:
            ax.plot(column, row, marker="x", **look)
    ax.set_yticks(range(len(names)), names, fontsize=6.5)
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=6.5)
    ax.set_ylabel("effect that acts, at its typical size")
    ax.set_xlabel("effect that is fitted, with the nominal values")
    ax.grid(visible=False)
    bar = figure.colorbar(image, ax=ax, label="chi-square by which the row's wins over the column's", extend="both")
    bar.ax.axhline(enough, color=style.VERMILION, linewidth=1.6)
    return figure


def next_run(whole: Results) -> Drawing:
    """The references of the proposed experiment."""
    run = whole["results"]["next"]
    figure, axes = style.subplots(2, 1, 62, sharex=True)
    factor, unit = length_unit(float(np.max(np.abs(run["reference_m"]))))
    _line(axes[0, 0], run["time_s"], factor * np.array(run["reference_m"]), f"$x_T^*$ [{unit}]")
    _line(axes[1, 0], run["time_s"], run["feedforward_N"], "feedforward [N]")
    axes[1, 0].set_xlabel("time [s]")
    return figure


def _line(ax: Any, time: Sequence[float], values: Any, label: str) -> None:
    ax.plot(time, values, linewidth=0.8, linestyle="-")
    ax.set_ylabel(label)
    ax.set_xlim(0, time[-1])


def learned_curve(whole: Results) -> Drawing:
    """The learned force over its coordinate, with its band."""
    learned = whole["results"]["learned"]
    figure, axes = style.subplots(1, 1, 62)
    ax, knots, band = axes[0, 0], np.array(learned["knots"]), np.array(learned["band"])
    ax.fill_between(knots, band[:, 0], band[:, 1], facecolor=LIGHT, edgecolor="none", label="95 % band")
    ax.plot(knots, learned["values"], color=style.BLUE, marker="o", markersize=2.5, linestyle="-", label="learned")
    ax.set_xlabel(f"{OVER[learned['coordinate']]} [{learned['unit']}]")
    ax.set_ylabel(f"{LEARNED_LABEL.get(learned['symmetry'], 'force on the table')} [{learned['values_unit']}]")
    ax.legend(loc="best")
    return figure
