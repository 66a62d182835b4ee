"""The report of the trade-off between friction suppression and stability: its figures and captions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import LogLocator

from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from reports.units import length_unit, time_unit
from studies.wording import filters

Results = Mapping[str, Any]
PLAIN_POWER = 2
"""Powers of ten up to this one, and down to its inverse, are written out: 117 for 1.17 times 100."""
LOOPS = {"P_l": "$P_l$", "P_e1": "$P_{e1}$", "P_e2": "$P_{e2}$", "steepest": "steepest"}


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    rows = ("results.front", "results.present", "results.rules", "results.chosen", "results.limits")
    figures = [
        Figure("front", FRONT, (*rows, "machine.specification"), _front),
        Figure("reversal", REVERSAL, ("results.reversal", "machine.specification"), _reversal),
        Figure("gains", GAINS, rows, _gains),
        Figure("limits", LIMITS, ("results.limits", "results.front", "results.present"), _limits),
        Figure("bode", BODE, ("results.loops",), _bode),
        Figure("nyquist", NYQUIST, ("results.loops", "results.chosen"), _nyquist),
        Figure("sensitivities", SENSITIVITIES, ("results.loops", "results.wanted", "results.chosen"), _sensitivities),
        Figure("between", INTERSAMPLE_CAPTION, ("results.between",), _between),
    ]
    if whole["results"]["ensemble"]:
        keys = ("results.ensemble", "machine.specification")
        figures.append(Figure("ensemble", ENSEMBLE, keys, _ensemble))
    title = f"Friction suppression against stability: {whole['machine']['name']}"
    extra: dict[str, Callable[..., Any]] = {"gain": _gain, "number": _number, "ratio": _ratio}
    question = "How much friction suppression does the stability margin allow, and is feedback alone enough?"
    return Report(title, question, Path(__file__).parent / "report.md", tuple(figures), {**filters(), **extra}, TABLES)


TABLES = {
    "beside": ("results.present", "results.chosen", "results.enough", "results.fastest", "results.compensated"),
    "ensemble": ("results.ensemble",),
    "front": ("results.front",),
    "settling": ("results.settling",),
    "costs": ("results.costs",),
    "checks": ("checks",),
    "published": ("results.published",),
    "attempts": ("results.attempts",),
    "parameters": ("parameters",),
}
FRONT = Markdown(
    "Settling of the reversal without friction compensation, on the nonsmooth machine, against the largest $|S|$ over "
    "the family: the tuned PIDs, the present one and two rules of thumb. A point on the upper edge never settles "
    "before the next motion."
)
REVERSAL = "Position error of the reversal without friction compensation with three PIDs."
GAINS = Markdown("Integral gain and crossover frequency on $P_l$ over the largest $|S|$ of the family.")
LIMITS = Markdown(
    "Limits of every PID. Left: the crossover on $P_l$ and the highest one that the dead time allows any PID. Right: "
    "the area below 0 of $\\ln|S|$ and the area that Bode's integral allows any controller with the same bounds."
)
BODE = Markdown(
    "Open loop $L$ with the chosen PID, on the plants as they are known; thin: with the present PID on $P_l$."
)
NYQUIST = Markdown(
    "Open loop of every plant of the family with the chosen PID, and the circle that $|S|$'s bound keeps clear."
)
SENSITIVITIES = Markdown(
    "Sensitivities with the chosen PID, on the plants as they are known, with their bounds; thin: the present PID on "
    "$P_l$; grey dots: lower bound on $|S|$ on $P_l$ for every controller with the same noise."
)
ENSEMBLE = Markdown(
    "Every member of the ensemble: settling of its reversal without friction compensation against the largest $|S|$ of "
    "its plants, with the same PID for all, and with the PID that each was chosen with (its own)."
)
INTERSAMPLE_CAPTION = "Position after a step of friction of the reversal's size, chosen PID, between the samples too."


def _gain(number: float | None) -> str:
    """A gain; with its power of ten, as mathematics, where that is of three digits or more."""
    if not number:
        return "–" if number is None else "0"
    power = math.floor(math.log10(abs(number)))
    if abs(power) <= PLAIN_POWER:
        return f"{number:#.3g}".rstrip(".")
    return Markdown("$") + f"{number / 10**power:.2f}" + Markdown("\\cdot 10^{") + str(power) + Markdown("}$")


def _number(number: float | None, digits: int = 3) -> str:
    return "–" if number is None else f"{number:.{digits}g}"


def _ratio(number: float | None) -> str:
    return "–" if number is None else f"{number:.2f}"


def _column(rows: Any, key: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    return _numbers([row[key] for row in rows])


def _series(results: Results) -> list[tuple[str, list[Any], dict[str, Any]]]:
    """Rows of each kind of PID with its look."""
    rules = results["rules"]
    return [
        ("tuned", results["front"], {"color": style.BLUE, "marker": "o", "linestyle": "-"}),
        ("SIMC", [r for r in rules if r["name"] == "SIMC"], {"color": style.GREEN, "marker": "s", "linestyle": "--"}),
        (
            "lambda",
            [r for r in rules if r["name"] == "lambda"],
            {"color": style.PURPLE, "marker": "^", "linestyle": ":"},
        ),
        (
            "present",
            [results["present"]],
            {"color": style.VERMILION, "marker": "D", "linestyle": "none", "markersize": 7},
        ),
    ]


def _ends(results: Results) -> tuple[float, float]:
    """The least and the largest M_s [1] of the figures over it: those of the front and of the present PID fit in."""
    levels = results["limits"]["ms"]
    return levels[0], levels[-1]


def _front(whole: Results) -> Drawing:
    results, spec = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 1, 54)
    ax = axes[0, 0]
    top = 1e3 * spec["interval_s"]
    fastest = 1e3 * spec["settling_time_s"]
    for label, rows, look in _series(results):
        settling = 1e3 * _column(rows, "settling_s")
        fastest = float(np.nanmin([fastest, *settling]))
        ax.semilogy(_column(rows, "ms"), np.where(np.isnan(settling), top, settling), label=label, **look)
    style.mark_limit(ax, 1e3 * spec["settling_time_s"], f"required,\n{1e3 * spec['settling_time_s']:g} ms")
    bound = results["chosen"]["bound"]
    style.mark_limit(ax, bound, f"chosen, $M_s \\leq$ {bound:g}", axis="x")
    ax.set_xlim(*_ends(results))
    ax.set_ylim(0.6 * fastest, top * 1.1)
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.set_xlabel("largest $|S|$ over the family, $M_s$")
    ax.set_ylabel("settling of the reversal [ms]")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.02), ncols=4)  # the curves go through every corner
    return figure


def _reversal(whole: Results) -> Drawing:
    reversal, spec = whole["results"]["reversal"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 1, 60)
    ax = axes[0, 0]
    largest = max(float(np.max(np.abs(curve["error_m"]))) for curve in reversal["curves"])
    end = 10 * spec["tolerance_m"]
    long = largest > 10 * end  # of a long stroke only the end tells the curves apart
    count, unit = length_unit(end if long else largest)
    style.tolerance_band(ax, 0.0, count * spec["tolerance_m"], "tolerance")
    in_time = 1e3 * spec["settling_time_s"]
    style.mark_limit(ax, in_time, f"{in_time:g} ms", axis="x", end="bottom")
    for curve in reversal["curves"]:
        label = f"{'present' if curve['name'] == 'present' else 'tuned'}, $M_s$ = {curve['ms']:.3g}"
        ax.plot(1e3 * np.array(reversal["time_s"]), count * np.array(curve["error_m"]), label=label)
    if long:
        ax.set_ylim(-count * end, 0.5 * count * end)
    ax.set_xlim(0, 1e3 * reversal["time_s"][-1])
    ax.set_xlabel("time from the step [ms]")
    ax.set_ylabel(f"$x_T - r$ [{unit}]")
    ax.legend(loc="lower right")
    return figure


def _gains(whole: Results) -> Drawing:
    results = whole["results"]
    figure, axes = style.subplots(1, 2, 62)
    for label, rows, look in _series(results):
        axes[0, 0].semilogy(_column(rows, "ms"), _column(rows, "ki_N_per_ms"), label=label, **look)
        axes[0, 1].plot(_column(rows, "ms"), _column(rows, "crossover_Hz"), **look)
    axes[0, 0].set_ylabel("integral gain [N/(m s)]")
    axes[0, 1].set_ylabel("crossover on $P_l$ [Hz]")
    axes[0, 1].set_ylim(bottom=0)
    for ax in axes[0]:
        ax.set_xlim(*_ends(results))
        ax.set_xlabel("$M_s$")
    axes[0, 0].legend(loc="lower right")
    return figure


def _limits(whole: Results) -> Drawing:
    results = whole["results"]
    limits, front, present = results["limits"], results["front"], results["present"]
    figure, axes = style.subplots(1, 2, 68)
    left, right = axes[0]
    left.plot(limits["ms"], limits["crossover_Hz"], color=style.LIMIT, linestyle="-", label="dead time: no PID above")
    left.plot(
        limits["front_ms"], _column(front, "crossover_Hz"), color=style.BLUE, linestyle="-", marker="o", label="tuned"
    )
    left.plot(
        present["ms"], present["crossover_Hz"], color=style.VERMILION, marker="D", linestyle="none", label="present"
    )
    for frequency in limits["modes_Hz"]:
        left.axhline(frequency, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
        words: dict[str, Any] = {"fontsize": 7, "va": "top", "ha": "right", "textcoords": "offset points"}
        words |= {"xycoords": left.get_yaxis_transform()}
        left.annotate(f"mode at {frequency:.3g} Hz", (0.99, frequency), xytext=(0, -2), **words)
    left.set_ylabel("crossover [Hz]")
    left.set_ylim(bottom=0)
    right.plot(
        limits["front_ms"], limits["allowed_Hz"], color=style.LIMIT, linestyle="-", label="Bode: no controller above"
    )
    right.plot(limits["front_ms"], limits["suppressed_Hz"], color=style.BLUE, linestyle="-", marker="o", label="tuned")
    right.plot(
        present["ms"],
        limits["present_suppressed_Hz"],
        color=style.VERMILION,
        marker="D",
        linestyle="none",
        label="present",
    )
    right.set_ylabel("area of ln|S| below 0 [Hz]")
    right.set_ylim(bottom=0)
    for ax in axes[0]:
        ax.set_xlim(*_ends(results))
        ax.set_xlabel("$M_s$")
        ax.legend(loc="upper left")
    left.set_ylim(top=1.25 * max(limits["crossover_Hz"]))
    right.set_ylim(top=1.25 * max(limits["allowed_Hz"]))
    return figure


def _bode(whole: Results) -> Drawing:
    loops = whole["results"]["loops"]
    figure, axes = style.subplots(2, 1, 90, sharex=True)
    frequency = loops["frequency_Hz"]
    for name, label in LOOPS.items():
        axes[0, 0].loglog(frequency, loops["chosen"][name]["l"], label=label)
        axes[1, 0].semilogx(frequency, loops["chosen"][name]["phase_deg"])
    axes[0, 0].loglog(
        frequency, loops["present"]["P_l"]["l"], color="#777777", linestyle="-", linewidth=0.7, label="present"
    )
    axes[1, 0].semilogx(frequency, loops["present"]["P_l"]["phase_deg"], color="#777777", linestyle="-", linewidth=0.7)
    style.mark_limit(axes[0, 0], 1.0, "|L| = 1")
    style.mark_limit(axes[1, 0], -180.0, "−180°")
    axes[0, 0].set_ylabel("|L|")
    axes[0, 0].set_ylim(1e-2, 1e3)
    axes[1, 0].set_ylim(-540, 90)
    axes[1, 0].set_yticks(range(-540, 91, 90))
    axes[1, 0].set_ylabel("phase of L [deg]")
    axes[1, 0].set_xlabel("frequency [Hz]")
    axes[0, 0].legend(loc="upper right", ncols=2)
    return figure


def _nyquist(whole: Results) -> Drawing:
    loops, ms = whole["results"]["loops"], whole["results"]["chosen"]["bound"]
    figure, axes = style.subplots(1, 1, 92)
    ax = axes[0, 0]
    for i, loop in enumerate(loops["nyquist"]):
        label = f"{len(loops['nyquist'])} plants" if i == 0 else None
        ax.plot(loop["real"], loop["imaginary"], color=style.BLUE, linestyle="-", linewidth=0.6, label=label)
    angle = np.linspace(0, 2 * np.pi, 200)
    ax.fill(
        -1 + np.cos(angle) / ms, np.sin(angle) / ms, facecolor="#e4e4e4", edgecolor=style.LIMIT, linewidth=0.9,
        label=f"$|S| >$ {ms:g}", zorder=0.8,
    )  # fmt: skip
    ax.plot(-1, 0, color=style.BLACK, marker="+", markersize=9, linestyle="none")
    ax.set_aspect("equal")
    ax.set_xlim(-3.6, 1.6)
    ax.set_ylim(-2.1, 1.3)
    ax.set_xlabel("Re L")
    ax.set_ylabel("Im L")
    ax.legend(loc="upper right")
    return figure


def _sensitivities(whole: Results) -> Drawing:
    results = whole["results"]
    loops, wanted, chosen = results["loops"], results["wanted"], results["chosen"]
    figure, axes = style.subplots(2, 2, 110, sharex=True)
    frequency = loops["frequency_Hz"]
    places = (("s", "|S|"), ("t", "|T|"), ("ps_m_per_N", "|PS| [m/N]"), ("cs_N_per_m", "|CS| [N/m]"))
    for (key, label), ax in zip(places, axes.ravel(), strict=True):
        for name, text in LOOPS.items():
            ax.loglog(frequency, loops["chosen"][name][key], label=text, linewidth=1.1)
        ax.loglog(
            frequency, loops["present"]["P_l"][key], color="#777777", linestyle="-", linewidth=0.7, label="present"
        )
        ax.set_ylabel(label)
    least = np.array(loops["least_s"])
    axes[0, 0].loglog(
        frequency, np.where(least > 1e-2, least, np.nan), color="#777777", linestyle=(0, (1, 1.2)), linewidth=1.3,
        label="lower bound",
    )  # fmt: skip
    for ax, limit in (
        (axes[0, 0], chosen["bound"]),
        (axes[0, 1], max(chosen["mt"], chosen["ms"])),
        (axes[1, 1], wanted["mcs_N_per_m"]),
    ):
        ax.axhline(limit, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes[0, 0].set_ylim(1e-2, 5)
    axes[0, 1].set_ylim(1e-2, 5)
    for ax in axes[1]:
        ax.set_xlabel("frequency [Hz]")
    axes[0, 0].legend(loc="lower right", fontsize=6.5)
    return figure


def _between(whole: Results) -> Drawing:
    between = whole["results"]["between"]
    figure, axes = style.subplots(1, 2, 56)
    largest = max(float(np.max(np.abs(between[name]["path_m"]))) for name in ("P_l", "steepest"))
    (count, unit), (times, of_time) = length_unit(largest), time_unit(between["time_s"][-1])
    time = times * np.array(between["time_s"])
    for ax, name in ((axes[0, 0], "P_l"), (axes[0, 1], "steepest")):
        path, samples = between[name]["path_m"], between[name]["samples_m"]
        ax.plot(time, count * np.array(path), linestyle="-", linewidth=0.9, label="ten points a sample")
        spacing = len(path) // len(samples)
        look: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.2, "color": style.VERMILION}
        ax.plot(time[::spacing], count * np.array(samples), label="at the samples", **look)
        ax.set_title(LOOPS[name])
        ax.set_xlabel(f"time [{of_time}]")
        ax.set_xlim(0, time[-1])
    axes[0, 0].set_ylabel(f"position [{unit}]")
    axes[0, 1].legend(loc="upper right")
    return figure


def _ensemble(whole: Results) -> Drawing:
    ensemble, spec = whole["results"]["ensemble"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 1, 62)
    ax = axes[0, 0]
    looks = {
        "own": (style.SKY, "s"),
        "present": (style.VERMILION, "D"),
        "chosen": (style.BLUE, "o"),
        "all members": (style.GREEN, "^"),
    }
    for row in sorted(ensemble["rows"], key=lambda one: list(looks).index(one["name"])):
        color, marker = looks[row["name"]]
        label = "tuned for all" if row["name"] == "all members" else row["name"]
        look: dict[str, Any] = {"color": color, "marker": marker, "linestyle": "none", "markersize": 3.5}
        ax.plot(_numbers(row["ms"]), 1e3 * _numbers(row["settling_s"]), label=label, **look)
    style.mark_limit(ax, 1e3 * spec["settling_time_s"], f"required, {1e3 * spec['settling_time_s']:g} ms")
    style.mark_limit(ax, ensemble["ms_bound"], f"bound {ensemble['ms_bound']:g}", axis="x")
    ax.set_ylim(0, 1.35 * ax.get_ylim()[1])
    ax.set_xlabel("largest $|S|$ over the member's plants")
    ax.set_ylabel("settling of the reversal [ms]")
    ax.legend(loc="lower right", ncols=2)
    return figure


def _numbers(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([np.nan if value is None else value for value in values], float)
