"""Machines at the edges of what can be: each study answers or refuses in one line, and an unstable loop comes first.

A refusal comes before any work. Of the studies that answer only the quickest is run here on every edge.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from _pytest.capture import CaptureResult

import studies.blind_trial
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
    (('stroke = { value = "20 um"', 'stroke = { value = "1 nm"'), "so a table that never moves would count as settled"),
    (
        (r"\[published\]", '[effects.viscous_friction]\ncoefficient = "1e7 N s/m"\n\n[published]'),
        "their forces make a mass of 44.74 kg run away within",
    ),
    (('"1.7486e.06 N/m"', '"0 N/m"'), "control.pid.kp is 0, so that nothing pulls the table to its target; give gains"),
)
NOT_LOADED = (
    (
        (r"\[specification\]", '[[control.filters.notch]]\nfrequency = "2e-6 Hz"\ndamping = "0.2"\n\n[specification]'),
        "control.filters.notch.1.frequency: 2 µHz must be at least 100 mHz",
    ),
    ((r"(?m)^stiffness = .*$", 'stiffness = { value = ["0 N/mm"] }'), "friction"),
    (("motions = { value = 5", "motions = { value = 1"), "specification.motions: 1 must be at least 2"),
    (('interval = { value = "0.5 s"', 'interval = { value = "20 ms"'), "interval have to follow each other"),
)
STUDIES = [name for name in every() if name not in {"review", "blind_trial"}]  # these two take a folder, see below
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


def controller_file(folder: Path, gains: dict[str, float]) -> Path:
    """A controller.json with some gains replaced."""
    pid = {"kp_N_per_m": 1.7e6, "ki_N_per_ms": 7e7, "kd_Ns_per_m": 1e4, "derivative_filter_s": 1e-4} | gains
    content = {"sample_time_s": 5e-4, "reference_delay_samples": 2, "n_ff": [1.0], "d_ff": [0.0], "pid": pid}
    path = folder / "controller.json"
    path.write_text(json.dumps({**content, "friction_compensation": None}), encoding="utf-8")
    return path


def run(name: str, machine: Path, *options: str) -> int:
    """The exit status of a quick study."""
    output = str(machine.parent / "out")
    return main(every()[name], ["--machine", str(machine), "--quick", "--no-report", "--output", output, *options])


def assert_refused(captured: CaptureResult[str], says: str) -> None:
    """One line on stderr, and none of progress before it."""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    assert says in captured.err
    assert captured.out == ""


@pytest.mark.parametrize("name", STUDIES)
@pytest.mark.parametrize(("change", "says"), REFUSED, ids=[new for (_, new), _ in REFUSED])
def test_a_machine_on_which_nothing_can_be_designed_is_refused_by_every_study(
    name: str, change: tuple[str, str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(name, machine_file(tmp_path, *change)) == BAD_INPUT
    assert_refused(capsys.readouterr(), says)


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        (
            "identify_machine",
            ('stroke = { value = "20 um"', 'stroke = { value = "20 mm"'),
            "a stroke of 20 mm cannot settle",
        ),
        ("gap_diagnosis", ('"150 N"', '"30 N"'), "its loop cannot follow them within drive.rated_thrust, 30 N"),
    ],
)
def test_what_a_study_would_have_to_simulate_for_itself_is_refused(
    name: str, change: tuple[str, str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Others may work on such a machine, and this study on its records."""
    assert run(name, machine_file(tmp_path, *change)) == BAD_INPUT
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("error: --machine: ")
    assert says in lines[-1]
    assert all(line.startswith("[") for line in lines[:-1])  # progress, which has no end of line on a terminal


def test_friction_of_one_element_has_no_two_regions_to_vary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = machine_file(tmp_path, r"(?ms)^\[presliding\].*?(?=^\[)", "")
    one = {"limit": "97.518 um", "stiffness": "169.2 N/mm", "damping": "0 N s/m"}
    text = machine.read_text(encoding="utf-8")
    for name, size in one.items():
        text, count = re.subn(rf"(?m)^{name} = {{ value = \[[^]]*\]", f'{name} = {{ value = ["{size}"]', text)
        assert count == 1
    machine.write_text(text, encoding="utf-8")
    assert run("response_variation", machine) == BAD_INPUT
    assert_refused(capsys.readouterr(), "friction has 1 element")


@pytest.mark.parametrize("name", STUDIES)
@pytest.mark.parametrize(("change", "says"), NOT_LOADED, ids=[new for (_, new), _ in NOT_LOADED])
def test_a_machine_that_is_none_is_refused_by_every_study(
    name: str, change: tuple[str, str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(name, machine_file(tmp_path, *change)) == BAD_INPUT
    assert_refused(capsys.readouterr(), says)


@pytest.mark.parametrize("gains", [{"kp_N_per_m": 1.7e9}, {"kp_N_per_m": float("nan")}])
@pytest.mark.parametrize("name", STUDIES)
def test_a_controller_that_no_loop_can_have_is_refused_by_every_study(
    name: str, gains: dict[str, float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    controller = controller_file(tmp_path, gains)
    assert run(name, machine_file(tmp_path, "name", "name"), "--controller", str(controller)) == BAD_INPUT
    assert_refused(capsys.readouterr(), "")


def test_a_trial_of_tables_with_an_unstable_loop_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sealed = Path(studies.blind_trial.__file__).parent / "sealer" / "nominal.json"
    nominal = json.loads(sealed.read_text(encoding="utf-8"))
    nominal["dead_time_s"] = 25e-3
    pack = tmp_path / "pack"
    pack.mkdir()
    (pack / "nominal.json").write_text(json.dumps(nominal), encoding="utf-8")
    options = ["--pack", str(pack), "--no-report", "--output", str(tmp_path / "out")]
    assert main(every()["blind_trial"], options) == BAD_INPUT
    assert_refused(capsys.readouterr(), "--pack: " + UNSTABLE)


def test_what_is_told_to_be_allowed_is_allowed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stroke of exactly ten times the presliding reach is within its limit, whatever the rounding."""
    text = re.sub(r"(?s)\[presliding\].*?(?=\[friction\])", "", TEXT)
    for name, value in (("stiffness", "1 N/mm"), ("limit", "1 um"), ("damping", "0 N s/m")):
        text = re.sub(rf"(?m)^{name} = {{ value = \[.*$", f'{name} = {{ value = ["{value}"] }}', text)
    machine = tmp_path / "axis.toml"
    machine.write_text(text, encoding="utf-8")
    assert run("trajectory_optimisation", machine, "--thrust-limit", "1 mN") == BAD_INPUT  # which is asked for next
    assert "history" not in capsys.readouterr().err


@pytest.mark.parametrize("change", ANSWERED, ids=[new for _, new in ANSWERED])
def test_a_machine_at_an_edge_is_answered(change: tuple[str, str], tmp_path: Path) -> None:
    assert run("deadbeat_design", machine_file(tmp_path, *change)) in {DONE, CHECK_MISSED}


def test_another_machine_is_not_held_to_be_as_slow_as_the_published_one(tmp_path: Path) -> None:
    """The paper's figures are to be reproduced on the paper's table only."""
    machine = machine_file(tmp_path, '"0.022353 1/kg"', '"0.0225 1/kg"')
    assert run("deadbeat_design", machine) in {DONE, CHECK_MISSED}
    results = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert [row["agrees"] for row in results["paper"]] == [None] * 4


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
    controller, machine = controller_file(tmp_path, gains), machine_file(tmp_path, "name", "name")
    assert run("deadbeat_design", machine, "--controller", str(controller)) == BAD_INPUT
    assert says in capsys.readouterr().err
