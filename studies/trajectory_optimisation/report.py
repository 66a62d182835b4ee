"""The report of the trajectory optimisation: its figures and captions (report.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from models.quantity import show
from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from studies.wording import filters

Results = Mapping[str, Any]

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
    own: dict[str, Callable[..., Any]] = {
        "show": _show,
        "share": _share,
        "micro": _micro,
        "milli": _milli,
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


def _micro(length: float | None) -> str:
    return "never" if length is None else f"{1e6 * length:.2f}"


def _milli(time: float | None) -> str:
    return "never" if time is None else f"{1e3 * time:.1f}"


def _dispersion(whole: Results) -> Drawing:
    figure, axes = style.subplots(1, 1, 72)
    ax = axes[0, 0]
    for key, label in LABELS.items():
        values = 1e6 * np.array(whole["results"]["shown"][key]["dispersions_m"])
        ax.step(values, np.arange(1, values.size + 1) / values.size * 100, where="post", label=label)
    ax.set_xlabel("3σ after the specified settling time [µm]")
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
    time = 1e3 * np.array(results["shown_time_s"])
    for key, label in LABELS.items():
        ax.semilogy(time, 1e6 * np.array(results["shown"][key]["error_m"]), label=label)
    fine, coarse = 1e6 * results["wanted"]["tolerance_m"], 1e6 * specification["tolerance_m"]
    ax.axhspan(1e-2, fine, facecolor="#e4e4e4", edgecolor="none", zorder=0.5)
    style.mark_limit(ax, fine, f"±{fine:g} µm")
    style.mark_limit(ax, coarse, f"±{coarse:g} µm")
    style.mark_limit(
        ax, 1e3 * results["wanted"]["settling_time_s"], f"{1e3 * results['wanted']['settling_time_s']:g} ms", "x"
    )
    style.mark_limit(ax, 1e3 * specification["settling_time_s"], f"{1e3 * specification['settling_time_s']:g} ms", "x")
    ax.set_xlim(0, time[-1])
    ax.set_ylim(0.05, 60)
    ax.set_xlabel("time from the step [ms]")
    ax.set_ylabel("largest error [µm]")
    # Above the axes it hides neither curves nor the labels of the two times.
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.02), ncols=3)
    return figure


def _responses(whole: Results) -> Drawing:
    results, specification = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 3, 62, sharey=True)
    time = 1e3 * np.array(results["shown_time_s"])
    stroke = 1e6 * results["wanted"]["stroke_m"]
    for ax, key in zip(axes[0], ("paper", "common", "aware"), strict=True):
        style.tolerance_band(ax, stroke, 1e6 * specification["tolerance_m"], "tolerance")
        every = 1e6 * np.array(results["shown"][key]["position_m"])
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
        style.mark_limit(ax, 1e3 * results["wanted"]["settling_time_s"], "", "x")
        ax.set_title(LABELS[key])
        ax.set_xlabel("time from the step [ms]")
        ax.set_xlim(0, 40)
    axes[0, 0].set_ylabel("distance travelled [µm]")
    axes[0, 2].legend(loc="lower right")
    return figure


def _trajectories(whole: Results) -> Drawing:
    results = whole["results"]
    figure, axes = style.subplots(2, 1, 95, sharex=True)
    for key, colour in zip(("deadbeat", "common", "peak", "aware"), style.COLOURS, strict=False):
        design = results["designs"][key]
        time = 1e3 * np.array(design["time_s"])
        label = "deadbeat" if key == "deadbeat" else LABELS[key]
        (line,) = axes[0, 0].plot(time, 1e6 * np.array(design["position_m"]), color=colour, label=label)
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
    axes[0, 0].axhline(1e6 * results["wanted"]["stroke_m"], color=style.LIMIT, linewidth=0.7, linestyle=(0, (4, 2)))
    axes[0, 0].set_ylabel("$x_T^*$ [µm]")
    axes[0, 0].legend(loc="lower right")
    axes[1, 0].set_ylabel("thrust [N]")
    axes[1, 0].set_xlabel("time from the step [ms]")
    return figure


def _pareto(whole: Results) -> Drawing:
    results = whole["results"]
    figure, axes = style.subplots(1, 2, 65)
    tried = [one for one in results["shortest"]["tried"] if one["peak_N"] <= 2 * results["wanted"]["rated_N"]]
    axes[0, 0].plot(
        [1e3 * one["time_s"] for one in tried],
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
        time = [1e3 * row["time_s"] for row in rows]
        axes[0, 0].plot(time, [row["peak_N"] for row in rows], marker=marker, label=design)
        axes[0, 1].plot(time, [1e6 * row["sensitivity_m"] for row in rows], marker=marker, label=design)
    limit = results["wanted"]["thrust_limit_N"]
    axes[0, 0].axhline(limit, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)), label=f"limit {limit:.4g} N")
    axes[0, 0].set_ylabel("peak thrust [N]")
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 1].set_ylabel("error left, root mean square [µm]")
    axes[0, 1].set_ylim(0, 1.15 * axes[0, 1].dataLim.y1)
    for ax in axes[0]:
        ax.set_xlabel("table at rest after [ms]")
        ax.legend(loc="lower left")
    return figure


def _certificate(whole: Results) -> Drawing:
    certificate = whole["results"]["certificate"]
    figure, axes = style.subplots(1, 2, 58)
    ratio = 100 * np.array(certificate["ratio"])
    axes[0, 0].loglog(
        ratio, certificate["bound_N"], color=style.LIMIT, linestyle=(0, (4, 2)), label="bound: width × $T_{fc}$"
    )
    axes[0, 0].loglog(ratio, certificate["force_N"], marker="o", label=f"order {certificate['order_force']:.2f}")
    axes[0, 1].loglog(
        ratio, 1e6 * np.array(certificate["response_m"]), marker="o", label=f"order {certificate['order_response']:.2f}"
    )
    axes[0, 0].set_ylabel("force [N]")
    axes[0, 1].set_ylabel("position [µm]")
    for ax in axes[0]:
        ax.set_xlabel("smoothing width over the element's limit [%]")
        ax.legend()
    return figure


def _failed(whole: Results) -> Drawing:
    failed, wanted = whole["results"]["failed"], whole["results"]["wanted"]
    figure, axes = style.subplots(1, 2, 52)
    time = 1e3 * np.array(failed["step_s"])
    axes[0, 0].plot(time, 1e6 * np.array(failed["position_m"]), label="iterate")
    axes[0, 0].axhline(1e6 * wanted["stroke_m"], color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes[0, 1].step(time, failed["thrust_N"], where="post")
    limit = wanted["thrust_limit_N"]
    style.mark_limit(axes[0, 1], limit, f"{limit:.4g} N")
    style.mark_limit(axes[0, 1], -limit, f"−{limit:.4g} N")
    axes[0, 0].set_ylabel("$x_T^*$ [µm]")
    axes[0, 1].set_ylabel("thrust [N]")
    for ax in axes[0]:
        ax.set_xlabel("time from the step [ms]")
    return figure
