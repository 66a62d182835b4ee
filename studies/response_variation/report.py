"""The report of the response variation: its figures, with the range of the set, and captions (report.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from models.quantity import listed, show, span
from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from studies.diagrams import elements_figure, loop_figure, setup_figure
from studies.response_variation.phenomena_figures import DROOP, OBSERVER, draw_droop, draw_observer
from studies.wording import filters, quantity

Results = Mapping[str, Any]
MICRO = 1e6


def tell(whole: Results) -> Report:
    """The report on what results.json holds; for a single machine without the figures and tables of a set."""
    specification, alone = "machine.specification", whole["results"]["alone"]
    said = _captions(whole)
    drawn: tuple[tuple[str, tuple[str, ...], Callable[[Results], Drawing]], ...] = (
        ("bode", ("results.bode",), _bode),
        ("droop", ("results.droop",), draw_droop),
        ("hysteresis", ("results.hysteresis", "machine.presliding"), _hysteresis),
        ("choice", ("results.choice",), _choice),
        ("inner", ("results.hysteresis",), _inner),
        ("reference", ("results.reference",), _reference),
        ("variation", ("results.without", specification), _variation),
        ("lissajous", ("results.without", "machine.presliding"), _lissajous),
        ("observer", ("results.observer",), draw_observer),
        ("compensated", ("results.without", "results.with", specification, "machine.published"), _compensated),
        ("set", ("results.set",), _set),
        ("gap", ("results.gap", "machine.published"), _gap),
    )
    figures = (
        setup_figure(),
        elements_figure(),
        loop_figure("results.hysteresis.rfm_elements"),
        *(Figure(name, said[name], keys, draw) for name, keys, draw in drawn if not (alone and name in OF_THE_SET)),
    )
    tables = {name: keys for name, keys in TABLES.items() if not (alone and name in OF_THE_SET)}
    title = f"Response variation: {whole['machine']['name']}"
    question = "Does the model reproduce the paper's response variation, and which tables are consistent with it?"
    return Report(title, question, Path(__file__).parent / "report.md", figures, {**filters(), **FILTERS}, tables)


OF_THE_SET = ("set", "gap", "deadbeats", "conventions")
TABLES = {
    "paper": ("results.paper",),
    "taken": ("results.taken",),
    "facts": ("results.choice.facts",),
    "elements": ("results.choice.elements",),
    "slopes": ("results.mechanism",),
    "settling": ("results.settling",),
    "droop": ("results.droop",),
    "small": ("results.small",),
    "exchange": ("results.mechanism",),
    "set": ("results.set",),
    "deadbeats": ("results.conventions",),
    "conventions": ("results.conventions", "results.set"),
    "parameters": ("parameters",),
}


def _captions(whole: Results) -> dict[str, str]:
    """The captions, with the paper's statements on its own figures; its numbers come from the machine file."""
    results, facts, wanted = whole["results"], whole["machine"]["presliding"], whole["machine"]["specification"]
    published, friction = whole["machine"]["published"], results["hysteresis"]
    slopes = tuple(show(facts[f"stiffness_{i}_N_per_m"], "N/m") for i in (1, 2))
    late, in_time = (show(t, "s") for t in (published["reversal_settling_time_s"], wanted["settling_time_s"]))
    before, after = (show(published[f"dispersion_{case}_m"], "m") for case in ("without", "with"))
    band = "" if results["alone"] else f" Shaded: the range of {_tables(results)}."
    central = results["set"]["machine_is_most_central"]
    thick = "" if central is None else (", the most central of them" if central else ", not the most central of them")
    return {
        "bode": "Plant and its equivalents in the presliding region, magnitude and phase. Fig. 2 of the paper shows "
        "the same three curves, and reads from them that the table is an elastic body in micrometre motions." + band,
        "droop": DROOP,
        "observer": OBSERVER,
        "hysteresis": "Hysteresis over ±150 µm (left) and the branch after a reversal (right). Fig. 3 of the paper: "
        f"presliding over about {show(facts['extent_m'], 'm')}, the steepest slope just after the reversal, "
        "comprehensive slopes "
        + Markdown("$K_{e1}$ = ")
        + slopes[0]
        + Markdown(" and $K_{e2}$ = ")
        + f"{slopes[1]} with the boundary at about {show(facts['boundary_m'], 'm')}; "
        + Markdown("$N = ")
        + str(friction["rfm_elements"])
        + Markdown("$ keeps both slopes.")
        + band,
        "choice": Markdown(
            "The paper's way to choose $N$: rms error of $N$ elements on a simulated, noisy measurement of a "
            "finer hysteresis, on the loops of the fit and on inner loops that it has not seen."
        ),
        "inner": "Inner loops. Fig. 4 of the paper: the curve depends on the history of the position, and "
        + Markdown("$N = ")
        + str(friction["elements"])
        + Markdown("$ follows it well.")
        + band,
        "reference": "Target position, the same for every table. Fig. 5 of the paper: reversal and inching motions in "
        f"sequence, {show(wanted['interval_s'], 's')} apart.",
        "variation": f"{len(results['without']['motions'])} positive motions without compensation. Figs. 7 and 12 of "
        f"the paper: the reversal lags and needs {late}, inching does not; the friction differs in every "
        "motion, and its steady value rises along the feed." + band,
        "lissajous": "Rolling friction against position, with the targets. Fig. 8 of the paper: the reversal meets "
        f"about {slopes[0]}, inching about {slopes[1]}." + band,
        "compensated": "Responses with friction compensation, and the dispersion without and with it. Fig. 14 of the "
        f"paper: the reversal settles within {in_time}, the dispersion falls from {before} to {after}, and the inching "
        f"motions still miss ±{show(wanted['tolerance_m'], 'm')}." + band,
        "set": "The tables of the set, each a line, over the ranges searched (0 to 1, logarithmic; see "
        + Markdown("[](#tbl:set)); thick: the table of this report")
        + f"{thick}.",
        "gap": f"Dispersion with compensation over the set, beside the {after} of the experiment: the gap that the "
        "model leaves.",
    }


def _tables(results: Results) -> str:
    return (
        f"{results['simulated']} tables of the set" if results["quick"] else f"the set of {results['members']} tables"
    )


def _deviation(number: float | None, unit: str) -> str:
    """A standard deviation with its unit; None stands for one that is not finite."""
    return "open" if number is None else quantity(number, unit, 2)


def _worded(parameters: Sequence[Results], word: str) -> str:
    """The meanings of the parameters of which the results say this; the slopes are published themselves."""
    found = [one for one in parameters if one["word"] == word and not one["name"].startswith("slope")]
    return listed(f"the {one['meaning']}" for one in found) or "nothing"


def _from_to(values: Sequence[float] | None, unit: str) -> str:
    """The ends of a range, whose middle stands between them; None for the range of nothing."""
    if values is None:
        return "–"
    return span(quantity(values[0], unit, 3), quantity(values[-1], unit, 3))


def _range(parameter: Results, unit: str) -> str:
    return _from_to((parameter["quantile_05"], parameter["quantile_95"]), unit)


def _ends(quantiles: Sequence[float] | None) -> str:
    return _from_to(quantiles, "m")


def _shares(ends: Results) -> str:
    """The ends of a range of shares [%], or the one number that both are."""
    low, high = (f"{100 * ends[end]:.0f}" for end in ("low", "high"))
    return span(low, high)


FILTERS: dict[str, Callable[..., Any]] = {
    "deviation": _deviation,
    "worded": _worded,
    "from_to": _from_to,
    "range": _range,
    "ends": _ends,
    "shares": _shares,
}


def _shade(ax: Axes, x: Any, low: Any, high: Any, colour: str) -> None:
    """The range of the set between two curves; invisible if the set is one table."""
    ax.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)


def _bode(whole: Results) -> Drawing:
    bode = whole["results"]["bode"]
    figure, axes = style.subplots(2, 1, 85, sharex=True)
    labels = {"P_l": "$P_l$", "P_e1": "$P_{e1}$", "P_e2": "$P_{e2}$"}
    for (name, label), colour in zip(labels.items(), style.COLOURS, strict=False):
        curve = bode[name]
        slope = curve["stiffness_N_per_m"]
        text = f"{label} ($K_e$ = {show(slope, 'N/m')})" if slope else f"{label} (rolling)"
        frequency = bode["frequency_Hz"]
        _shade(axes[0, 0], frequency, curve["magnitude_low_m_per_N"], curve["magnitude_high_m_per_N"], colour)
        _shade(axes[1, 0], frequency, curve["phase_low_deg"], curve["phase_high_deg"], colour)
        axes[0, 0].loglog(frequency, curve["magnitude_m_per_N"], label=text)
        axes[1, 0].semilogx(frequency, curve["phase_deg"])
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
    _loops(left, data, "overview")
    left.set_xlabel("position [µm]")
    left.set_ylabel("friction [N]")
    left.legend(loc="center")
    distance = MICRO * np.array(data["branch"]["distance_m"])
    shown = distance <= 60
    climb = {name: np.array(data["branch"][f"{name}_N"])[shown] for name in ("machine", "rfm", "low", "high")}
    _shade(right, distance[shown], climb["low"], climb["high"], style.BLUE)
    right.plot(distance[shown], climb["machine"])
    right.plot(distance[shown], climb["rfm"])
    corner = facts["boundary_m"] * facts["stiffness_1_N_per_m"]
    ends = np.array([0, facts["boundary_m"], 60e-6])
    climbed = [0, corner, corner + (60e-6 - facts["boundary_m"]) * facts["stiffness_2_N_per_m"]]
    slopes = f"{show(facts['stiffness_1_N_per_m'], 'N/m')} and {show(facts['stiffness_2_N_per_m'], 'N/m')}"
    right.plot(MICRO * ends, climbed, color=style.LIMIT, linestyle=(0, (1, 1)), label=slopes)
    style.mark_limit(right, MICRO * facts["boundary_m"], "Region 1 | Region 2", axis="x", end="bottom")
    right.set_xlabel("distance after the reversal [µm]")
    right.set_ylabel("force climbed [N]")
    right.legend(loc="lower right")
    return figure


def _loops(ax: Axes, data: Results, name: str) -> None:
    """A hysteresis curve of the machine and of its RFM, on the range of the set leg by leg."""
    curve = data[name]
    x = MICRO * np.array(curve["position_m"])
    for i in range(0, x.size, data["leg"]):
        leg = slice(i, i + data["leg"])
        _shade(ax, x[leg], curve["low_N"][leg], curve["high_N"][leg], style.BLUE)
    ax.plot(x, curve["machine_N"], label=f"N = {data['elements']}")
    ax.plot(x, curve["rfm_N"], label=f"N = {data['rfm_elements']}")


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
    _loops(ax, data, "inner")
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
    """The positive motions, the reversal apart from inching, on the range of the set: of a kind, or of each motion."""
    time = 1e3 * np.array(case["time_s"])
    for kind, colour in (("inching", style.SKY), ("reversal", style.VERMILION)):
        if key == "travelled_m":
            low, high = (factor * np.array(case[f"{kind}_{end}_m"]) for end in ("low", "high"))
            _shade(ax, time, low, high, colour)
        for i, motion in enumerate(m for m in case["motions"] if m["reversal"] is (kind == "reversal")):
            width = 1.6 if kind == "reversal" else 0.9
            label = kind if i == 0 else None
            if key == "friction_N":
                _shade(ax, time, motion["friction_low_N"], motion["friction_high_N"], colour)
            ax.plot(time, factor * np.array(motion[key]), color=colour, linestyle="-", linewidth=width, label=label)
    ax.set_xlim(0, time[-1])


def _specified(ax: Axes, case: Results, specification: Results) -> None:
    reference = MICRO * np.array(case["motions"][0]["reference_m"])
    style.tolerance_band(ax, MICRO * specification["stroke_m"], MICRO * specification["tolerance_m"], "tolerance")
    in_time = specification["settling_time_s"]
    style.mark_limit(ax, 1e3 * in_time, "", axis="x")
    # The label stands at the foot of the line, clear of the motions.
    ax.annotate(
        show(in_time, "s"),
        (1e3 * in_time, 0.04),
        xytext=(3, 0),
        textcoords="offset points",
        xycoords=ax.get_xaxis_transform(),
        fontsize=7.0,
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
        _shade(ax, MICRO * np.array(motion["at_m"]), motion["at_low_N"], motion["at_high_N"], colour)
        label = "reversal" if motion["reversal"] else ("inching" if motion is motions[1] else None)
        x = MICRO * (np.array(motion["travelled_m"]) + motion["origin_m"])
        ax.plot(x, motion["friction_N"], color=colour, linestyle="-", linewidth=width, label=label)
        ax.axvline(MICRO * motion["target_m"], color=style.LIMIT, linewidth=0.6, linestyle=(0, (4, 2)))
    pairs = (
        (motions[0], "stiffness_1_N_per_m", "$K_{e1}$", style.BLACK, (0, (4, 1.5))),
        (motions[-1], "stiffness_2_N_per_m", "$K_{e2}$", style.GREEN, (0, (1, 1))),
    )
    for motion, key, name, colour, dashes in pairs:
        x = np.array([motion["origin_m"], motion["target_m"]])
        y = motion["friction_N"][-1] + facts[key] * (x - motion["target_m"])
        label = f"slope {name} = {show(facts[key], 'N/m')}"
        ax.plot(MICRO * x, y, color=colour, linestyle=dashes, linewidth=1.8, label=label)
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
        _shade(ax, time, low, high, colour)
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
    ax.plot(lines, color=style.SKY, linestyle="-", linewidth=0.5, alpha=0.6)
    central = [place(one, one["central"]) for one in parameters]
    ax.plot(central, color=style.BLACK, linestyle="-", linewidth=2.0, marker="o")
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
