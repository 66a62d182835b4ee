"""The main job as its user meets it: a folder with everything in it, or one line that says what to do."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from design.controller import bare_controller, design_deadbeat
from models.controller import load
from models.machine import DEFAULT
from models.machine import load as machine_of
from models.machines.consistency import MAX_SETTLING_SAMPLES
from studies.command import CHECK_MISSED, DONE, main
from studies.deadbeat_design.__main__ import STUDY
from studies.deadbeat_design.compute import _counts, _proof, _reference_delay, _told
from studies.deadbeat_design.effects import by_place_rows
from studies.deadbeat_design.moves import long_moves
from studies.deadbeat_design.options import DeadbeatOptions
from studies.deadbeat_design.outcomes import RESIDUAL_LIMIT
from studies.options import BadInputError

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(quick_run: Callable[[str], tuple[Path, int]]) -> Path:
    """What one quick run wrote."""
    output, status = quick_run("deadbeat_design")
    assert status == DONE
    return output


def read(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text(encoding="utf-8"))


def test_everything_is_written(folder: Path) -> None:
    names = {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}
    assert names >= {"report.html", "report.pdf", "results.json", "manifest.json", "controller.json", "machine.toml"}
    assert sum(name.startswith("figures/") for name in names) == 9
    assert set(read(folder, "manifest.json")["outputs"]) == names - {"manifest.json"}


def test_results_have_the_agreed_form_and_every_check_holds(folder: Path) -> None:
    whole = read(folder, "results.json")
    assert whole["study"] == "deadbeat_design"
    for check in whole["checks"]:
        assert set(check) >= {"name", "value", "unit", "limit", "source", "holds"}
        assert check["holds"] is ((check["value"] <= check["limit"]) == (check["sense"] == "<="))
        assert check["holds"] is True, check["name"]
    names = " ".join(check["name"] for check in whole["checks"])
    for part in ("remains after", "settling with compensation, positive", "peak of u_M"):
        assert part in names


def test_a_published_figure_that_is_missed_for_the_better_is_a_miss(folder: Path) -> None:
    """The paper's 2.4 um: a quarter of it is no reproduction; and it is no check of the design, whose status is 0."""
    whole = read(folder, "results.json")
    rows = {row["name"]: row for row in whole["results"]["paper"]}
    agrees = {name: row["agrees"] for name, row in rows.items()}
    assert agrees == {
        "settling of the reversal, without compensation": True,
        "settling of the reversal, with compensation, at most": True,
        "3 sigma after the settling time, without compensation": True,
        "3 sigma after the settling time, with compensation": False,
    }
    assert -0.8 < rows["3 sigma after the settling time, with compensation"]["difference"] < -0.7
    for row in rows.values():
        if row["tolerance"] is not None:
            assert row["agrees"] is (abs(row["here"] / row["paper"] - 1) <= row["tolerance"])
    assert not any("published" in check["source"] for check in whole["checks"])
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "1 of 3 published figures is missed" in page


def test_a_missed_figure_is_printed_and_one_of_another_machine_is_not_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table of another rating is no reproduction of the paper's, though its file still quotes the paper's figures;
    nor is another stroke on the paper's table."""
    machine = tmp_path / "other.toml"
    text = DEFAULT.read_text(encoding="utf-8")
    machine.write_text(text.replace('"150 N"', '"160 N"', 1), encoding="utf-8")
    quick = ["--quick", "--no-report", "--output", str(tmp_path / "out")]
    assert main(STUDY, quick) == DONE
    assert "MISSED published figure, 3 sigma after the settling time, with comp" in capsys.readouterr().out
    for other in (("--machine", str(machine)), ("--stroke", "10 um")):
        assert main(STUDY, [*quick, *other]) == DONE
        assert "published figure" not in capsys.readouterr().out
        assert {row["agrees"] for row in read(tmp_path / "out", "results.json")["results"]["paper"]} == {None}


def test_the_reversal_is_late_without_compensation_and_nothing_is_with_it(folder: Path) -> None:
    results = read(folder, "results.json")["results"]
    positive = [m for m in results["without"]["motions"] if m["target_m"] > m["origin_m"]]
    assert len(positive) == 5
    inching = max(m["settling_s"] for m in positive if not m["reversal"])
    assert next(m["settling_s"] for m in positive if m["reversal"]) > inching + 0.02
    assert all(m["settling_s"] <= 0.025 for m in results["with"]["motions"])


def test_anybodys_simulation_of_the_written_machine_comes_to_rest_on_the_target(folder: Path) -> None:
    """From results.json and controller.json alone, with scipy's discretisation of the companion forms."""
    machine, controller = read(folder, "results.json")["machine"], read(folder, "controller.json")
    ts, stroke = machine["sample_time_s"], controller["stroke_m"]
    thrust = np.cumsum(controller["d_ff"]) * stroke  # the step response of D_ff
    thrust = np.concatenate([thrust, np.zeros(400)])
    position = np.zeros(thrust.size)
    for mode in machine["plant"]["modes"]:
        w, zeta = 2 * np.pi * mode["frequency_Hz"], mode["damping"]
        a, b = np.array([[0, 1], [-(w**2), -2 * zeta * w]]), np.array([[0], [mode["gain_per_kg"]]])
        model = cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), ts)
        position += dlsim(model, thrust)[1][:, 0]
    settled = len(controller["d_ff"]) - 1
    assert settled * ts == pytest.approx(controller["settling_time_s"])
    assert np.max(np.abs(position[settled:] / stroke - 1)) < 1e-9


def test_the_controller_file_has_the_agreed_form(folder: Path) -> None:
    controller = read(folder, "controller.json")
    assert set(controller) == {
        *("sample_time_s", "stroke_m", "settling_time_s", "n_ff", "d_ff"),
        *("reference_delay_samples", "pid", "friction_compensation", "wipe"),
        *("thrust_limit_N", "scale_resolution_m", "start", "compensator_path_ff", "long_moves"),
    }
    moves = controller["long_moves"]
    assert [one["stroke_m"] for one in moves["moves"]] == [1e-3, 5e-3, 20e-3]
    assert controller["stroke_m"] < moves["largest_step_m"] < 1e-3
    assert controller["wipe"]["distance_m"] > 2 * max(controller["friction_compensation"]["limit_m"])
    assert set(controller["pid"]) == {"kp_N_per_m", "ki_N_per_ms", "kd_Ns_per_m", "derivative_filter_s"}
    assert len(controller["friction_compensation"]["limit_m"]) == 5


def test_the_report_answers_the_question_and_says_that_it_was_quick(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "all 7 checks hold" in page
    assert "the friction is assumed" not in page
    assert "This is a quick run" in page
    assert "<math" in page
    assert "(compare Fig. 8 of the paper)" in page
    assert re.search(r"\de[-+]\d", re.sub(r'"[^"]*"', "", page)) is None, "an exponent as a program prints it"


def test_the_manifest_holds_what_the_results_follow_from(folder: Path) -> None:
    manifest = read(folder, "manifest.json")
    assert manifest["options"]["seed"] == 0
    assert manifest["options"]["quick"] is True
    assert {"casadi", "numpy", "python", "osqp"} <= set(manifest["versions"])
    assert len(manifest["inputs"]["source"]["sha256"]) == 64
    results = read(folder, "results.json")
    for keys in manifest["figures"].values():
        for key in keys:
            part = results
            for name in key.split("."):
                part = part[name]


def test_two_runs_in_two_processes_write_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "studies.deadbeat_design", "--quick", "--output", str(tmp_path / "again")]
    environment = {**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)
    for name in (*read(folder, "manifest.json")["outputs"], "manifest.json"):
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_a_missed_check_is_exit_status_1_and_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A tolerance of the scale's step cannot be held."""
    text = DEFAULT.read_text(encoding="utf-8").replace('tolerance = { value = "2 um"', 'tolerance = { value = "0.1 um"')
    machine = tmp_path / "strict.toml"
    machine.write_text(text, encoding="utf-8")
    arguments = ["--quick", "--no-report", "--machine", str(machine), "--output", str(tmp_path / "out")]
    assert main(STUDY, arguments) == CHECK_MISSED
    assert "MISSED settling with compensation" in capsys.readouterr().out
    assert any(check["holds"] is False for check in read(tmp_path / "out", "results.json")["checks"])


def test_an_own_machine_without_published_outcomes(tmp_path: Path) -> None:
    """No paper beside it, no facts of the curve, one mode less, another sample time and a delay within the sample."""
    text = DEFAULT.read_text(encoding="utf-8")
    for table in ("[presliding]", "[published]"):
        before, _, rest = text.partition(table)
        text = before + rest[rest.find("\n[") :] if "\n[" in rest else before
    before, _, rest = text.partition("[[plant.modes]] # the table with its flexible load")
    text = before + rest[rest.find("\n[") :]
    text = re.sub(r'(dead_time = { value =) "[^"]*"', r'\1 "0.6 ms"', text.replace('"500 us"', '"250 us"'))
    machine = tmp_path / "own.toml"
    machine.write_text(text, encoding="utf-8")
    main(STUDY, ["--quick", "--machine", str(machine), "--output", str(tmp_path / "out")])
    results = read(tmp_path / "out", "results.json")
    assert results["machine"]["sample_time_s"] == 2.5e-4
    assert results["checks"][0]["holds"] is True
    assert results["results"]["paper"] == []
    assert "of the paper)" not in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "out" / "report.pdf").stat().st_size > 10_000


def test_a_shorter_time_and_another_stroke_are_designed_for(tmp_path: Path) -> None:
    options = [
        "--settling-time",
        "25 ms",
        "--stroke",
        "5 um",
        "--objective",
        "peak_thrust",
        "--monotone",
        "--no-report",
    ]
    assert main(STUDY, ["--quick", *options, "--output", str(tmp_path)]) in {DONE, CHECK_MISSED}
    controller = read(tmp_path, "controller.json")
    assert (controller["stroke_m"], controller["settling_time_s"]) == (5e-6, 25e-3)
    assert np.min(np.diff(np.cumsum(controller["n_ff"]))) > -1e-9


def test_long_moves_are_checked_where_asked_for_and_those_beyond_the_records_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A machine whose records went to 130 N and 0.05 m/s: enough for the motions of 20 um but for neither move."""
    machine = tmp_path / "small.toml"
    covered = '\n[covered]\nforce = { value = "130 N", source = "identified: moves.csv" }\nspeed = "0.05 m/s"\n'
    machine.write_text(DEFAULT.read_text(encoding="utf-8") + covered, encoding="utf-8")
    asked = ["--long-stroke", "2 mm", "--long-stroke", "4 mm"]
    arguments = ["--quick", "--no-report", "--machine", str(machine), "--output", str(tmp_path / "out"), *asked]
    assert main(STUDY, arguments) == DONE
    whole = read(tmp_path / "out", "results.json")
    names = [check["name"] for check in whole["checks"]]
    assert names[-2:] == ["settling behind the profile, move of 2 mm", "settling behind the profile, move of 4 mm"]
    assert {(one["design"], one["what"]) for one in whole["results"]["beyond"]} >= {
        ("move of 2 mm", "speed"),
        ("move of 4 mm", "speed"),
    }
    assert "WARNING, move of 4 mm" in capsys.readouterr().out


def test_a_move_longer_than_the_travel_is_refused(folder: Path) -> None:
    """And none of the usual ones is, where nobody asks for them."""
    table = machine_of()
    short = replace(table, drive=replace(table.drive, travel=5e-3))
    controller = load(folder / "controller.json")
    with pytest.raises(BadInputError, match="10 mm is more than the axis' travel of 5 mm"):
        long_moves(short, controller, DeadbeatOptions(long_stroke=(1e-3, 1e-2)))
    assert all(move.stroke <= 5e-3 for move in long_moves(short, controller, DeadbeatOptions()).moves)


def test_a_fast_axis_proves_its_rest_as_well_as_a_slow_one() -> None:
    """The paper's table 50 times as fast, as a galvo is: rounding had drifted for 0.2 s, 500 settling times."""
    table, faster = machine_of(), 50
    modes = [replace(mode, gain=faster**2 * mode.gain, frequency=faster * mode.frequency) for mode in table.plant.modes]
    plant = replace(table.plant, modes=tuple(modes), dead_time=table.plant.dead_time / faster)
    wanted = replace(
        table.specification,
        reference_settling_time=table.specification.reference_settling_time / faster,
        settling_time=table.specification.settling_time / faster,
    )
    galvo = replace(
        table, plant=plant, specification=wanted, control=replace(table.control, sample_time=table.sample_time / faster)
    )
    deadbeat = design_deadbeat(galvo)
    assert _proof(galvo.plant, deadbeat)["residual"] < 0.01 * RESIDUAL_LIMIT
    off = replace(deadbeat, thrust=deadbeat.thrust * (1 + 1e-7 * np.arange(deadbeat.thrust.size)))
    assert _proof(galvo.plant, off)["residual"] > RESIDUAL_LIMIT, "what is no deadbeat still fails"


def test_a_step_that_is_too_long_is_refused_with_the_way_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(STUDY, ["--quick", "--no-report", "--stroke", "1 mm", "--output", str(tmp_path)]) == 2
    assert "the shortest that can is" in (said := capsys.readouterr().err)
    assert "--long-stroke, which goes along a profile" in said


def test_the_pid_of_another_controller_is_taken(folder: Path, tmp_path: Path) -> None:
    other = read(folder, "controller.json")
    other["pid"]["ki_N_per_ms"] /= 2
    (tmp_path / "other.json").write_text(json.dumps(other), encoding="utf-8")
    arguments = [
        "--quick",
        "--no-report",
        "--controller",
        str(tmp_path / "other.json"),
        "--output",
        str(tmp_path / "out"),
    ]
    main(STUDY, arguments)
    assert read(tmp_path / "out", "controller.json")["pid"] == other["pid"]
    machine = read(tmp_path / "out", "results.json")["machine"]
    assert machine["control"]["pid"] == other["pid"]
    assert (tmp_path / "out" / "given_controller.json").is_file()
    slower = read(tmp_path / "out", "results.json")["results"]["without"]["motions"][0]["settling_s"]
    assert slower > read(folder, "results.json")["results"]["without"]["motions"][0]["settling_s"]


def test_files_of_an_earlier_run_make_way_and_those_of_others_stay(tmp_path: Path) -> None:
    arguments = ["--quick", "--no-report", "--output", str(tmp_path)]
    (tmp_path / "notes.txt").write_text("mine")
    assert main(STUDY, arguments) == DONE
    manifest = read(tmp_path, "manifest.json")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "stale.svg").write_text("old")
    manifest["outputs"]["figures/stale.svg"] = hashlib.sha256(b"old").hexdigest()
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert main(STUDY, arguments) == DONE
    assert not (tmp_path / "figures" / "stale.svg").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_help_names_units_and_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(STUDY, ["--help"])
    assert stop.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for part in ('"20 ms"', '"20 um"', "default", "133.5 N", "Exit status"):
        assert part in text


def test_a_machine_s_effects_are_met_and_shown_beside_the_controller_that_does_not_know_them(tmp_path: Path) -> None:
    """What gap_diagnosis writes: the nominal machine with named effects in it."""
    machine = tmp_path / "improved.toml"
    machine.write_text(DEFAULT.read_text(encoding="utf-8") + EFFECTS, encoding="utf-8")
    assert main(STUDY, ["--quick", "--machine", str(machine), "--output", str(tmp_path / "out")]) == DONE
    found = read(tmp_path / "out", "results.json")["results"]["effects"]
    bare, with_rfm, knowing = found["rows"]
    assert found["met"] == ["position_dependent_friction", "gain_asymmetry"]
    assert found["by_place"] == ["position_dependent_friction"]
    assert found["designed_for"] == ["additional_mode"]
    assert "calibrate" in found["left_out"]["scale_gain_error"]
    assert knowing["gap_m"] < 0.5 * with_rfm["gap_m"]
    assert knowing["dispersion_m"] < with_rfm["dispersion_m"] < bare["dispersion_m"]
    content = read(tmp_path / "out", "controller.json")
    assert content["effect_compensation"]["effects"]["gain_asymmetry"] == {"asymmetry": 0.03}
    assert load(tmp_path / "out" / "controller.json").effect_compensation is not None
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "scale gain error is not met" in page
    assert "with the RFM and the effects" in page


EFFECTS = """
[effects.position_dependent_friction]
part = { value = "0.1", source = "identified: gap_diagnosis" }
length = "20 mm"
phase = "1"

[[effects.gain_asymmetry]]
asymmetry = "0.03"

[effects.additional_mode]
gain = "0.001 1/kg"
frequency = "200 Hz"
damping = "0.02"

[effects.scale_gain_error]
error = "100e-6"
"""


def test_where_motions_have_to_begin_for_their_plan_is_told() -> None:
    """A user's moves of 5 degrees that were said to settle in 47 ms took 47.5 ms from 0, and 73 to over 108 ms from 30
    to 36 degrees, 48 and 60 ms without the plan there: it had the cogging and the weight at 0."""
    (row,) = by_place_rows({"effects": {"by_place": ["cogging.1", "cogging.2", "gravity"]}})
    assert row[0] == "WARNING, plan of effects that go by the place"
    assert "from elsewhere cogging and gravity pull otherwise, so that it may do harm" in row[1]
    assert by_place_rows({"effects": {"by_place": []}}) == by_place_rows({}) == []


def test_a_reference_delay_other_than_that_in_place_is_told() -> None:
    """The drive has to be set to it: kept at the old one, x_T* comes at another time than the feedforward."""
    machine = machine_of(DEFAULT)
    controller = bare_controller(machine)
    assert _reference_delay(machine, controller) == []
    other = replace(machine, control=replace(machine.control, reference_delay=machine.control.reference_delay + 1))
    ((name, told),) = _reference_delay(other, controller)
    assert name.startswith("WARNING, reference delay")
    assert told == "2 samples, where the one in place has 3: set it"


@pytest.mark.parametrize(
    ("profile", "settling", "without", "told"),
    [
        (0.099, 0.014, 0.002, ("5 mm along a profile", "99 ms, settles 14 ms after it")),
        (0.099, 0.074, 0.07, ("5 mm along a profile", "99 ms, settles 74 ms after it, later than 25 ms")),
        (
            0.099,
            0.58,
            0.1,
            (
                "5 mm along a profile",
                "99 ms, settles 580 ms after it, later than 25 ms, and 100 ms after it without friction compensation",
            ),
        ),
        (0.099, float("inf"), float("inf"), ("5 mm along a profile", "99 ms, does not settle within 200 ms after it")),
        (0.0005, 0.014, 0.02, ("5 mm in one step", "settles 14 ms after it")),
    ],
)
def test_a_long_move_is_told_with_its_profile_or_as_a_step(
    profile: float, settling: float, without: float, told: tuple[str, str]
) -> None:
    row = {"stroke_m": 5e-3, "profile_s": profile, "settling_s": settling, "watched_s": 0.2}
    row |= {"without_settling_s": without}
    assert _told(row, machine_of(DEFAULT)) == told


def test_the_trade_off_ends_where_a_deadbeat_is_designed() -> None:
    """Of 30 ms at 50 us it went on to 60 ms, 1200 samples, of which the synthesis refuses to make one."""
    machine = replace(machine_of(), control=replace(machine_of().control, sample_time=50e-6))
    counts = _counts(machine, {"settling_time_s": 30e-3}, quick=True)
    assert counts[0] == 300
    assert 900 < max(counts) <= MAX_SETTLING_SAMPLES
