"""The report of the trajectory optimisation: its figures and captions (report.md)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure as Drawing

from models.quantity import show
from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from reports.units import length_unit, time_unit
from studies.wording import filters

Results = Mapping[str, Any]

FINEST: Final = 0.1  # of the fine tolerance: where the axis of the largest errors begins
RESPONSE_SHOWN: Final = 1.6  # settling times of the responses that are drawn
SPECIFIED = ("machine.specification", "results.wanted")
LABELS = {
    "deadbeat": "deadbeat alone",
    "paper": "deadbeat and RFM",
    "paper_learning": "deadbeat and RFM, learning",
    "common": "one for all",
    "peak": "history-aware, least peak",
    "aware": "history-aware, chosen",
    "learning": "history-aware, learning",
}
TABLES: dict[str, tuple[str, ...]] = {
    "ensemble": ("results.rows", *SPECIFIED),
    "yield": ("results.rows", *SPECIFIED),
    "fresh": ("results.fresh", "results.rows", *SPECIFIED),
    "everything": ("results.everything", *SPECIFIED),
    "starts": ("results.everything", "machine.specification"),
    "members": ("results.members", *SPECIFIED),
    "central": ("results.rows", *SPECIFIED),
    "settling": ("results.settling", "machine.specification"),
    "solver": ("results.solver",),
    "pareto": ("results.pareto", "results.errors"),
    "parameters": ("parameters",),
}
DISPERSION = (
    "Dispersion over the tables: share of tables whose 3σ of the positive motions, after the specified settling time, "
    "is at most the value on the axis."
)
ENVELOPE = (
    "Largest error of any motion at each time from the step, its 95 % quantile over the tables. A curve that enters "
    "the grey band and stays there means that every motion settles on 95 % of the tables."
)
RESPONSES = (
    "Positive motions on the central table: distance travelled; deadbeat and RFM, one trajectory for all, and the "
    "history-aware one."
)
TRAJECTORIES = Markdown(
    "The trajectories $x_T^*$, and the thrust that they ask for; for a history-aware one, the thrust of the reversal "
    "and of the last inching motion."
)
PARETO = (
    "The cost of a shorter motion: peak thrust over the sequence, and the error after the motion on tables one "
    "standard deviation off, in the nonsmooth simulation."
)
CERTIFICATE = (
    "Largest difference between smoothed and exact friction over random paths, and between the closed loop's responses "
    "to random motions, against the smoothing width."
)
FAILED = "Where the solver stopped, for a motion one sample shorter than the shortest."


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    results = whole["results"]
    figures = [
        Figure("dispersion", DISPERSION, ("results.shown", "machine.specification"), _dispersion),
        Figure("envelope", ENVELOPE, ("results.shown", "results.shown_time_s", *SPECIFIED), _envelope),
        Figure("responses", RESPONSES, ("results.shown", "results.shown_time_s", *SPECIFIED), _responses),
        Figure("trajectories", TRAJECTORIES, ("results.designs", "results.wanted"), _trajectories),
        Figure("pareto", PARETO, ("results.pareto", "results.shortest", "results.wanted"), _pareto),
        Figure("certificate", CERTIFICATE, ("results.certificate",), _certificate),
    ]
    if results["failed"] is not None:
        figures.append(Figure("failed", FAILED, ("results.failed", "results.wanted"), _failed))
    title = (
        f"Trajectories for {show(results['wanted']['stroke_m'], 'm')} motions with friction: {whole['machine']['name']}"
    )
    question = "Which trajectory makes every motion settle, from any state that earlier motions leave in the friction?"
    specification = whole["machine"]["specification"]
    tolerance, settling = specification["tolerance_m"], specification["settling_time_s"]
    own: dict[str, Callable[..., Any]] = {
        "show": _show,
        "share": _share,
        "as_length": partial(_in_unit, unit=length_unit(tolerance)[0], typical=tolerance),
        "as_time": partial(_in_unit, unit=time_unit(settling)[0], typical=settling),
        "unit_of_length": lambda length: length_unit(length)[1],
        "unit_of_time": lambda time: time_unit(time)[1],
        "rated": _rated,
    }
    return Report(title, question, Path(__file__).parent / "report.md", tuple(figures), {**filters(), **own}, TABLES)


def _show(number: float | None, unit: str, digits: int = 4) -> str:
    """A number for the text; None stands for one that is not finite."""
    return "none" if number is None else show(number, unit, digits).replace(" ", "\u00a0")


def _share(ratio: float) -> str:
    return f"{100 * ratio:.3g} %".replace(" ", "\u00a0")


def _rated(rate: Mapping[str, Any], tables: int) -> str:
    """A share with its lower bound."""
    return f"{rate['hits']} of {tables} (≥ {100 * rate['low']:.1f} %)".replace(" ", "\u00a0")


def _in_unit(value: float | None, unit: float, typical: float) -> str:
    """A number (SI) for a table in a unit, so many of which are in 1, with the digits that a typical one needs."""
    return "never" if value is None else f"{unit * value:.{_decimals(unit * typical)}f}"


def _decimals(typical: float) -> int:
    """The decimals [-] that show a hundredth of a typical number."""
    return max(2 - math.floor(math.log10(typical)), 1)


def _units_of(largest: float, time: Sequence[float]) -> tuple[tuple[float, str], tuple[float, str]]:
    """The units of an axis of lengths up to the largest [m] and of one of times (n,) [s], each as `length_unit`."""
    return length_unit(largest), time_unit(max(time))


def _dispersion(whole: Results) -> Drawing:
    figure, axes = style.subplots(1, 1, 72)
    ax = axes[0, 0]
    count, unit = length_unit(whole["machine"]["specification"]["tolerance_m"])
    for key, label in LABELS.items():
        values = count * np.array(whole["results"]["shown"][key]["dispersions_m"])
        ax.step(values, np.arange(1, values.size + 1) / values.size * 100, where="post", label=label)
    ax.set_xlabel(f"3σ after the specified settling time [{unit}]")
    ax.set_ylabel("share of tables [%]")
    ax.set_xlim(left=0)
    ax.set_ylim(0, 101)
    ax.axhline(95, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
    ax.annotate(
        "95 %", (1.0, 95), xycoords=ax.get_yaxis_transform(), xytext=(3, 0), textcoords="offset points", fontsize=7
    )
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.02), ncols=3)
    return figure


def _envelope(whole: Results) -> Drawing:
    results, specification = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 1, 70)
    ax = axes[0, 0]
    wanted = results["wanted"]
    count, unit = length_unit(specification["tolerance_m"])
    times, of_time = time_unit(specification["settling_time_s"])
    time = times * np.array(results["shown_time_s"])
    for key, label in LABELS.items():
        ax.semilogy(time, count * np.array(results["shown"][key]["error_m"]), label=label)
    fine, coarse = count * wanted["tolerance_m"], count * specification["tolerance_m"]
    least = FINEST * fine
    ax.axhspan(least, fine, facecolor="#e4e4e4", edgecolor="none", zorder=0.5)
    style.mark_limit(ax, fine, f"±{fine:g} {unit}")
    style.mark_limit(ax, coarse, f"±{coarse:g} {unit}")
    for limit in (wanted["settling_time_s"], specification["settling_time_s"]):
        style.mark_limit(ax, times * limit, f"{times * limit:g} {of_time}", "x")
    ax.set_xlim(0, time[-1])
    ax.set_ylim(least, 3 * count * wanted["stroke_m"])
    ax.set_xlabel(f"time from the step [{of_time}]")
    ax.set_ylabel(f"largest error [{unit}]")
    # Above the axes it hides neither curves nor the labels of the two times.
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.02), ncols=3)
    return figure


def _responses(whole: Results) -> Drawing:
    results, specification = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 3, 62, sharey=True)
    count, unit = length_unit(results["wanted"]["stroke_m"])
    times, of_time = time_unit(specification["settling_time_s"])
    time = times * np.array(results["shown_time_s"])
    stroke = count * results["wanted"]["stroke_m"]
    for ax, key in zip(axes[0], ("paper", "common", "aware"), strict=True):
        style.tolerance_band(ax, stroke, count * specification["tolerance_m"], "tolerance")
        every = count * np.array(results["shown"][key]["position_m"])
        for i, position in reversed(list(enumerate(every))):
            first = i == 0
            ax.plot(
                time,
                position,
                color=style.VERMILION if first else style.BLUE,
                linestyle="-" if first else (0, (5, 1.5)),
                linewidth=1.6 if first else 0.9,
                zorder=3 if first else 2,
                label="reversal" if first else ("inching" if i == 1 else None),
            )
        style.mark_limit(ax, times * results["wanted"]["settling_time_s"], "", "x")
        ax.set_title(LABELS[key])
        ax.set_xlabel(f"time from the step [{of_time}]")
        ax.set_xlim(0, min(RESPONSE_SHOWN * times * specification["settling_time_s"], time[-1]))
    axes[0, 0].set_ylabel(f"distance travelled [{unit}]")
    axes[0, 2].legend(loc="lower right")
    return figure


def _trajectories(whole: Results) -> Drawing:
    results = whole["results"]
    figure, axes = style.subplots(2, 1, 95, sharex=True)
    (count, unit), (times, of_time) = _units_of(results["wanted"]["stroke_m"], results["designs"]["aware"]["time_s"])
    for key, colour in zip(("deadbeat", "common", "peak", "aware"), style.COLOURS, strict=False):
        design = results["designs"][key]
        time = times * np.array(design["time_s"])
        label = "deadbeat" if key == "deadbeat" else LABELS[key]
        (line,) = axes[0, 0].plot(time, count * np.array(design["position_m"]), color=colour, label=label)
        thrusts = [design["thrust_N"][0], design["thrust_N"][-1]]
        for i, thrust in enumerate(thrusts[: len(design["thrust_N"])]):
            axes[1, 0].step(
                time,
                thrust,
                where="post",
                color=colour,
                linestyle=line.get_linestyle(),
                linewidth=1.3 if i == 0 else 0.7,
            )
    limit = results["wanted"]["thrust_limit_N"]
    style.mark_limit(axes[1, 0], limit, f"{limit:.4g} N")
    style.mark_limit(axes[1, 0], -limit, f"−{limit:.4g} N")
    axes[0, 0].axhline(count * results["wanted"]["stroke_m"], color=style.LIMIT, linewidth=0.7, linestyle=(0, (4, 2)))
    axes[0, 0].set_ylabel(f"$x_T^*$ [{unit}]")
    axes[0, 0].legend(loc="lower right")
    axes[1, 0].set_ylabel("thrust [N]")
    axes[1, 0].set_xlabel(f"time from the step [{of_time}]")
    return figure


def _pareto(whole: Results) -> Drawing:
    results = whole["results"]
    figure, axes = style.subplots(1, 2, 65)
    tried = [one for one in results["shortest"]["tried"] if one["peak_N"] <= 2 * results["wanted"]["rated_N"]]
    left = [row["sensitivity_m"] for row in results["pareto"]]
    (count, unit), (times, of_time) = _units_of(max(left), [row["time_s"] for row in (*results["pareto"], *tried)])
    axes[0, 0].plot(
        [times * one["time_s"] for one in tried],
        [one["peak_N"] for one in tried],
        linestyle="none",
        marker="x",
        color=style.LIMIT,
        label="from full slip",
    )
    for design, marker in (("least peak thrust", "o"), ("least sensitivity", "s")):
        rows = [row for row in results["pareto"] if row["design"] == design]
        if not rows:  # a quick run has none of one kind
            continue
        time = [times * row["time_s"] for row in rows]
        axes[0, 0].plot(time, [row["peak_N"] for row in rows], marker=marker, label=design)
        axes[0, 1].plot(time, [count * row["sensitivity_m"] for row in rows], marker=marker, label=design)
    limit = results["wanted"]["thrust_limit_N"]
    axes[0, 0].axhline(limit, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)), label=f"limit {limit:.4g} N")
    axes[0, 0].set_ylabel("peak thrust [N]")
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 1].set_ylabel(f"error left, root mean square [{unit}]")
    axes[0, 1].set_ylim(0, 1.15 * axes[0, 1].dataLim.y1)
    for ax in axes[0]:
        ax.set_xlabel(f"table at rest after [{of_time}]")
        ax.legend(loc="lower left")
    return figure


def _certificate(whole: Results) -> Drawing:
    certificate = whole["results"]["certificate"]
    figure, axes = style.subplots(1, 2, 58)
    count, unit = length_unit(max(certificate["response_m"]))
    ratio = 100 * np.array(certificate["ratio"])
    axes[0, 0].loglog(
        ratio, certificate["bound_N"], color=style.LIMIT, linestyle=(0, (4, 2)), label="bound: width × $T_{fc}$"
    )
    axes[0, 0].loglog(ratio, certificate["force_N"], marker="o", label=f"order {certificate['order_force']:.2f}")
    axes[0, 1].loglog(
        ratio,
        count * np.array(certificate["response_m"]),
        marker="o",
        label=f"order {certificate['order_response']:.2f}",
    )
    axes[0, 0].set_ylabel("force [N]")
    axes[0, 1].set_ylabel(f"position [{unit}]")
    for ax in axes[0]:
        ax.set_xlabel("smoothing width over the element's limit [%]")
        ax.legend()
    return figure


def _failed(whole: Results) -> Drawing:
    failed, wanted = whole["results"]["failed"], whole["results"]["wanted"]
    figure, axes = style.subplots(1, 2, 52)
    (count, unit), (times, of_time) = _units_of(wanted["stroke_m"], failed["step_s"])
    time = times * np.array(failed["step_s"])
    axes[0, 0].plot(time, count * np.array(failed["position_m"]), label="iterate")
    axes[0, 0].axhline(count * wanted["stroke_m"], color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes[0, 1].step(time, failed["thrust_N"], where="post")
    limit = wanted["thrust_limit_N"]
    style.mark_limit(axes[0, 1], limit, f"{limit:.4g} N")
    style.mark_limit(axes[0, 1], -limit, f"−{limit:.4g} N")
    axes[0, 0].set_ylabel(f"$x_T^*$ [{unit}]")
    axes[0, 1].set_ylabel("thrust [N]")
    for ax in axes[0]:
        ax.set_xlabel(f"time from the step [{of_time}]")
    return figure
