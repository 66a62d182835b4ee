"""The report of the deadbeat design: its figures and captions (report.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from models.quantity import show
from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from reports.units import length_unit, time_unit
from studies import as_known
from studies.diagrams import loop_figure
from studies.wording import filters

MOST_TURNS_SHOWN: Final = 10  # of the phase in the Bode diagram

Results = Mapping[str, Any]


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    results = whole["results"]
    figures = [
        Figure("bode", BODE, ("results.bode",), _bode),
        loop_figure("results.friction.rfm.limit_m"),
        Figure(
            "feedforward",
            FEEDFORWARD + (ROBUST if results["sensitivity"]["modes"] else "."),
            ("results.deadbeat", "results.robust", "results.wanted", "results.sensitivity"),
            _feedforward,
        ),
        Figure("trade_off", TRADE_OFF, ("results.trade_off", "results.wanted"), _trade_off),
        Figure(
            "sensitivity", SENSITIVITY, ("results.sensitivity", "results.wanted", "machine.specification"), _sensitivity
        ),
        Figure("branch", _branch_caption(results), ("results.friction", "machine.presliding"), _branch),
        Figure(
            "responses",
            RESPONSES + _compare(results, "Figs. 7, 12 and 14") + ".",
            ("results.without", "results.with", "machine.specification"),
            _responses,
        ),
        Figure("dispersion", DISPERSION, (*_DISPERSION_KEYS, "machine.specification"), _dispersion),
        Figure(
            "lissajous",
            LISSAJOUS.format(compare=_compare(results, "Fig. 8")),
            ("results.without", "results.friction", "machine.presliding"),
            _lissajous,
        ),
    ]
    if "compensator_elements" in results:
        keys = ("results.compensator_elements", "machine.specification")
        figures.insert(6, Figure("elements", ELEMENTS, keys, _elements))
    if not results["sensitivity"]["modes"]:  # a rigid axis
        figures = [figure for figure in figures if figure.name != "sensitivity"]
    title = f"Deadbeat feedforward for {show(results['wanted']['stroke_m'], 'm')} motions: {whole['machine']['name']}"
    absent = {name for name in ("effects", "starts") if not results.get(name)}
    absent |= set() if results.get("remedies", {}).get("rows") else {"remedies"}
    absent |= set() if results["long_moves"]["rows"] else {"moves", "steps"}
    tables = {name: keys for name, keys in TABLES.items() if name not in absent}
    question = (
        "Which deadbeat feedforward suits this machine, and does it meet the specification on the nonsmooth machine?"
    )
    words = filters() | as_known.filters() | {"within": _within}
    return Report(title, question, Path(__file__).parent / "report.md", tuple(figures), words, tables)


def _within(time: float | None, watched: float) -> str:
    """The time [s] in which a move settles, or how long it was watched [s] without."""
    return f"not within {show(watched, 's')}" if time is None or math.isinf(time) else show(time, "s", 3)


TABLES = {
    "settling": ("results.settling",),
    "motions": ("results.without.motions", "results.with.motions", "machine.specification"),
    "as_known": ("results.as_known",),
    "remedies": ("results.remedies", "results.as_known", "results.with.motions"),
    "starts": ("results.starts", "machine.specification"),
    "moves": ("results.long_moves", "machine.specification"),
    "steps": ("results.long_moves", "machine.drive"),
    "effects": ("results.effects", "machine.specification"),
    "paper": ("results.paper",),
    "checks": ("checks",),
    "reproduction": ("results.paper",),
    "parameters": ("parameters",),
}
BODE = Markdown(
    "The plant $P_l$ and its equivalents $P_{e1}$, $P_{e2}$ in the presliding region, where the friction acts as a "
    "spring; dead time included."
)
FEEDFORWARD = Markdown("Trajectory reference $x_T^*$ and feedforward thrust $u_{ff}$ of the design that is written")
ROBUST = ", and of the one whose free parameters are used for robustness against wrong mode frequencies."
TRADE_OFF = Markdown(
    "Least peak of $|u_{ff}|$ against the settling time of $x_T^*$: a lower bound for every deadbeat of this stroke. "
    "Times from half of the specified one to its double are tried; where a curve has no point among them, that shape "
    "cannot reach the settling time at all."
)
SENSITIVITY = (
    "Largest deviation of the linear plant from the target after the settling time, feedforward alone, when one mode's "
    "frequency is off."
)
BRANCH = "Increase of force after a reversal from full slip"
ELEMENTS = (
    "What the design achieves on the nonsmooth machine with each number of elements of the friction compensator: time "
    "until the slowest motion has settled (triangles: it never does), and worst dispersion after the specified time. "
    "Filled: the specification is met; circled: the chosen number; dotted: across numbers that were not tried."
)
RESPONSES = (
    "Positive motions on the nonsmooth machine, without friction compensation (left) and with the controller that is "
    "written (right): distance travelled and rolling friction"
)
DISPERSION = "Dispersion of the positive motions over time: three standard deviations of the position."
LISSAJOUS = (
    "Rolling friction against position over the positive motions without compensation{compare}; vertical lines are "
    "the targets."
)
_DISPERSION_KEYS = tuple(
    f"results.{case}.{key}" for case in ("without", "with") for key in ("time_s", "dispersion_m", "worst_dispersion_m")
)


def _compare(results: Results, figures: str) -> str:
    """A reference to figures of the paper, in a report about the paper's machine; nothing in one about another."""
    return f" (compare {figures} of the paper)" if results["paper"] else ""


def _branch_caption(results: Results) -> str:
    """What the figure of the branch shows: the slopes are drawn only where the file has two of them."""
    slopes = (
        ", with the machine file's slopes of Region 1 and Region 2" if results["friction"]["slope_2_N_per_m"] else ""
    )
    return BRANCH + _compare(results, "Fig. 3b") + slopes + "."


def _bode(whole: Results) -> Drawing:
    bode = whole["results"]["bode"]
    figure, axes = style.subplots(2, 1, 85, sharex=True)
    labels = {"P_l": "$P_l$", "P_e1": "$P_{e1}$", "P_e2": "$P_{e2}$"}
    for name, label in labels.items():
        slope = bode[name]["stiffness_N_per_m"]
        rolling = "(rolling)" if name == "P_l" else "= $P_l$"  # a friction that is fully developed has no stiffness
        text = f"{label} ($K_e$ = {show(slope, 'N/m')})" if slope else f"{label} {rolling}"
        axes[0, 0].loglog(bode["frequency_Hz"], bode[name]["magnitude_m_per_N"], label=text)
        axes[1, 0].semilogx(bode["frequency_Hz"], bode[name]["phase_deg"])
    axes[0, 0].set_ylabel("magnitude [m/N]")
    axes[0, 0].legend()
    axes[1, 0].set_ylabel("phase [deg]")
    lowest = min(min(bode[name]["phase_deg"]) for name in labels)
    turns = min(max(math.ceil(-lowest / 360), 2), MOST_TURNS_SHOWN)  # a long dead time goes round and round
    axes[1, 0].set_ylim(-360 * turns, 0)
    axes[1, 0].set_yticks(range(-360 * turns, 1, 180 * math.ceil(turns / 3)))
    axes[1, 0].set_xlabel("frequency [Hz]")
    return figure


def _feedforward(whole: Results) -> Drawing:
    results = whole["results"]
    plain, robust, wanted = results["deadbeat"], results["robust"], results["wanted"]
    figure, axes = style.subplots(2, 1, 80, sharex=True)
    time = 1e3 * np.array(plain["time_s"])
    count, unit = length_unit(wanted["stroke_m"])
    designs = [(plain, wanted["objective_meaning"]), (robust, "robust against wrong mode frequencies")]
    if not results["sensitivity"]["modes"]:  # a rigid axis has none that could be wrong
        del designs[1]
    for design, label in designs:
        axes[0, 0].plot(time, count * np.array(design["position_m"]), label=label)
        axes[1, 0].step(time, [*design["thrust_N"], 0.0], where="post")
    axes[0, 0].axhline(count * wanted["stroke_m"], color=style.LIMIT, linewidth=0.7, linestyle=(0, (4, 2)))
    axes[0, 0].set_ylabel(f"$x_T^*$ [{unit}]")
    axes[0, 0].legend(loc="lower right")
    limit = wanted["thrust_limit_N"]
    style.mark_limit(axes[1, 0], limit, f"{limit:.4g} N")
    style.mark_limit(axes[1, 0], -limit, f"−{limit:.4g} N")
    axes[1, 0].set_ylabel("$u_{ff}$ [N]")
    axes[1, 0].set_xlabel("time [ms]")
    return figure


def _trade_off(whole: Results) -> Drawing:
    trade, wanted = whole["results"]["trade_off"], whole["results"]["wanted"]
    figure, axes = style.subplots(1, 1, 58)
    ax = axes[0, 0]
    time = 1e3 * np.array(trade["settling_time_s"])
    # Where both shapes take the same thrust, the ring of one is seen round the dot of the other.
    looks: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("free_N", "$x_T^*$ free", {"marker": "o", "markersize": 3}),
        ("monotone_N", "$x_T^*$ monotone", {"marker": "s", "markersize": 5, "markerfacecolor": "none"}),
    )
    for key, label, look in looks:
        ax.semilogy(time, np.array(trade[key], dtype=float), label=label, **look)
    style.mark_limit(ax, trade["limit_N"], f"limit of $u_{{ff}}$\n{trade['limit_N']:.4g} N")
    style.mark_limit(ax, wanted["settling_time_s"] * 1e3, f"chosen, {wanted['settling_time_s'] * 1e3:g} ms", axis="x")
    ax.set_xlabel("settling time of $x_T^*$ [ms]")
    ax.set_ylabel("least peak thrust [N]")
    ax.legend(loc="lower left")  # the thrust falls with the time
    return figure


def _sensitivity(whole: Results) -> Drawing:
    sensitivity = whole["results"]["sensitivity"]
    tolerance = whole["machine"]["specification"]["tolerance_m"]
    figure, axes = style.subplots(1, len(sensitivity["modes"]), 50, sharey=True)
    error = 100 * np.array(sensitivity["error"])
    found = [max(mode[key]) for mode in sensitivity["modes"] for key in ("plain_m", "robust_m")]
    largest = max([*found, tolerance / 4])
    each, unit = length_unit(largest)
    for ax, mode in zip(axes[0], sensitivity["modes"], strict=False):
        ax.plot(error, each * np.array(mode["plain_m"]), label="chosen design")
        ax.plot(error, each * np.array(mode["robust_m"]), label="robust design")
        ax.set_title(f"mode at {mode['frequency_Hz']:.4g} Hz")
        ax.set_xlabel("error of its frequency [%]")
    last = axes[0, -1]
    if np.max([mode["plain_m"] for mode in sensitivity["modes"]], initial=0.0) > tolerance / 4:
        for ax in axes[0]:
            ax.axhline(each * tolerance, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
        last.annotate(
            "tolerance", (1, each * tolerance), xycoords=last.get_yaxis_transform(), fontsize=7, va="bottom", ha="right"
        )
    axes[0, 0].set_ylabel(f"largest deviation [{unit}]")
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 0].legend()
    return figure


def _branch(whole: Results) -> Drawing:
    friction, facts = whole["results"]["friction"], whole["machine"]["presliding"]
    figure, axes = style.subplots(1, 1, 62)
    ax = axes[0, 0]
    each, unit = length_unit(max(friction["distance_m"]))
    distance = each * np.array(friction["distance_m"])
    ax.plot(distance, friction["machine_N"], label=f"machine, N = {friction['elements']}")
    ax.plot(distance, friction["rfm_N"], label=f"RFM, N = {len(friction['rfm']['limit_m'])}")
    style.mark_limit(ax, 2 * facts["coulomb_force_N"], "$2 T_{fc}$")
    if friction["slope_2_N_per_m"]:  # else all elements slip within Region 1
        _regions(ax, facts, each)
    ax.set_xlabel(f"distance after the reversal [{unit}]")
    ax.set_ylabel("increase of force [N]")
    ax.legend(loc="lower right")
    return figure


def _elements(whole: Results) -> Drawing:
    counts, specification = whole["results"]["compensator_elements"], whole["machine"]["specification"]
    figure, axes = style.subplots(2, 1, 90, sharex=True)
    above, below = axes[:, 0]
    in_ms, ms = time_unit(specification["settling_time_s"])
    in_time = in_ms * specification["settling_time_s"]
    rows = counts["curve"]
    settling = [one["settling_s"] and in_ms * one["settling_s"] for one in rows]
    highest = 1.6 * max([in_time, *(time for time in settling if time is not None)])  # where "never" is drawn
    _tried(above, rows, [highest if time is None else time for time in settling], counts["chosen"])
    each, unit = length_unit(specification["tolerance_m"])
    _tried(below, rows, [each * one["dispersion_m"] for one in rows], counts["chosen"])
    style.mark_limit(above, in_time, f"specified\n{in_time:g} {ms}")
    tolerance = each * specification["tolerance_m"]
    style.mark_limit(below, tolerance, f"tolerance\n{tolerance:g} {unit}")
    above.set_ylabel(f"slowest settling [{ms}]")
    below.set_ylabel(f"worst 3σ [{unit}]")
    below.set_xlabel("elements of the friction compensator")
    _whole_numbers(below, [one["elements"] for one in rows], counts["chosen"])
    for ax in (above, below):
        ax.set_yscale("log")
        ax.margins(y=0.15)
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter(NullFormatter())
    above.legend(*_legend(rows), loc="upper right")
    return figure


def _tried(ax: Any, rows: list[Results], values: list[float], chosen: int) -> None:
    """One outcome over the numbers of elements, the chosen one circled."""
    numbers = [one["elements"] for one in rows]
    for i in range(1, len(numbers)):  # dotted across numbers that were not tried
        dashes = "-" if numbers[i] == numbers[i - 1] + 1 else (0, (1, 2))
        ax.plot(numbers[i - 1 : i + 1], values[i - 1 : i + 1], color=style.BLUE, linewidth=0.9, linestyle=dashes)
    for one, number, value in zip(rows, numbers, values, strict=True):
        ax.plot(number, value, **_marker(one), zorder=3)
    ax.plot(chosen, values[numbers.index(chosen)], "o", markersize=10, zorder=2.5, **_RING)


_RING: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": style.VERMILION, "markeredgewidth": 1.5}


def _marker(one: Results) -> dict[str, Any]:
    """How a trial looks: filled where it meets the specification, a triangle where a motion never settles."""
    face = style.BLUE if one["meets"] else "white"
    return {
        "marker": "o" if one["settling_s"] is not None else "^",
        "markersize": 3.5,
        "linestyle": "none",
        "markerfacecolor": face,
        "markeredgecolor": style.BLUE,
    }


def _legend(rows: list[Results]) -> tuple[list[Line2D], list[str]]:
    """A handle and a label for each kind of trial that there is, and for the chosen one."""
    kinds = {
        "never settles"
        if one["settling_s"] is None
        else "meets the specification"
        if one["meets"]
        else "misses it": one
        for one in rows
    }
    names = sorted(kinds, key=("meets the specification", "misses it", "never settles").index)
    ring = Line2D([], [], marker="o", markersize=8, linestyle="none", **_RING)
    return [*(Line2D([], [], **_marker(kinds[name])) for name in names), ring], [*names, "chosen"]


def _whole_numbers(ax: Any, numbers: list[int], chosen: int) -> None:
    """A logarithmic axis with ticks at numbers that were tried: the ends, the chosen one, and others as room allows."""
    ticks = {min(numbers), max(numbers), chosen}
    for number in sorted(numbers):
        apart = 1.11 if number < 10 else 1.2  # a label of two digits is wider
        if all(max(number, tick) >= apart * min(number, tick) for tick in ticks):
            ticks.add(number)
    ax.set_xscale("log")
    ax.set_xticks(sorted(ticks), [str(tick) for tick in sorted(ticks)])
    ax.set_xticks([], minor=True)


def _regions(ax: Any, facts: Results, each: float) -> None:
    """The slopes of Region 1 and Region 2, and where one ends and the other begins; each: of the axis' unit in 1 m."""
    corner = facts["boundary_m"] * facts["stiffness_1_N_per_m"]
    end = facts["boundary_m"] + (2 * facts["coulomb_force_N"] - corner) / facts["stiffness_2_N_per_m"]
    slopes = f"slopes {show(facts['stiffness_1_N_per_m'], 'N/m')} and {show(facts['stiffness_2_N_per_m'], 'N/m')}"
    ax.plot(
        each * np.array([0, facts["boundary_m"], end]),
        [0, corner, 2 * facts["coulomb_force_N"]],
        color=style.LIMIT,
        linestyle=(0, (1, 1)),
        label=slopes,
    )
    style.mark_limit(ax, each * facts["boundary_m"], "Region 1 | Region 2", axis="x")


def _positive(case: Results) -> list[Results]:
    return [motion for motion in case["motions"] if motion["target_m"] > motion["origin_m"]]


def _responses(whole: Results) -> Drawing:
    results, specification = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(2, 2, 100, sharex=True, sharey="row")
    stroke = max(abs(motion["target_m"] - motion["origin_m"]) for motion in results["with"]["motions"])
    count, unit = length_unit(stroke)
    for column, (key, title) in enumerate((("without", "without compensation"), ("with", "with compensation"))):
        case = results[key]
        time = 1e3 * np.array(case["time_s"])
        upper, lower = axes[0, column], axes[1, column]
        positive = _positive(case)
        style.tolerance_band(upper, count * stroke, count * specification["tolerance_m"], "tolerance")
        _mark_specified_time(upper, specification)
        for motion in reversed(positive):
            look: dict[str, Any] = (
                {"color": style.VERMILION, "linestyle": "-", "linewidth": 1.6, "zorder": 3, "label": "reversal"}
                if motion["reversal"]
                else {"color": style.SKY, "linestyle": "-", "linewidth": 0.9, "label": "inching"}
            )
            upper.plot(time, count * (np.array(motion["position_m"]) - motion["origin_m"]), **look)
            lower.plot(time, motion["friction_N"], **look)
        first = positive[0]
        reference = count * (np.array(first["reference_m"]) - first["origin_m"])
        upper.plot(time, reference, color=style.BLACK, linestyle=(0, (4, 2)), linewidth=0.9, label="$x_T^*$", zorder=4)
        upper.set_title(title)
        lower.set_xlabel("time from the step [ms]")
        handles = dict(zip(*reversed(upper.get_legend_handles_labels()), strict=True))
        upper.legend(handles.values(), handles.keys(), loc="lower right")
        upper.set_xlim(0, time[-1])
    axes[0, 0].set_ylabel(f"distance travelled [{unit}]")
    axes[1, 0].set_ylabel("rolling friction [N]")
    return figure


def _mark_specified_time(ax: Any, specification: Results) -> None:
    """The specified settling time, its label at the axis: the curves are above."""
    time = 1e3 * specification["settling_time_s"]
    style.mark_limit(ax, time, f"{time:g} ms", axis="x", end="bottom")


def _dispersion(whole: Results) -> Drawing:
    results, specification = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(1, 1, 50)
    ax = axes[0, 0]
    each, unit = length_unit(max(max(results[key]["dispersion_m"]) for key in ("without", "with")))
    for key, label in (("without", "without compensation"), ("with", "with compensation")):
        case = results[key]
        ax.plot(1e3 * np.array(case["time_s"]), each * np.array(case["dispersion_m"]), label=label)
    time = 1e3 * specification["settling_time_s"]
    style.mark_limit(ax, time, f"{time:g} ms", axis="x")
    ax.set_xlabel("time from the step [ms]")
    ax.set_ylabel(f"3σ [{unit}]")
    ax.set_ylim(bottom=0)
    ax.set_xlim(0, 1e3 * results["without"]["time_s"][-1])
    ax.legend()
    return figure


def _lissajous(whole: Results) -> Drawing:
    case, facts = whole["results"]["without"], whole["machine"]["presliding"]
    figure, axes = style.subplots(1, 1, 75)
    ax = axes[0, 0]
    positive = _positive(case)
    count, unit = length_unit(max(abs(motion["target_m"]) for motion in positive))
    for motion in positive:
        first = motion["reversal"]
        ax.plot(
            count * np.array(motion["position_m"]),
            motion["friction_N"],
            color=style.VERMILION if first else style.BLUE,
            linestyle="-",
            linewidth=1.6 if first else 1.0,
            label="reversal" if first else ("inching" if motion is positive[1] else None),
        )
        ax.axvline(count * motion["target_m"], color=style.LIMIT, linewidth=0.6, linestyle=(0, (4, 2)))
    slopes = (
        (positive[0], "stiffness_1_N_per_m", "$K_{e1}$", (0, (4, 1.5))),
        (positive[-1], "stiffness_2_N_per_m", "$K_{e2}$", (0, (1, 1))),
    )
    for motion, key, label, dashes in slopes if whole["results"]["friction"]["slope_2_N_per_m"] else ():
        x = np.array([motion["origin_m"], motion["target_m"]])
        middle = len(motion["friction_N"]) - 1
        y = motion["friction_N"][middle] + facts[key] * (x - motion["target_m"])
        ax.plot(
            count * x,
            y,
            color=style.BLACK,
            linestyle=dashes,
            linewidth=1.4,
            label=f"slope {label} = {show(facts[key], 'N/m')}",
        )
    ax.set_xlabel(f"table position [{unit}]")
    ax.set_ylabel("rolling friction [N]")
    ax.legend(loc="lower right")
    return figure
