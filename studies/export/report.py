"""The report of an export: what was written, what was compared, and what a drive's own cascade keeps of the scheme."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from models.quantity import show
from reports import style
from reports.markup import Markdown
from reports.report import Figure, Report
from reports.units import length_unit, time_unit
from studies.wording import filters

Results = Mapping[str, Any]
TABLES = {
    "law": ("results.law",),
    "drive": ("results.drive", "results.law", "machine.specification"),
    "proof": ("results.proof", "results.law"),
    "tables": ("results.proof.tables",),
    "parameters": ("parameters",),
}
CAPTION = Markdown(
    "Responses of $x_T^*$, the compensator's path and $u_{ff}$ to a step of the target by one stroke: what the law "
    "plays for every change of the target, scaled by it."
)


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    results = whole["results"]
    figures = (Figure("responses", CAPTION, ("results.responses",), _responses),)
    proof = results.get("proof", {})
    there = {"proof": bool(proof), "tables": "tables" in proof, "drive": bool(results["drive"]["rows"])}
    absent = {name for name, given in there.items() if not given}
    tables = {name: keys for name, keys in TABLES.items() if name not in absent}
    return Report(
        f"Export of the controller: {whole['machine']['name']}",
        "Is the controller the same in C, as an FMU, in structured text and in MATLAB?",
        Path(__file__).parent / "report.md",
        figures,
        {**filters(), "newtons": lambda value: show(value, "N", 2)},
        tables,
    )


def _responses(whole: Results) -> Drawing:
    responses = whole["results"]["responses"]
    figure, axes = style.subplots(2, 1, 80, sharex=True)
    count, unit = length_unit(max(np.max(np.abs(responses[key])) for key in ("position_m", "path_m")))
    times, of_time = time_unit(responses["time_s"][-1])
    time = times * np.array(responses["time_s"])
    for key, label in (("position_m", "$x_T^*$"), ("path_m", "path of the compensator")):
        axes[0, 0].step(time, count * np.array(responses[key]), where="post", label=label)
    axes[0, 0].set_ylabel(f"position [{unit}]")
    axes[0, 0].legend(loc="lower right")
    axes[1, 0].step(time, responses["thrust_N"], where="post")
    axes[1, 0].set_ylabel("$u_{ff}$ [N]")
    axes[1, 0].set_xlabel(f"time from the change of the target [{of_time}]")
    return figure
