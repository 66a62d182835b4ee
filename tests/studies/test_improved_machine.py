"""A machine file with named effects in it, as gap_diagnosis writes one, is a machine to every study that designs."""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from models.machine import DEFAULT
from studies.command import CHECK_MISSED, DONE, main

EFFECTS = """
[effects.viscous_friction]
coefficient = { value = "40 N s/m", source = "identified: gap_diagnosis" }

[[effects.gain_asymmetry]]
asymmetry = "0.01"

[covered]
force = { value = "46 N", source = "identified: moves.csv" }
speed = "0.05 m/s"
"""


def improved(folder: Path, sample_time: str) -> Path:
    """The default table with effects; fewer and shorter motions, so that the studies are quick."""
    text = DEFAULT.read_text(encoding="utf-8")
    text = re.sub(r"(motions = \{ value = )\d+", r"\g<1>2", text)
    text = re.sub(r'(interval = \{ value = )"[^"]*"', r'\1"0.1 s"', text)
    text = re.sub(r'(sample_time = \{ value = )"[^"]*"', rf'\1"{sample_time}"', text)
    file = folder / "improved.toml"
    file.write_text(text + EFFECTS, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("name", "sample_time", "options"),
    [
        ("pid_tradeoff", "500 us", ["--mode-error", "0", "--mass-error", "0"]),
        ("response_variation", "500 us", []),
        # A trajectory has an unknown for each sample.
        ("trajectory_optimisation", "1 ms", ["--objective", "peak_thrust", "--tables", "1"]),
    ],
)
def test_a_study_runs_on_the_improved_machine(
    name: str, sample_time: str, options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Aims may be missed: they are not those of this table. Designs beyond the records' 46 N are warned of."""
    study = import_module(f"studies.{name}.__main__").STUDY
    file, output = improved(tmp_path, sample_time), tmp_path / "out"
    common = ["--quick", "--no-report", "--machine", str(file), "--output", str(output)]
    assert main(study, [*common, *options]) in {DONE, CHECK_MISSED}
    whole = json.loads((output / "results.json").read_text(encoding="utf-8"))
    machine = whole["machine"]
    said = capsys.readouterr().out
    if name != "response_variation":
        assert {one["what"] for one in whole["results"]["beyond"]} == {"force"}
        assert "WARNING, the " in said
    if name == "pid_tradeoff":
        assert re.search("effects that act, met where friction is +viscous friction and gain asymmetry", said)
    assert machine["effects"] == {
        "viscous_friction": {"coefficient_Ns_per_m": 40.0},
        "gain_asymmetry": {"asymmetry": 0.01},
    }
    assert "[effects.viscous_friction]" in (output / "machine.toml").read_text(encoding="utf-8")


def test_the_deadbeat_report_is_of_the_controller_that_is_written(tmp_path: Path) -> None:
    """Which meets the effects: its motions, its dispersion and its feedforward, not those without the effects' plan."""
    study = import_module("studies.deadbeat_design.__main__").STUDY
    file, output = improved(tmp_path, "500 us"), tmp_path / "out"
    common = ["--quick", "--no-report", "--machine", str(file), "--output", str(output)]
    assert main(study, common) in {DONE, CHECK_MISSED}
    whole = json.loads((output / "results.json").read_text(encoding="utf-8"))
    controller, results = json.loads((output / "controller.json").read_text(encoding="utf-8")), whole["results"]
    *_, without, written = results["effects"]["rows"]
    assert results["with"]["worst_dispersion_m"] == written["dispersion_m"] != without["dispersion_m"]
    assert max(one["settling_s"] for one in results["with"]["motions"]) == written["settling_s"]
    checks = {check["name"]: check["value"] for check in whole["checks"]}
    assert checks["settling with compensation, all motions"] == written["settling_s"]
    thrust = np.cumsum(controller["d_ff"]) * controller["stroke_m"]
    assert np.array(results["deadbeat"]["thrust_N"]) == pytest.approx(thrust[: len(results["deadbeat"]["thrust_N"])])
