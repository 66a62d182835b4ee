"""The report of the paper's gap: clouds of draws beside the paper's result, responses, and experiments."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

from models.quantity import keeps_to, listed, show, span
from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from studies.wording import effect, filters, quantity

Results = Mapping[str, Any]
MICRO: Final = 1e6
MIN_AGREEING_DRAWS: Final = 10  # agreeing draws, below which no odds are given
COLOURED: Final = 3  # candidates of a family that have a colour of their own: those that come nearest
WAYS: Final = {
    "alone": "alone",
    "beside": "beside a wrong friction",
    "beyond": "beyond its prior",
    "never": "not seen",
}

KINDS: Final = {
    "compensator": "the compensator's design",
    "parameters": "wrong parameters",
    "effects": "missing effects",
}
TAKEN: Final = {
    "loose_fits": "3σ as published",
    "loose_slopes": "3σ and the slopes",
    "pattern_fits": "whole pattern",
    "pattern_slopes": "pattern and the slopes",
}

TABLES = {
    "kinds": ("results.evidence",),
    "any": ("results.evidence.kinds",),
    "odds": ("results.evidence.odds",),
    "names": ("results.evidence.kinds",),
    "designs": ("results.designs",),
    "exchange": ("results.exchange",),
    "outcome": ("results.candidates",),
    "again": ("results.again",),
    "settling": ("results.settling", "machine.specification"),
    "experiments": ("results.decided",),
    "values": ("results.decided",),
    "candidates": ("results.candidates",),
    "parameters": ("parameters",),
}


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    results, published = whole["results"], whole["machine"]["published"]
    step = show(whole["machine"]["scale"]["resolution_m"], "m")
    figures = (
        Figure(
            "kinds",
            "3σ of the compensated sequence over the draws of each kind of cause, as cumulative shares: how much of "
            "each lies in the paper's range, which is shaded. The dashed line is the tolerance.",
            ("results.evidence", "results.pattern"),
            _kinds,
        ),
        Figure(
            "clouds",
            f"The compensated sequence with each candidate alone, over its prior range and "
            f"{results['tables']} tables: 3σ against the largest error of an inching motion, both after the settling "
            "time. A cross is a draw whose reversal is late. The shaded region is the paper's; stars are sizes that "
            "show the pattern beside a wrong friction or beyond the prior.",
            ("results.points", "results.candidates", "results.again", "results.pattern"),
            _clouds,
        ),
        Figure(
            "responses",
            Markdown(
                "Error of the positive motions by the scale: the first table by itself, and sizes of those candidates "
                "that come out first in [](#tbl:outcome), each on a table on which it shows the pattern or comes "
                "nearest. Thin grey: the same table without it."
            ),
            ("results.responses", "machine.specification"),
            _responses,
        ),
        Figure(
            "decision",
            "Predicted readings of the two experiments: a line per candidate, a mark per size with the pattern or "
            f"nearest to it, in steps (of {step}, or of the thrust that it makes through "
            + Markdown("$k_p$). Where marks of two candidates are apart, the experiment tells them apart."),
            ("results.decided",),
            _decision,
        ),
    )
    title = f"The paper's own gap: {whole['machine']['name']}"
    question = (
        f"With compensation the paper's table leaves 3σ = {show(published['dispersion_with_m'], 'm')} and inching "
        "motions that miss; the model does not. Is that the compensator's design, a wrong parameter or a missing "
        "effect, and which experiment tells?"
    )
    own: dict[str, Callable[..., Any]] = {
        "name": effect,
        "kind": KINDS.__getitem__,
        "reading": TAKEN.__getitem__,
        "counted": _counted,
        "odds": _told,
        "likely": _likely,
        "way": WAYS.__getitem__,
        "share": _share,
        "sizes": _sizes,
        "together": _together,
        "misses": _misses,
        "nearest": lambda rows: min(rows, key=_misses, default=None),
        "steps": _steps,
    }
    return Report(title, question, Path(__file__).parent / "report.md", figures, {**filters(), **own}, TABLES)


def _share(ratio: float) -> str:
    return "0" if ratio == 0 else ("< 1 %" if ratio < 0.01 else f"{100 * ratio:.0f} %")


def _counted(share: Results) -> str:
    """A share of draws with its interval [%]."""
    low, high = (100 * end for end in share["interval"])
    digits = 1 if share["share"] >= 0.01 else 2
    return (
        f"{100 * share['share']:.{digits}f} ({low:.{digits}f}–{high:.{digits}f})"
        if share["count"]
        else f"0 (0–{high:.{1 if high >= 1 else 2}f})"
    )


def _told(evidence: Results, reading: str, kind: str) -> str:
    """The probability of a kind with its interval, in a table; none of fewer than MIN_AGREEING_DRAWS draws."""
    found = evidence["odds"][reading][kind]
    return "–" if found is None or _agreeing(evidence, reading)[0] < MIN_AGREEING_DRAWS else _odds(found)


def _agreeing(evidence: Results, reading: str) -> tuple[int, int]:
    """How many draws of all kinds agree, and of how many."""
    shares = [one[reading] for one in evidence["kinds"].values()]
    return sum(one["count"] for one in shares), sum(one["of"] for one in shares)


def _odds(found: Results) -> str:
    """A probability with its interval."""
    low, high = (100 * end for end in found["interval"])
    return f"{100 * found['probability']:.0f} % ({low:.0f}–{high:.0f})"


def _likely(evidence: Results, reading: str) -> str:
    """The probabilities of the kinds, the largest first, as a part of a sentence; no odds of fewer than
    MIN_AGREEING_DRAWS draws."""
    count, of = _agreeing(evidence, reading)
    if count < MIN_AGREEING_DRAWS:
        return f"{count or 'none'} of the {of} draws {'agrees' if count == 1 else 'agree'}, too few for odds"
    odds = evidence["odds"][reading]
    kinds = sorted(odds, key=lambda kind: -float(odds[kind]["probability"]))
    return "it is " + listed(f"{KINDS[kind]} with {_odds(odds[kind])}" for kind in kinds)


def _misses(row: Results) -> float:
    """The least distance [m] of a candidate alone to the pattern within its prior."""
    return float(row["ways"]["alone"]["closest_m"])


def _sizes(ends: Sequence[float] | None, unit: str) -> str:
    """The sizes that show the pattern, least to largest."""
    if ends is None:
        return "–"
    low, high = (quantity(end, unit, 2) for end in ends)
    return span(low, high)


def _steps(values: Sequence[float]) -> str:
    """The range of some values, rounded."""
    low, high = (f"{round(end, 1) + 0.0:g}" for end in (min(values), max(values)))
    return span(low, high)


def _together(names: Sequence[str]) -> str:
    """Names as an enumeration."""
    return listed(effect(name) for name in names) or "none"


def _kinds(whole: Results) -> Drawing:
    results = whole["results"]
    figure, axes = style.subplots(1, 1, 50)
    ax, pattern = axes[0, 0], results["pattern"]
    low, high = (MICRO * (pattern["dispersion"] + sign * pattern["margin"]) for sign in (-1, 1))
    ax.axvspan(low, high, color=style.ORANGE, alpha=0.35, linewidth=0)
    style.mark_limit(ax, MICRO * pattern["tolerance"], "", axis="x")
    for kind, words in KINDS.items():
        sigma = MICRO * np.sort(np.array(results["evidence"]["kinds"][kind]["dispersions_m"], float))
        ax.plot(sigma, (np.arange(sigma.size) + 0.5) / sigma.size, label=words)
    ax.set_xscale("log")
    _ticks(ax.xaxis, (0.1, 0.3, 1, 3, 10, 30))
    ax.set_xlim(0.1, 30)
    ax.set_xlabel("3σ [µm]")
    ax.set_ylabel("share of the draws")
    ax.legend(loc="lower right")
    return figure


def _clouds(whole: Results) -> Drawing:
    results = whole["results"]
    families = list(dict.fromkeys(row["family"] for row in results["candidates"]))
    families.sort(key=["compensator", "parameters", "friction", "motor", "structure", "scale", "protocol"].index)
    figure, axes = style.subplots(math.ceil(len(families) / 2), 2, 180, sharex=True, sharey=True)
    for i, family in enumerate(families):
        _family(axes[i // 2, i % 2], family, results)
    label = f"largest inching error after {show(results['pattern']['settling_time'], 's')} [µm]"
    _label_lowest(axes, len(families), label)
    for ax in axes[:, 0]:
        ax.set_ylabel("3σ [µm]")
    return figure


def _label_lowest(axes: Any, count: int, label: str) -> None:
    """Hides the axes of a grid that are not used, and labels the lowest used one of each column."""
    for ax in axes.flat[count:]:
        ax.set_visible(False)
    for column in axes.T:
        lowest = [ax for ax in column if ax.get_visible()][-1:]
        for ax in lowest:
            ax.set_xlabel(label)
            ax.tick_params(labelbottom=True)


def _family(ax: Axes, family: str, results: Results) -> None:
    tolerance = results["pattern"]["tolerance"]
    rows = [row for row in results["candidates"] if row["family"] == family]
    _region(ax, results["pattern"])
    rows.sort(key=lambda row: row["ways"]["alone"]["closest_m"])
    for row in rows[COLOURED:]:
        _cloud(ax, results["points"][row["name"]], tolerance, "#9a9a9a", ".", None)
    for row, colour, marker in zip(rows, style.COLOURS, style.MARKERS, strict=False):
        if row in rows[:COLOURED]:
            _cloud(ax, results["points"][row["name"]], tolerance, colour, marker, effect(row["name"]))
    names = {row["name"] for row in rows}
    stars = [one["seen"] for one in results["again"] if one["shows"] and one["name"] in names]
    ax.plot(*_places(stars), linestyle="none", marker="*", color=style.BLACK, markersize=6)
    ax.set_title(family + (f" (grey: {len(rows) - COLOURED} more)" if len(rows) > COLOURED else ""))
    ax.legend(loc="lower right", fontsize=6.5)  # a large error with a small 3σ hardly occurs
    ax.set_xscale("log")
    ax.set_yscale("log")
    _ticks(ax.xaxis, (0.2, 0.5, 1, 2, 5, 10))
    _ticks(ax.yaxis, (0.1, 0.3, 1, 3, 10))
    ax.set_xlim(0.15, 20)
    ax.set_ylim(0.1, 30)


def _ticks(axis: Axis, at: Sequence[float]) -> None:
    """Plain numbers on a logarithmic axis."""
    axis.set_major_locator(FixedLocator(at))
    axis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in at]))
    axis.set_minor_formatter(NullFormatter())


def _places(seen: Sequence[Results]) -> tuple[list[float], list[float]]:
    return [MICRO * one["inching_error_m"] for one in seen], [MICRO * one["dispersion_m"] for one in seen]


def _region(ax: Axes, pattern: Results) -> None:
    """The paper's outcome: an inching motion beyond the tolerance, 3 sigma as published."""
    low, high = (MICRO * (pattern["dispersion"] + sign * pattern["margin"]) for sign in (-1, 1))
    ax.fill_between([MICRO * pattern["tolerance"], 1e3], low, high, color=style.ORANGE, alpha=0.35, linewidth=0)
    ax.annotate("paper", (12, MICRO * pattern["dispersion"]), fontsize=6.5, ha="center", va="center")


def _cloud(ax: Axes, points: Results, tolerance: float, colour: str, marker: str, label: str | None) -> None:
    x, y = MICRO * np.array(points["inching_error_m"]), MICRO * np.array(points["dispersion_m"])
    late = ~np.array([keeps_to(one, tolerance) for one in points["reversal_error_m"]], bool)
    common: dict[str, Any] = {"linestyle": "none", "color": colour, "alpha": 0.6}
    ax.plot(x[~late], y[~late], marker=marker, markersize=2.2, label=label, **common)
    ax.plot(x[late], y[late], marker="x", markersize=3.0, **common)


def _responses(whole: Results) -> Drawing:
    drawn, wanted = whole["results"]["responses"], whole["machine"]["specification"]
    figure, axes = style.subplots(
        math.ceil(len(drawn) / 2), 2, 45 * math.ceil(len(drawn) / 2), sharex=True, sharey=True
    )
    for i, one in enumerate(drawn):
        _motions(axes[i // 2, i % 2], one, wanted)
    axes[0, 0].legend(loc="upper right")
    _label_lowest(axes, len(drawn), "time from the step [ms]")
    for ax in axes[:, 0]:
        ax.set_ylabel("error [µm]")
    return figure


def _motions(ax: Axes, one: Results, wanted: Results) -> None:
    time = 1e3 * np.array(one["time_s"])
    style.tolerance_band(ax, 0.0, MICRO * wanted["tolerance_m"], "")
    style.mark_limit(ax, 1e3 * wanted["settling_time_s"], "", axis="x")
    if one["name"]:
        ax.plot(time, MICRO * np.array(one["without_m"]).T, color="#8a8a8a", linestyle="-", linewidth=0.5)
    errors = MICRO * np.array(one["error_m"])
    ax.plot(time, errors[1:].T, color=style.BLUE, linestyle="-", linewidth=0.9)
    ax.plot(time, errors[0], color=style.VERMILION, linestyle="-", linewidth=1.5)
    ax.plot([], [], color=style.VERMILION, linestyle="-", label="reversal")
    ax.plot([], [], color=style.BLUE, linestyle="-", label="inching")
    words = f"{effect(one['name'])}, {WAYS[one['way']]}" if one["name"] else "nothing added"
    ax.set_title(words, fontsize=7.5)
    ax.set_ylim(-6, 6)
    ax.set_xlim(10, time[-1])


def _decision(whole: Results) -> Drawing:
    decided = whole["results"]["decided"]
    shown = list(dict.fromkeys((decided["first"], decided["second"])))
    names = list(decided["experiments"][0]["values_steps"])
    figure, axes = style.subplots(1, len(shown), 22 + 6 * len(names), sharey=True)
    for ax, at in zip(axes[0], shown, strict=True):
        experiment = decided["experiments"][at]
        best = experiment["best"]
        for place, name in enumerate(names):
            values = [draw[best] for draw in experiment["values_steps"][name]]
            ax.plot(values, [place] * len(values), marker="o", color=style.BLUE, linestyle="-", linewidth=0.8)
        ax.axvline(0.0, color=style.LIMIT, linewidth=0.7)
        ax.set_title(experiment["name"])
        ax.set_xlabel(_broken(f"{experiment['observables'][best]} [steps]"))
    axes[0, 0].set_yticks(range(len(names)), [effect(name) for name in names])
    axes[0, 0].invert_yaxis()
    return figure


def _broken(text: str) -> str:
    """A long label on two lines."""
    words = text.split()
    breaks = [sum(len(word) + 1 for word in words[:i]) for i in range(len(words))]
    middle = next((i for i, (a, b) in enumerate(pairwise(breaks), start=1) if a <= len(text) / 2 < b), 0)
    return text if len(text) < 40 or not middle else " ".join(words[:middle]) + "\n" + " ".join(words[middle:])
