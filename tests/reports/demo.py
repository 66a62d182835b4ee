"""A small made-up report that holds one of everything: the report that the tests render and that people look at."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from reports.markup import Markdown
from reports.report import Figure, Report
from reports.style import COLOURS, MARKERS, mark_limit, subplots, tolerance_band


def results() -> dict[str, Any]:
    """Results of a second-order axis with made-up numbers, as plain data."""
    time = np.linspace(0.0, 40.0, 401)  # ms
    frequency = np.geomspace(1.0, 2000.0, 300)  # Hz
    steps = {}
    for name, damping in (("feedback only", 0.25), ("with compensation", 0.7), ("worst friction", 0.45)):
        omega = 0.9  # rad/ms
        decay = np.exp(-damping * omega * time)
        swing = omega * math.sqrt(1.0 - damping**2)
        steps[name] = (10.0 * decay * np.cos(swing * time)).tolist()
    laplace = 2j * np.pi * frequency
    loop = 4.0e4 / (laplace**2 + 30.0 * laplace + 900.0) * (1.0 + laplace / 120.0)
    checks = [
        {"name": "Settling time to ±1 µm", "unit": "ms", "limit": 12.0, "value": 9.8, "holds": True},
        {"name": "Modulus margin 1/max|S|", "unit": "–", "limit": 0.5, "value": 0.61, "holds": True},
        {"name": "Peak current in the stroke", "unit": "A", "limit": 8.0, "value": 8.7, "holds": False},
    ]
    return {
        "axis": {"mass_kg": 4.2, "stiffness_N_m": 3.7e6, "friction_N": 1.8},
        "step": {"time_ms": time.tolist(), "error_um": steps, "tolerance_um": 1.0, "handover_ms": 12.0},
        "loop": {
            "frequency_Hz": frequency.tolist(),
            "magnitude": np.abs(loop).tolist(),
            "phase_deg": np.degrees(np.unwrap(np.angle(loop))).tolist(),
        },
        "checks": checks,
        "contributions": {
            "names": ["Rolling friction", "Cable chain", "Encoder", "Quantisation", "Floor vibration", "Drive ripple"],
            "before_um": [3.1, 1.2, 0.4, 0.2, 0.9, 0.6],
            "after_um": [0.5, 0.4, 0.4, 0.2, 0.6, 0.3],
            "limit_um": 1.0,
        },
        "runs": [
            {
                "number": number,
                "stroke_mm": 0.1 * number,
                "settling_ms": 8.0 + 0.11 * number,
                "peak_um": 0.4 + 0.017 * number,
                "holds": number < 36,
            }
            for number in range(1, 41)
        ],
        "variants": [
            {
                "name": name,
                **{f"case_{case}": round(0.31 * case + 0.2 * row + 10.0 ** (case % 3), 3) for case in range(1, 10)},
                "remark": remark,
            }
            for row, (name, remark) in enumerate(
                [
                    ("Feedback only", "Meets nothing below 0.5 mm, kept as the reference"),
                    ("Feedforward", "Needs the inertia to 2 %"),
                    ("Observer", "Robust, but noise passes to the current"),
                    ("Observer and feedforward", "Chosen: the smallest error over all strokes and temperatures"),
                ]
            )
        ],
    }


def draw_step(results: Mapping[str, Any]) -> Drawing:
    step = results["step"]
    figure, ((left, right),) = subplots(1, 2, 62.0, width_ratios=[2, 1])
    for ax in (left, right):
        tolerance_band(ax, 0.0, step["tolerance_um"], "tolerance ±1 µm")
        for name, error in step["error_um"].items():
            ax.plot(step["time_ms"], error, label=name)
        mark_limit(ax, step["handover_ms"], "handover", "x")
        ax.set(xlabel="time after the stroke $t$ / ms", ylabel="error $e$ / µm")
    right.set(xlim=(8.0, 20.0), ylim=(-2.5, 2.5), title="(b) detail", xlabel="$t$ / ms")
    left.set(xlim=(0.0, 40.0), title="(a) whole response")
    left.legend()
    return figure


def draw_loop(results: Mapping[str, Any]) -> Drawing:
    loop = results["loop"]
    figure, ((magnitude,), (phase,)) = subplots(2, 1, 85.0, sharex=True)
    magnitude.loglog(loop["frequency_Hz"], loop["magnitude"])
    mark_limit(magnitude, 1.0, "crossover")
    magnitude.set(ylabel=r"$|L(\mathrm{j}\omega)|$")
    phase.semilogx(loop["frequency_Hz"], loop["phase_deg"])
    phase.set(ylabel="∠L / °", xlabel="frequency $f$ / Hz", yticks=[-180, -135, -90, -45, 0])
    return figure


def draw_contributions(results: Mapping[str, Any]) -> Drawing:
    parts = results["contributions"]
    figure, ((ax,),) = subplots(1, 1, 60.0)
    places = np.arange(len(parts["names"]))
    for shift, (key, label) in enumerate((("before_um", "before"), ("after_um", "after"))):
        ax.bar(
            places + 0.38 * (shift - 0.5),
            parts[key],
            0.36,
            label=label,
            color=COLOURS[shift],
            hatch=("", "////")[shift],
            edgecolor="white",
        )
    mark_limit(ax, parts["limit_um"], "limit 1 µm")
    ax.set(ylabel="3σ error / µm")
    ax.set_xticks(places, parts["names"])
    ax.grid(visible=False, axis="x")
    ax.legend()
    return figure


def draw_runs(results: Mapping[str, Any]) -> Drawing:
    figure, ((ax,),) = subplots(1, 1, 55.0)
    for key, label, marker in (
        ("settling_ms", "settling time / ms", MARKERS[0]),
        ("peak_um", "peak error / µm", MARKERS[1]),
    ):
        values = [run[key] for run in results["runs"]]
        ax.plot([run["stroke_mm"] for run in results["runs"]], values, marker=marker, markevery=4, label=label)
    mark_limit(ax, 12.0, "limit 12 ms")
    ax.set(xlabel="stroke / mm", yscale="log")
    ax.legend(ncols=2)
    return figure


TEMPLATE = Path(__file__).with_name("demo.md")


def report(template: Path = TEMPLATE) -> Report:
    """The demonstration report from `template`."""
    return Report(
        title="Settling of a stage on rolling guides",
        question="Does the compensated axis settle to ±1 µm within 12 ms after every stroke, and at what current?",
        template=template,
        figures=(
            Figure(
                "step",
                Markdown(
                    "Error $e(t)$ after a 10 µm step for three compensators; grey: the tolerance $|e| \\le 1$ µm. "
                    "The detail shows the remaining error at the handover."
                ),
                ("step",),
                draw_step,
            ),
            Figure(
                "loop",
                Markdown(r"Open loop $L(\mathrm{j}\omega) = P(\mathrm{j}\omega)\,C(\mathrm{j}\omega)$."),
                ("loop.frequency_Hz", "loop.magnitude", "loop.phase_deg"),
                draw_loop,
            ),
            Figure(
                "contributions", Markdown("Error budget: $3\\sigma$ by source."), ("contributions",), draw_contributions
            ),
            Figure(
                "runs",
                Markdown("Settling time and peak error over the stroke, $s \\in [0.1, 4)$ mm."),
                ("runs",),
                draw_runs,
            ),
        ),
        filters={"fixed": lambda value, digits=2: f"{value:.{digits}f}"},
    )
