"""Machines at the edges of what can be: each study answers or refuses in one line, and an unstable loop comes first."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from models.machine import DEFAULT
from studies.catalogue import every
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, main

TEXT = DEFAULT.read_text(encoding="utf-8")
UNSTABLE = "the loop is unstable: with control.pid on a mass of"
REFUSED = (
    (("1.061 ms", "25 ms"), UNSTABLE),  # 50 samples
    (('"0.022353 1/kg"', '"22.353 1/kg"'), UNSTABLE),  # a mass in grams
    (('"1.7486e.06 N/m"', '"1.7486e9 N/m"'), UNSTABLE),
    (
        (r"\[drive\]", '[drive]\noffset = "140 N"'),
        "drive.offset takes 140 N and friction takes 16.5 N, all of the rated",
    ),
    (('"150 N"', '"16 N"'), "friction takes 16.5 N, all of the rated 16 N"),
    (('resolution = { value = "0.1 um"', 'resolution = { value = "5 um"'), "scale.resolution: 5 µm is above"),
    (('noise = { value = "0 um"', 'noise = { value = "5 um"'), "scale.noise: 5 µm is above specification.tolerance"),
    (('stroke = { value = "20 um"', 'stroke = { value = "1 nm"'), "so that standing still would settle"),
)
ANSWERED = (
    ("38 Hz", "80.9 Hz"),  # two modes that are nearly one
    ('damping = { value = "0.013981"', 'damping = { value = "0"'),
    (r'"7.3305e\+07 N/\(m s\)"', '"0 N/(m s)"'),
    ("motions = { value = 5", "motions = { value = 2"),
    ('interval = { value = "0.5 s"', 'interval = { value = "26 ms"'),
)


def machine_file(folder: Path, old: str, new: str) -> Path:
    """The default machine file with the first match of a regular expression replaced."""
    text, count = re.subn(old, new, TEXT, count=1)
    assert count == 1
    path = folder / "axis.toml"
    path.write_text(text, encoding="utf-8")
    return path


def run(name: str, machine: Path, *options: str) -> int:
    """The exit status of a quick study."""
    output = str(machine.parent / "out")
    return main(every()[name], ["--machine", str(machine), "--quick", "--no-report", "--output", output, *options])


@pytest.mark.parametrize("name", ["deadbeat_design", "trajectory_optimisation"])
@pytest.mark.parametrize(("change", "says"), REFUSED, ids=[new for (_, new), _ in REFUSED])
def test_a_machine_on_which_nothing_can_be_designed_is_refused(
    name: str, change: tuple[str, str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(name, machine_file(tmp_path, *change)) == BAD_INPUT
    captured = capsys.readouterr()
    assert says in captured.err
    assert captured.err.count("error:") == 1
    assert captured.out == ""


@pytest.mark.parametrize("change", ANSWERED, ids=[new for _, new in ANSWERED])
def test_a_machine_at_an_edge_is_answered(change: tuple[str, str], tmp_path: Path) -> None:
    assert run("deadbeat_design", machine_file(tmp_path, *change)) in {DONE, CHECK_MISSED}


def test_another_machine_is_not_held_to_be_as_slow_as_the_published_one(tmp_path: Path) -> None:
    """The reversal without compensation has to take long on the paper's table only."""
    machine = machine_file(tmp_path, '"0.022353 1/kg"', '"0.0225 1/kg"')
    assert run("deadbeat_design", machine) in {DONE, CHECK_MISSED}
    checks = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["checks"]
    assert [check["name"] for check in checks if check["sense"] == ">="] == []


@pytest.mark.parametrize(
    ("gains", "says"),
    [
        ({"kp_N_per_m": 1.7e9}, UNSTABLE),
        ({"kp_N_per_m": float("nan")}, "a gain or coefficient is negative or not finite"),
        ({"kd_Ns_per_m": 1e300}, "pid.kd: 1e+300 N s/m must be at most"),
    ],
)
def test_a_controller_that_cannot_be_used_is_refused(
    gains: dict[str, float], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pid = {"kp_N_per_m": 1.7e6, "ki_N_per_ms": 7e7, "kd_Ns_per_m": 1e4, "derivative_filter_s": 1e-4} | gains
    controller = tmp_path / "controller.json"
    content = {"sample_time_s": 5e-4, "reference_delay_samples": 2, "n_ff": [1.0], "d_ff": [0.0], "pid": pid}
    controller.write_text(json.dumps({**content, "friction_compensation": None}), encoding="utf-8")
    machine = machine_file(tmp_path, "name", "name")
    assert run("deadbeat_design", machine, "--controller", str(controller)) == BAD_INPUT
    assert says in capsys.readouterr().err
