"""The report of a blind trial: its figures and captions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from studies.wording import effect, filters

Results = Mapping[str, Any]

TABLES = {
    "targets": ("checks",),
    "outcomes": ("results.outcomes",),
    "rates": ("results.rates", "results.baselines"),
    "severity": ("results.severity",),
    "guards": ("results.guards",),
    "cases": ("results.table",),
    "forms": ("results.forms",),
    "parameters": ("parameters",),
}
MANY_TABLES = {
    "rejected": ("results.machines.rejected",),
    "worst": ("results.machines.worst",),
    "kinds": ("results.machines.kinds",),
    "drawnforms": ("results.machines.forms",),
    "errors": ("results.machines.errors",),
}
INJECTED_TABLES = {
    "targets": ("checks",),
    "rates": ("results.rates",),
    "records": ("results.records",),
    "forms": ("results.forms",),
    "cases": ("results.table",),
    "parameters": ("parameters",),
}
RATES = (
    "Right answers, false positives and abstentions, with 95 % intervals, beside three simpler methods on the same "
    "records. Dashes: the targets."
)
SEVERITY = Markdown(
    "Single effects by severity: named right, no effect named, a wrong one named. Above the bars: the median distance "
    "$D$ and the number of cases."
)
CALIBRATION = (
    "The probability that an answer states of its first candidate, and how often that effect was in the case; 95 % "
    "intervals, and the number of cases."
)
CONFUSION = Markdown(
    "What was in a case (rows) and what was answered (columns): numbers of cases. *both*: both of two effects, and "
    "nothing else. *several*: more than one effect is named."
)
CLOSURE = (
    "Closure of right answers on held-out motions over the distance of the effect, with the interval that the answer "
    "states."
)
RATE_NAMES: Final = {
    "false_accusation": "false positives, tables without an effect",
    "innocent_named": "false positives, all tables",
    "wrong_name": "wrong names, tables with effects of the catalogue",
    "abstention": "abstention, out-of-catalogue effects",
    "abstention_disabled": "abstention, disabled entries",
}
METHODS: Final = ("diagnosis", "aic_forward", "sparse_regression", "refit_only")
LOOKS: Final = dict(
    zip(METHODS, zip(style.COLOURS, style.MARKERS, strict=False), strict=False)  # of a method: colour and marker
)
SEVERITIES: Final = ("low", "middle", "high")
DRAWN_RATES: Final = (
    ("right_name", "right name", 0.95),
    ("both_named", "both named", 0.80),
    ("abstention", "abstains: out of catalogue", 0.90),
    ("abstention_disabled", "abstains: entry disabled", 0.90),
    ("false_accusation", "false positive: no effect", 0.02),
)


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    found = whole["results"]
    if found.get("injection"):
        return _injected(found)
    figures: list[Figure] = []
    if found["scored"]:
        figures += [
            Figure("rates", RATES, ("results.rates", "results.baselines"), _rates),
            Figure("severity", SEVERITY, ("results.severity",), _severity),
            Figure("confusion", CONFUSION, ("results.confusion",), _confusion),
        ]
        if found["calibration"]["first"]["count"]:
            figures.append(Figure("calibration", CALIBRATION, ("results.calibration",), _calibration))
        if found["closure"]["count"]:
            figures.append(Figure("closure", CLOSURE, ("results.table",), _closure))
    extra: dict[str, Callable[..., Any]] = {
        "share": _share,
        "number": _number,
        "whole": _whole,
        "name": _name,
        "names": _names,
        "answers": _answers,
    }
    question = "How often is the diagnosis right when the effect is withheld?"
    title = f"Blind trial of the diagnosis: {found['cases']} sealed cases"
    tables = {**TABLES, **(MANY_TABLES if found.get("machines") else {})}
    return Report(title, question, Path(__file__).parent / "report.md", tuple(figures), {**filters(), **extra}, tables)


def _injected(found: Results) -> Report:
    """The report on known laws in measured records."""
    extra: dict[str, Callable[..., Any]] = {"share": _share, "number": _number, "whole": _whole, "name": _name}
    return Report(
        f"Known laws in measured records: {found['cases']} cases",
        "Does the diagnosis name what was put into a measured record?",
        Path(__file__).parent / "injected.md",
        (),
        {**filters(), **extra},
        INJECTED_TABLES,
    )


def _share(rate: Results) -> str:
    """A rate with its interval, in percent."""
    if not rate["tries"]:
        return "– (none tried)"
    low, high = (f"{100 * rate[end]:.0f}" for end in ("low", "high"))
    return f"{100 * rate['share']:.0f} % ({low}–{high} %)"


def _number(number: float | None, digits: int = 3) -> str:
    return "–" if number is None else f"{number:.{digits}g}"


def _whole(number: float | None) -> str:
    """A number of two digits or more without its fraction."""
    return "–" if number is None else f"{number:.0f}" if abs(number) >= 10 else f"{number:.2g}"


def _name(name: str) -> str:
    """The name of an effect, an outcome, a method or a rate in words."""
    return RATE_NAMES.get(name) or effect(name)


def _answers(matrix: Results, row: int) -> str:
    """What was answered to the cases of a row of a confusion matrix, the most frequent first: there may be more answers
    than a page has room for columns."""
    counts = sorted(zip(matrix["counts"][row], matrix["columns"], strict=True), key=lambda one: -one[0])
    return "; ".join(f"{_name(name)}: {count}" for count, name in counts if count) or "–"


def _names(names: Sequence[str]) -> str:
    return " + ".join(effect(name) for name in names) or "–"


def _bar(ax: Axes, place: float, rate: Results, look: tuple[str, str], **more: Any) -> None:
    """One rate with its interval, in percent."""
    share = 100 * rate["share"]
    ends = [[share - 100 * rate["low"]], [100 * rate["high"] - share]]
    ax.errorbar([share], [place], xerr=ends, fmt=look[1], color=look[0], capsize=2, linewidth=0.9, **more)


def _rates(results: Results) -> Drawing:
    found = results["results"]
    figure, axes = style.subplots(1, 1, 75)
    ax = axes[0, 0]
    told: set[str] = set()
    for row, (key, _, target) in enumerate(DRAWN_RATES):
        ax.plot([100 * target] * 2, [row - 0.42, row + 0.42], color=style.LIMIT, linewidth=1.2, linestyle=(0, (3, 1.5)))
        for k, method in enumerate(method for method in METHODS if method in ("diagnosis", *found["baselines"])):
            rate = (found["rates"] if method == "diagnosis" else found["baselines"][method])[key]
            if rate["tries"]:
                label = None if method in told else effect(method)
                told.add(method)
                _bar(ax, row + 0.2 * (k - 1.5), rate, LOOKS[method], label=label, markersize=5 if k == 0 else 3)
    ax.set_yticks(range(len(DRAWN_RATES)), [name for _, name, _ in DRAWN_RATES])
    ax.set_ylim(len(DRAWN_RATES) - 0.5, -0.5)
    ax.set_xlim(-3, 103)
    ax.set_xlabel("share of the cases that count [%]")
    ax.grid(visible=False, axis="y")
    if told:
        figure.legend(loc="outside upper center", ncols=4)
    return figure


def _severity(results: Results) -> Drawing:
    found = results["results"]["severity"]
    figure, axes = style.subplots(1, 1, 60)
    ax, names = axes[0, 0], list(SEVERITIES)
    bottom = np.zeros(len(names))
    parts = (("right", style.BLUE, ""), ("silent", "#dddddd", "...."), ("accused", style.VERMILION, "////"))
    said = {"right": "named right", "silent": "no effect named", "accused": "wrong effect named"}
    for part, colour, hatch in parts:
        shares = np.array([100 * (found[name][part]["share"] or 0.0) for name in names])
        ax.bar(names, shares, bottom=bottom, color=colour, hatch=hatch, edgecolor="white", width=0.55, label=said[part])
        bottom += shares
    for k, name in enumerate(names):
        distance, tries = found[name]["median_distance"], found[name]["right"]["tries"]
        text = f"D = {_whole(distance)}, n = {tries}"
        ax.annotate(text, (k, bottom[k]), xytext=(0, 3), textcoords="offset points", ha="center", fontsize=7.0)
    ax.set_ylim(0, 110)
    ax.set_ylabel("share of cases [%]")
    ax.set_xlabel("severity")
    ax.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def _calibration(results: Results) -> Drawing:
    bins = results["results"]["calibration"]["first"]["bins"]
    figure, axes = style.subplots(1, 1, 70)
    ax = axes[0, 0]
    ax.plot([0, 1], [0, 1], color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)), label="as stated")
    stated = np.array([one["stated"] for one in bins])
    true = np.array([one["true"]["share"] for one in bins])
    ends = [[one["true"]["share"] - one["true"]["low"], one["true"]["high"] - one["true"]["share"]] for one in bins]
    ax.errorbar(stated, true, yerr=np.array(ends).T, fmt="o", color=style.BLUE, capsize=2, label="here")
    for one in bins:
        place = (one["stated"], one["true"]["share"])
        ax.annotate(str(one["true"]["tries"]), place, xytext=(5, 3), textcoords="offset points", fontsize=7.0)
    ax.set(xlim=(-0.03, 1.05), ylim=(-0.03, 1.05), xlabel="stated probability", ylabel="share of cases that hold it")
    ax.legend(loc="upper left")
    return figure


def _confusion(results: Results) -> Drawing:
    found = results["results"]["confusion"]
    counts = np.array(found["counts"], float)
    figure, axes = style.subplots(1, 1, 22 + 4.6 * len(found["rows"]))
    ax = axes[0, 0]
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    ax.imshow(shares, cmap="Greys", vmin=0, vmax=3.5, aspect="auto")
    for i, row in enumerate(found["rows"]):
        for j, column in enumerate(found["columns"]):
            if counts[i, j]:
                right = row == column or (row, column) in RIGHT
                colour = style.BLUE if right else style.VERMILION if column not in SILENT else style.BLACK
                weight = "bold" if right else "normal"
                ax.text(
                    j, i, f"{counts[i, j]:.0f}", ha="center", va="center", color=colour, weight=weight, fontsize=7.0
                )
    ax.set_xticks(range(len(found["columns"])), [effect(one) for one in found["columns"]], rotation=60, ha="right")
    ax.set_yticks(range(len(found["rows"])), [effect(one) for one in found["rows"]])
    ax.tick_params(labelsize=6.5)
    ax.set_xlabel("answered")
    ax.grid(visible=False)
    return figure


RIGHT: Final = {
    ("pair", "both"),
    ("outsider", "none_of_these"),
    ("disabled", "none_of_these"),
    *((kind, said) for kind in ("clean", "parameters") for said in ("nothing_to_explain", "parameters")),
}
SILENT: Final = ("none_of_these", "nothing_to_explain", "parameters", "failed")


def _closure(results: Results) -> Drawing:
    figure, axes = style.subplots(1, 1, 60)
    ax = axes[0, 0]
    rows = [
        row
        for row in results["results"]["table"]
        if row["right"] and row["closure"] is not None and row["distance"] and row["kind"] in ("single", "pair")
    ]
    for kind, colour, marker in (("single", style.BLUE, "o"), ("pair", style.VERMILION, "s")):
        those = [row for row in rows if row["kind"] == kind]
        if not those:
            continue
        place = [row["distance"] for row in those]
        height = np.array([row["closure"] for row in those])
        ends = np.array([row["interval"] or [row["closure"]] * 2 for row in those], float).T
        ends = np.abs(ends - height)
        ax.errorbar(place, height, yerr=ends, fmt=marker, color=colour, capsize=1.5, linewidth=0.7, label=kind)
    ax.set_xscale("log")
    ax.set(xlabel="distance D of the effect from the nearest nominal table [1]", ylabel="closure", ylim=(-0.1, 1.15))
    style.mark_limit(ax, 0.9, "0.9")
    if rows:
        ax.legend(loc="lower right")
    return figure
