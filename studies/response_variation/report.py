"""How the paper's evidence is told: its figures with the band of the set, and the words around them (report.md)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from models.quantity import show
from reports import style
from reports.report import Figure, Report
from studies.wording import filters

Results = Mapping[str, Any]
MICRO = 1e6


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    specification = "machine.specification"
    figures = (
        Figure("bode", BODE, ("results.bode",), _bode),
        Figure("hysteresis", HYSTERESIS, ("results.hysteresis", "machine.presliding"), _hysteresis),
        Figure("choice", CHOICE, ("results.choice",), _choice),
        Figure("inner", INNER, ("results.hysteresis",), _inner),
        Figure("reference", REFERENCE, ("results.reference",), _reference),
        Figure("variation", VARIATION, ("results.without", specification), _variation),
        Figure("lissajous", LISSAJOUS, ("results.without", "machine.presliding"), _lissajous),
        Figure(
            "compensated",
            COMPENSATED,
            ("results.without", "results.with", specification, "machine.published"),
            _compensated,
        ),
        Figure("set", SET, ("results.set",), _set),
        Figure("gap", GAP, ("results.gap", "machine.published"), _gap),
    )
    title = f"Response variation: {whole['machine']['name']}"
    question = "Does the model show what the paper shows, and which tables could the paper's be?"
    return Report(title, question, Path(__file__).parent / "report.md", figures, filters(), TABLES)


TABLES = {
    "paper": ("results.paper",),
    "ten": ("results.choice.ten",),
    "slopes": ("results.mechanism.central",),
    "exchange": ("results.mechanism",),
    "set": ("results.set",),
}
BODE = (
    "Plant and its equivalents in the presliding region; lines: the default table, shaded: the whole set. Fig. 2 "
    "of the paper shows the same three curves and reads from them that the table is an elastic body in micrometre"
    " motions."
)
HYSTERESIS = (
    "Hysteresis over ±150 µm (left) and the branch behind a reversal (right). Fig. 3 of the paper: presliding "
    "over about 100 µm, the steepest slope just behind the reversal, comprehensive slopes $K_{e1}$ and $K_{e2}$ "
    "with the boundary at about 20 µm; $N = 5$ keeps both slopes."
)
CHOICE = (
    "The paper's way to choose $N$: rms error of $N$ elements on a simulated, noisy measurement of a finer "
    "hysteresis, on the loops of the fit and on inner loops that it has not seen."
)
INNER = (
    "Inner loops. Fig. 4 of the paper: the curve depends on the history of the position, and $N = 10$ follows it well."
)
REFERENCE = "Target position. Fig. 5 of the paper: reversal and inching motions in sequence, 0.5 s apart."
VARIATION = (
    "Five positive motions without compensation; lines: the default table, shaded: the whole set. Figs. 7 and 12 "
    "of the paper: the reversal falls behind and needs 52 ms, inching does not; the friction differs in every "
    "motion and its steady value rises along the feed."
)
LISSAJOUS = (
    "Rolling friction against position, with the targets. Fig. 8 of the paper: the reversal meets about 800 N/mm,"
    " inching about 100 N/mm."
)
COMPENSATED = (
    "Responses with friction compensation, and the dispersion without and with it; shaded: the whole set. Fig. 14"
    " of the paper: the reversal settles within 25 ms, the dispersion falls from 4.8 µm to 2.4 µm, and the "
    "inching motions still miss ±2 µm."
)
SET = (
    "The tables that meet every published outcome, each a line, over the ranges searched (0 to 1, logarithmic; "
    "see [](#tbl:set)); thick: the default table, one of the central ones."
)
GAP = "Dispersion with compensation over the set, beside the 2.4 µm of the experiment: the gap that the model leaves."


def _bode(whole: Results) -> Drawing:
    bode = whole["results"]["bode"]
    figure, axes = style.subplots(2, 1, 85, sharex=True)
    labels = {"P_l": "$P_l$", "P_e1": "$P_{e1}$", "P_e2": "$P_{e2}$"}
    for (name, label), colour in zip(labels.items(), style.COLOURS, strict=False):
        curve = bode[name]
        slope = curve["stiffness_N_per_m"]
        text = f"{label} ($K_e$ = {show(slope, 'N/m')})" if slope else f"{label} (rolling)"
        low, high = curve["low_m_per_N"], curve["high_m_per_N"]
        axes[0, 0].fill_between(bode["frequency_Hz"], low, high, color=colour, alpha=0.2, linewidth=0)
        axes[0, 0].loglog(bode["frequency_Hz"], curve["magnitude_m_per_N"], label=text)
        axes[1, 0].semilogx(bode["frequency_Hz"], curve["phase_deg"])
    axes[0, 0].set_ylabel("magnitude [m/N]")
    axes[0, 0].legend()
    axes[1, 0].set_ylabel("phase [deg]")
    axes[1, 0].set_yticks(range(-360, 1, 90))
    axes[1, 0].set_xlabel("frequency [Hz]")
    return figure


def _hysteresis(whole: Results) -> Drawing:
    data, facts = whole["results"]["hysteresis"], whole["machine"]["presliding"]
    figure, axes = style.subplots(1, 2, 65)
    left, right = axes[0]
    x = MICRO * np.array(data["overview"]["position_m"])
    left.plot(x, data["overview"]["machine_N"], label=f"N = {data['elements']}")
    left.plot(x, data["overview"]["rfm_N"], label=f"N = {data['rfm_elements']}")
    left.set_xlabel("position [µm]")
    left.set_ylabel("friction [N]")
    left.legend(loc="upper left")
    distance = MICRO * np.array(data["branch"]["distance_m"])
    shown = distance <= 60
    right.plot(distance[shown], np.array(data["branch"]["machine_N"])[shown])
    right.plot(distance[shown], np.array(data["branch"]["rfm_N"])[shown])
    corner = facts["boundary_m"] * facts["stiffness_1_N_per_m"]
    ends = np.array([0, facts["boundary_m"], 60e-6])
    climbed = [0, corner, corner + (60e-6 - facts["boundary_m"]) * facts["stiffness_2_N_per_m"]]
    slopes = f"{show(facts['stiffness_1_N_per_m'], 'N/m')} and {show(facts['stiffness_2_N_per_m'], 'N/m')}"
    right.plot(MICRO * ends, climbed, color=style.LIMIT, linestyle=(0, (1, 1)), label=slopes)
    style.mark_limit(right, MICRO * facts["boundary_m"], "Region 1 | Region 2", axis="x")
    right.set_xlabel("distance behind the reversal [µm]")
    right.set_ylabel("force climbed [N]")
    right.legend(loc="lower right")
    return figure


def _choice(whole: Results) -> Drawing:
    choice = whole["results"]["choice"]
    figure, axes = style.subplots(1, 1, 52)
    ax = axes[0, 0]
    ax.semilogy(choice["count"], choice["fitted_N"], marker="o", label="loops of the fit")
    ax.semilogy(choice["count"], choice["held_out_N"], marker="s", label="held-out inner loops")
    style.mark_limit(ax, choice["noise_N"], "noise")
    ax.set_xlabel("number of elements N")
    ax.set_ylabel("rms error [N]")
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.legend()
    return figure


def _inner(whole: Results) -> Drawing:
    data = whole["results"]["hysteresis"]
    figure, axes = style.subplots(1, 1, 58)
    ax = axes[0, 0]
    x = MICRO * np.array(data["inner"]["position_m"])
    ax.plot(x, data["inner"]["machine_N"], label=f"N = {data['elements']}")
    ax.plot(x, data["inner"]["rfm_N"], label=f"N = {data['rfm_elements']}")
    ax.set_xlabel("position [µm]")
    ax.set_ylabel("friction [N]")
    ax.legend(loc="upper left")
    return figure


def _reference(whole: Results) -> Drawing:
    reference = whole["results"]["reference"]
    figure, axes = style.subplots(1, 1, 40)
    ax = axes[0, 0]
    target = MICRO * np.array(reference["target_m"])
    ax.step([-0.25, *reference["time_s"]], [0.0, *target[1:], target[-1]], where="post")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("target [µm]")
    return figure


def _positive(ax: Axes, case: Results, key: str, factor: float) -> None:
    """The five motions, the reversal apart from inching, on the band of the set where there is one."""
    time = 1e3 * np.array(case["time_s"])
    for kind, colour in (("inching", style.SKY), ("reversal", style.VERMILION)):
        if key == "travelled_m":
            low, high = (factor * np.array(case[f"{kind}_{end}_m"]) for end in ("low", "high"))
            ax.fill_between(time, low, high, color=colour, alpha=0.25, linewidth=0)
        for i, motion in enumerate(m for m in case["motions"] if m["reversal"] is (kind == "reversal")):
            width = 1.6 if kind == "reversal" else 0.9
            label = kind if i == 0 else None
            ax.plot(time, factor * np.array(motion[key]), color=colour, linestyle="-", linewidth=width, label=label)
    ax.set_xlim(0, time[-1])


def _specified(ax: Axes, case: Results, specification: Results) -> None:
    reference = MICRO * np.array(case["motions"][0]["reference_m"])
    style.tolerance_band(ax, MICRO * specification["stroke_m"], MICRO * specification["tolerance_m"], "tolerance")
    style.mark_limit(
        ax, 1e3 * specification["settling_time_s"], f"{1e3 * specification['settling_time_s']:g} ms", axis="x"
    )
    time = 1e3 * np.array(case["time_s"])
    ax.plot(time, reference, color=style.BLACK, linestyle=(0, (4, 2)), linewidth=0.9, label="$x_T^*$", zorder=4)
    ax.set_ylabel("distance travelled [µm]")
    ax.legend(loc="lower right", ncols=2)


def _variation(whole: Results) -> Drawing:
    case, specification = whole["results"]["without"], whole["machine"]["specification"]
    figure, axes = style.subplots(2, 1, 105, sharex=True)
    _positive(axes[0, 0], case, "travelled_m", MICRO)
    _specified(axes[0, 0], case, specification)
    _positive(axes[1, 0], case, "friction_N", 1.0)
    axes[1, 0].set_ylabel("rolling friction [N]")
    axes[1, 0].set_xlabel("time from the step [ms]")
    return figure


def _lissajous(whole: Results) -> Drawing:
    case, facts = whole["results"]["without"], whole["machine"]["presliding"]
    figure, axes = style.subplots(1, 1, 70)
    ax = axes[0, 0]
    motions = case["motions"]
    for motion in motions:
        colour, width = (style.VERMILION, 1.6) if motion["reversal"] else (style.BLUE, 1.0)
        label = "reversal" if motion["reversal"] else ("inching" if motion is motions[1] else None)
        x = MICRO * (np.array(motion["travelled_m"]) + motion["origin_m"])
        ax.plot(x, motion["friction_N"], color=colour, linestyle="-", linewidth=width, label=label)
        ax.axvline(MICRO * motion["target_m"], color=style.LIMIT, linewidth=0.6, linestyle=(0, (4, 2)))
    pairs = ((motions[0], "stiffness_1_N_per_m", "$K_{e1}$"), (motions[-1], "stiffness_2_N_per_m", "$K_{e2}$"))
    for motion, key, name in pairs:
        x = np.array([motion["origin_m"], motion["target_m"]])
        y = motion["friction_N"][-1] + facts[key] * (x - motion["target_m"])
        label = f"slope {name} = {show(facts[key], 'N/m')}"
        ax.plot(MICRO * x, y, color=style.BLACK, linestyle=(0, (2, 1)), linewidth=1.4, label=label)
    ax.set_xlabel("table position [µm]")
    ax.set_ylabel("rolling friction [N]")
    ax.legend(loc="lower right")
    return figure


def _compensated(whole: Results) -> Drawing:
    results, specification = whole["results"], whole["machine"]["specification"]
    figure, axes = style.subplots(2, 1, 105, sharex=True)
    _positive(axes[0, 0], results["with"], "travelled_m", MICRO)
    _specified(axes[0, 0], results["with"], specification)
    ax = axes[1, 0]
    for key, label, colour in (("without", "without", style.BLUE), ("with", "with compensation", style.VERMILION)):
        case = results[key]
        time = 1e3 * np.array(case["time_s"])
        low, high = (MICRO * np.array(case[f"dispersion_{end}_m"]) for end in ("low", "high"))
        ax.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0)
        ax.plot(time, MICRO * np.array(case["dispersion_m"]), label=label)
    published = whole["machine"]["published"]
    style.mark_limit(ax, MICRO * published["dispersion_without_m"], show(published["dispersion_without_m"], "m"))
    style.mark_limit(ax, MICRO * published["dispersion_with_m"], show(published["dispersion_with_m"], "m"))
    style.mark_limit(ax, 1e3 * specification["settling_time_s"], "", axis="x")
    ax.set_ylim(bottom=0)
    ax.set_ylabel("3σ [µm]")
    ax.set_xlabel("time from the step [ms]")
    ax.legend()
    return figure


def _set(whole: Results) -> Drawing:
    parameters = whole["results"]["set"]["parameters"]
    figure, axes = style.subplots(1, 1, 62)
    ax = axes[0, 0]

    def place(one: Results, values: Any) -> Any:
        return np.log(np.array(values) / one["low"]) / np.log(one["high"] / one["low"])

    lines = np.array([place(one, one["values"]) for one in parameters])
    ax.plot(lines, color=style.BLUE, linestyle="-", linewidth=0.5, alpha=0.6)
    central = [place(one, one["central"]) for one in parameters]
    ax.plot(central, color=style.VERMILION, linestyle="-", linewidth=2.0, marker="o")
    ax.set_xticks(
        range(len(parameters)), [one["name"].replace("_", " ") for one in parameters], rotation=40, ha="right"
    )
    ax.set_ylim(-0.03, 1.03)
    ax.set_yticks([0, 0.5, 1])
    ax.set_ylabel("place in the range searched")
    return figure


def _gap(whole: Results) -> Drawing:
    gap, published = whole["results"]["gap"], whole["machine"]["published"]
    figure, axes = style.subplots(1, 1, 50)
    ax = axes[0, 0]
    ordered = MICRO * np.sort(np.array(gap["dispersions_m"]))
    ax.plot(np.arange(1, ordered.size + 1), ordered, marker="o", linestyle="none", label="one table of the set")
    style.mark_limit(
        ax, MICRO * published["dispersion_with_m"], f"experiment,\n{show(published['dispersion_with_m'], 'm')}"
    )
    ax.set_xlabel("table, in the order of its dispersion")
    ax.set_ylabel("3σ with compensation [µm]")
    ax.set_ylim(bottom=0)
    ax.legend(loc="upper left")
    return figure
