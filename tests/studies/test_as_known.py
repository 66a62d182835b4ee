"""A design on machines that its file allows: varied by what the file states, and else by tolerances."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.controller import assemble, design_deadbeat
from design.validation import validate
from models.machine import Machine, Provenance, load
from models.machine_file import to_toml
from reports import text
from studies.as_known import _slowest, in_short, limit_rows, on_allowed_machines, origin, spread, summary_row
from studies.catalogue import every
from studies.command import main
from studies.deadbeat_design.__main__ import STUDY
from studies.deadbeat_design.options import DeadbeatOptions

MACHINE = load()
CONTROLLER = assemble(MACHINE, design_deadbeat(MACHINE))
JUDGED = validate(MACHINE, CONTROLLER)


def stated(deviation: float) -> Machine:
    """The default machine, whose file states a standard deviation of its dead time [s]."""
    return MACHINE.with_value("plant.dead_time", MACHINE.plant.dead_time, Provenance("identified", "x", std=deviation))


def found(machine: Machine) -> dict[str, object]:
    stroke = MACHINE.specification.stroke
    return on_allowed_machines(machine, CONTROLLER, JUDGED, DeadbeatOptions(quick=True), stroke)


def test_what_the_file_states_decides_how_many_machines_settle_in_time() -> None:
    """The same controller and values: only what the file says of how well it knows one of them differs."""
    sure, vague = found(stated(1e-9)), found(stated(2e-3))
    assert sure["in_time"] == sure["machines"]
    assert int(str(vague["in_time"])) < int(str(vague["machines"]))
    assert in_short(sure) == in_short(found(stated(1e-9)))
    assert "the file's own deviations for 1 of" in in_short(sure)
    assert "the usual tolerances" in in_short(found(MACHINE))


def test_a_row_says_by_what_a_value_is_varied_and_from_where() -> None:
    rows = {row["name"]: row for row in found(stated(4e-5))["known"]}  # type: ignore[attr-defined]
    delay, limit = rows["plant.dead_time"], rows["friction.limit"]
    assert delay["std"] == [4e-5, 4e-5]
    assert (delay["origin"], origin(delay)) == ("value", "stated beside the value")
    assert spread(delay) == f"{100 * 4e-5 / MACHINE.plant.dead_time:.2g} %"
    assert (limit["origin"], spread(limit)) == ("usual", "3 %")
    assert rows["drive.offset"]["share"] is None
    assert spread(rows["drive.offset"]) == "0.2 N"


def test_a_loop_that_runs_away_never_settles() -> None:
    """A position that is not a number is not within any tolerance."""
    position = JUDGED.response.position.copy()
    assert _slowest(position, JUDGED, MACHINE) == JUDGED.slowest.settling_time
    position[-3:] = np.nan
    assert _slowest(position, JUDGED, MACHINE) == math.inf


def test_a_design_that_holds_on_the_file_s_values_alone_is_not_a_yes(tmp_path: Path) -> None:
    """The friction's force is known to 60 % only, which the feedback cannot make up for in time; and a fit left its
    dead time at the end of its range, which the first page tells as well."""
    machine = replace(load(), tolerance=replace(load().tolerance, friction_level=0.6, stiffness=0.6, limit=0.6))
    left = Provenance("identified", "a fit", at_limit=True)
    machine = machine.with_value("plant.dead_time", machine.plant.dead_time, left)
    file = tmp_path / "unsure.toml"
    file.write_text(to_toml(machine), encoding="utf-8")
    output = tmp_path / "out"
    assert main(STUDY, ["--quick", "--machine", str(file), "--output", str(output)]) == 0
    found = json.loads((output / "results.json").read_text(encoding="utf-8"))["results"]["as_known"]
    assert found["in_time"] < found["machines"]
    page = (output / "report.html").read_text(encoding="utf-8")
    said = f"but only {found['in_time']} of {found['machines']} machines that the file allows settle in time"
    assert said in " ".join(page.split())
    assert "Yes: all" not in page
    assert "the machine file marks plant.dead_time as left at the end of the range" in " ".join(page.split())


def test_a_design_on_values_at_the_end_of_their_range_is_a_warning() -> None:
    """Of a worm gear's improved.toml a design "held" that took 316 ms on the axis, 200 specified."""
    assert limit_rows(load()) == []
    marked = replace(load().sources["plant.dead_time"], at_limit=True)
    machine = replace(load(), sources={**load().sources, "plant.dead_time": marked})
    ((name, told),) = limit_rows(machine)
    assert name == "WARNING, values at the end of the range that a fit had"
    assert told.startswith("plant.dead_time: the model lacks something")


@pytest.mark.parametrize("name", ["deadbeat_design", "export", "pid_tradeoff", "trajectory_optimisation"])
def test_every_report_of_a_design_names_such_values(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    whole = json.loads((quick_run(name)[0] / "results.json").read_text(encoding="utf-8"))
    assert "left at the end of the range" not in _page(name, whole)
    whole["parameters"][0]["provenance"]["at_limit"] = True
    assert f"marks {whole['parameters'][0]['name']} as left at the end of the range" in _page(name, whole)


def _page(name: str, whole: dict[str, Any]) -> str:
    report = every()[name].report(whole)
    captions = {figure.name: figure.caption for figure in report.figures}
    return " ".join(text.fill(report.template, whole, captions, report.filters).replace("\\", "").split())


@pytest.mark.parametrize(("in_time", "warns"), [(10, False), (5, False), (4, True), (0, True)])
def test_a_design_for_one_machine_of_many_is_a_warning(in_time: int, warns: bool) -> None:
    name, told = summary_row({"in_time": in_time, "machines": 10, "known": []})
    assert name.startswith("WARNING, machines") == warns
    assert told.startswith(f"{in_time} of 10 ")
