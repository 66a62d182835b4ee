"""The study as a command: what it writes, what it refuses, and that a wrong controller is named, not refused."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.machine import Machine, load, to_json, with_pid
from models.machine_file import to_toml
from models.records.files import load as load_record
from models.records.files import read
from models.records.record import Record
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, main
from studies.deadbeat_design.__main__ import STUDY as DEADBEAT_DESIGN
from studies.gap_diagnosis.__main__ import STUDY
from studies.gap_diagnosis.compute import CLOSED
from studies.gap_diagnosis.own_records import Made, _schedules, made
from studies.review.follows import review
from studies.study import Progress, machine_of

ROOT = Path(__file__).parents[3]
VERDICT = {"outcome", "effects", "equivalent", "unexplained_fraction", "not_identifiable", "next_experiment"}
WHERE = {"by_motion", "by_phase", "by_band_Hz", "by_coordinate", "statements"}
WHICH = {"effect", "parameters", "held_out_gain", "threshold", "probability", "adequate"}
FAR = {"gap_as_delivered", "gap_refitted", "gap_after", "floor", "closure", "closure_interval", "held_out"}


@pytest.fixture(scope="module")
def own() -> Made:
    """The records that a quick run makes, of seed 0."""
    return made(load(), 0, quick=True)


@pytest.mark.parametrize("travel", [0.0, 5e-3])
@pytest.mark.parametrize("times", [1.0, 1000.0])
def test_quick_records_go_as_far_as_the_axis_is_for(times: float, travel: float) -> None:
    """Of a table with the paper's stroke and of one with a thousand times that, within what both may travel."""
    machine = load()
    wanted = replace(machine.specification, stroke=times * machine.specification.stroke)
    drive = replace(machine.drive, travel=max(1.0, times) * travel)
    (planned,) = _schedules(replace(machine, specification=wanted, drive=drive), quick=True)
    span, room = float(np.ptp(planned.given.position)), drive.travel or np.inf
    assert 4 * wanted.stroke < span <= min(1001 * wanted.stroke, room)
    assert planned.target.size * machine.sample_time < 20


def write(record: Record, path: Path) -> Path:
    """The record in the agreed format."""
    time = record.sample_time * np.arange(record.position.size)
    rows = np.column_stack([time, record.target, record.reference, record.feedforward, record.command, record.position])
    head = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.17g")
    return path


def run(folder: Path, records: Sequence[Record], machine: Machine, *options: str) -> int:
    """The exit status of a run on these records without a report."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [str(write(record, folder / f"record-{i}.csv")) for i, record in enumerate(records)]
    path = folder / "machine.toml"
    path.write_text(to_toml(machine), encoding="utf-8")
    return main(STUDY, [*files, "--machine", str(path), "--no-report", "--output", str(folder / "out"), *options])


def error_of(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    errors = [line for line in captured.err.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert captured.out == ""
    return errors[0]


def test_the_results_have_the_agreed_keys(results: dict[str, Any]) -> None:
    assert set(results["verdict"]) >= VERDICT
    assert set(results["where"]) >= WHERE
    assert all(set(row) >= WHICH for row in results["which"])
    assert set(results["how_far"]) >= FAR
    for gap in ("gap_as_delivered", "gap_refitted", "gap_after", "floor"):
        assert set(results["how_far"][gap]) == {"force_N", "position_m", "settling_s"}


def test_the_effect_that_was_put_in_is_named_and_closes_the_gap(quick: Path, results: dict[str, Any]) -> None:
    """The study's own records hold one effect, strong enough to be found in the short ones of a quick run as well."""
    assert results["verdict"]["outcome"] == "attributed"
    assert results["verdict"]["effects"] == [results["truth"]["effect"]]
    assert results["how_far"]["closure"] > CLOSED
    checks = json.loads((quick / "results.json").read_text(encoding="utf-8"))["checks"]
    assert [check["value"] for check in checks] == [1.0, results["how_far"]["closure"]]


def test_the_report_is_there_with_its_figures(quick: Path) -> None:
    names = {path.name for path in quick.rglob("*")}
    assert names >= {"report.html", "report.pdf", "improved.toml", "results.json", "manifest.json", "machine.toml"}
    figures = {path.stem for path in (quick / "figures").glob("*.svg")}
    assert figures >= {"waterfall", "force", "courses", "maps", "coordinates", "spectra", "gains", "confusable"}
    page = (quick / "report.html").read_text(encoding="utf-8")
    assert "Long motions count as several of about 1.5\u00a0s each." in page  # at the default machine's loop
    for sentence in json.loads((quick / "results.json").read_text(encoding="utf-8"))["results"]["where"]["statements"]:
        assert sentence.split("(")[0].replace("'", "’").replace("&", "&amp;").strip() in page.replace("\n", " ")


def test_the_improved_machine_can_be_loaded_and_has_the_named_effects(quick: Path, results: dict[str, Any]) -> None:
    machine = load(quick / "improved.toml")
    assert machine.sources["drive.offset"].kind == "identified"
    assert [effect.name for effect in machine.effects] == results["verdict"]["effects"] == [results["truth"]["effect"]]
    for name, effect in ((effect.name, effect) for effect in machine.effects):
        row = next(row for row in results["which"] if row["effect"] == name)
        for parameter, item in row["parameters"].items():
            assert getattr(effect, parameter) == pytest.approx(item["value"])
        assert machine.sources[f"effects.{name}.{next(iter(row['parameters']))}"].kind == "identified"


def test_the_improved_machine_goes_into_a_design(quick: Path, tmp_path: Path) -> None:
    """The one command more of the README; aims may be missed, they are not those of this table."""
    options = ["--machine", str(quick / "improved.toml"), "--quick", "--no-report", "--output", str(tmp_path)]
    assert main(DEADBEAT_DESIGN, options) in {DONE, CHECK_MISSED}
    named = {effect.name for effect in load(quick / "improved.toml").effects}
    machine = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["machine"]
    assert set(machine.get("effects", {})) == named


def test_the_improved_machine_leaves_nothing_to_name(own: Made, quick: Path, tmp_path: Path) -> None:
    assert run(tmp_path, own.records, load(quick / "improved.toml")) == DONE
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert found["verdict"]["outcome"] in {"nothing_to_explain", "parameters"}
    assert found["how_far"]["gap_as_delivered"]["force_N"] < 0.2


def test_what_to_record_is_written_where_no_record_is_given(quick: Path, own: Made) -> None:
    table = read(quick / "suite.csv")
    assert list(table) == ["time_s", "target_m", "reference_m", "feedforward_N"]
    assert np.allclose(np.diff(table["time_s"]), own.machine.sample_time)
    assert np.ptp(table["reference_m"]) == pytest.approx(60e-3)
    assert np.max(np.abs(table["feedforward_N"])) < own.machine.drive.rated_thrust
    assert table["reference_m"][0] == table["reference_m"][-1] == 0


def test_a_report_can_be_reviewed(quick: Path) -> None:
    found = review(quick, 1e-6, Progress())
    assert found.follows


def test_records_given_as_files_give_the_answer_of_those_simulated(
    own: Made, tmp_path: Path, results: dict[str, Any]
) -> None:
    status = run(tmp_path, own.records, own.machine)
    assert status == DONE
    again = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert again["verdict"]["effects"] == results["verdict"]["effects"]
    assert again["verdict"]["outcome"] == results["verdict"]["outcome"]
    assert again["truth"] is None
    assert [record["motions"] for record in again["records"]] == [record["motions"] for record in results["records"]]


def test_a_controller_that_does_not_replay_is_named_and_the_run_goes_on(own: Made, tmp_path: Path) -> None:
    pid = replace(load().control.pid, ki=1.25 * load().control.pid.ki)
    assert run(tmp_path, made(with_pid(load(), pid, "test"), 0, quick=True).records, own.machine) == DONE
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert "controller_mismatch" in found["verdict"]["effects"]
    assert "did not make the record" in found["where"]["statements"][0]
    assert found["where"]["details"]["controller"][0]["would_fit"].endswith("times 1, 1.25 and 1")
    assert "did not make the record" in found["answer"]["where"]


def test_a_log_that_is_late_is_said_with_its_shift(own: Made, tmp_path: Path) -> None:
    part = own.records[0].part(0, own.records[0].position.size // 2)
    late = replace(part, command=np.roll(part.command, 1))
    assert run(tmp_path, [late], own.machine) == DONE
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert re.search(r"from sample 6\d on", found["answer"]["where"])
    assert "with the command logged 1 sample late" in found["answer"]["where"]
    assert found["how_far"]["adopted_file"] == "as delivered"  # whose dead time is the machine's
    assert "as happens with a measured torque or current" in found["answer"]["how_far"]
    assert not (tmp_path / "out" / "next_experiment.csv").exists()


def test_the_first_page_tells_no_switch_of_the_effect_that_was_put_in(quick: Path, results: dict[str, Any]) -> None:
    roles = {name: item["role"] for name, item in results["truth"]["parameters"].items()}
    page = re.sub(r"\s+", " ", (quick / "report.html").read_text(encoding="utf-8"))
    (told,) = re.findall(r"that the model lacks \(([^)]*)\)", page)
    assert "switch" in roles.values()
    assert [name for name in roles if name in told] == [name for name, role in roles.items() if role != "switch"]


def test_effects_can_be_disabled(own: Made, tmp_path: Path) -> None:
    status = run(tmp_path, own.records, own.machine, "--disable", "friction_relaxation", "--disable", "cogging")
    assert status == DONE
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    left = {row["effect"] for row in found["which"]} | set(found["confusability"]["names"])
    assert not {"friction_relaxation", "cogging"} & left


def test_an_unknown_effect_to_disable_is_refused_with_the_nearest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(STUDY, ["--disable", "friction_relaxion", "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert "did you mean friction_relaxation?" in error_of(capsys)


def test_what_can_not_be_diagnosed_is_one_line(own: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = own.records[0]
    draw = np.random.default_rng(0)
    still = np.full(3000, 1e-5) + 1e-7 * draw.integers(0, 2, 3000)
    nothing = np.zeros(3000)
    hold = Record(5e-4, nothing, nothing, nothing, 1e-3 * draw.standard_normal(3000), still)
    coarse = replace(whole, position=np.round(whole.position / 1e-6) * 1e-6)
    quick, slow = replace(whole, sample_time=3.5e-4), replace(whole, sample_time=1e-3)
    heavier = replace(whole, command=3 * whole.command)
    for records, says in (
        ([whole.part(0, 600)], "600 samples are too short"),
        ([whole.part(300, 1700)], "too few"),
        ([hold], "nothing moves"),
        ([quick], "is sampled every 350 µs, and the machine's controller runs every 500 µs"),
        ([slow], "has one of 2 samples of the controller, and its commands jump more than these show"),
        ([whole, coarse], "are of two machines: their scales"),
        ([whole, heavier], "are of two machines: their commands move"),
    ):
        folder = tmp_path / says.split()[-1]
        assert run(folder, records, own.machine) == BAD_INPUT, says
        assert says in error_of(capsys)
        assert not (folder / "out").exists()


def test_a_record_to_hold_out_is_not_fitted_to_as_well(
    own: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(own.records[0], tmp_path / "one.csv")
    for given, says in (([], "needs records to fit to"), ([str(path)], "is among the records that are fitted to")):
        assert main(STUDY, [*given, "--hold-out", str(path), "--output", str(tmp_path / "out")]) == BAD_INPUT
        assert says in error_of(capsys)


def test_what_is_too_long_or_jumps_is_refused_with_the_way_out(
    own: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = own.records[0]
    count = whole.position.size
    jumping = replace(whole, position=whole.position + np.where(np.arange(count) < 400, 0.0, 0.1))
    for records, options, says in (
        (
            [whole],
            ["--most-samples", f"{count - 1}"],
            f"holds more than {count - 1:,} samples, .* cut it .* or give",
        ),
        (
            [whole, whole],
            ["--most-samples", f"{count}"],
            f"hold more than {count:,} samples together; leave a record out, or give --most-samples ",
        ),
        ([jumping], [], r"jumps by 100 mm at 200 ms .* line 402 of a CSV.* if the record is right .* --trust-records"),
    ):
        assert run(tmp_path, records, own.machine, *options) == BAD_INPUT
        assert re.search(says, error_of(capsys))


def test_a_frequency_response_is_no_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "response.csv"
    rows = [f"{f},{1e-6 / f**2},-180" for f in range(1, 50)]
    path.write_text("frequency_Hz,magnitude_m_per_N,phase_deg\n" + "\n".join(rows) + "\n", encoding="utf-8")
    assert main(STUDY, [str(path), "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert "is a frequency response" in error_of(capsys)


def test_a_nominal_json_is_a_machine(tmp_path: Path) -> None:
    """The same machine as a nominal.json: its machine file beside the results is the machine that was used."""
    machine = load()
    content = {
        "sample_time_s": machine.sample_time,
        "dead_time_s": machine.plant.dead_time,
        "thrust_constant": machine.plant.thrust_constant,
        "modes": [
            {"gain_per_kg": mode.gain, "frequency_Hz": mode.frequency, "damping": mode.damping}
            for mode in machine.plant.modes
        ],
        "friction": {
            "stiffness_N_per_m": list(machine.friction.stiffness),
            "limit_m": list(machine.friction.limit),
        },
        "scale": {"resolution_m": machine.scale.resolution},
        "controller": {
            "kp_N_per_m": machine.control.pid.kp,
            "ki_N_per_ms": machine.control.pid.ki,
            "kd_Ns_per_m": machine.control.pid.kd,
            "derivative_filter_s": machine.control.pid.derivative_filter,
            "reference_delay_samples": machine.control.reference_delay,
        },
    }
    path = tmp_path / "nominal.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    found = machine_of(path)
    assert found.plant == machine.plant
    copy = tmp_path / "machine.toml"
    copy.write_text(to_toml(found), encoding="utf-8")
    assert to_json(load(copy)) == to_json(found)


def test_the_next_experiment_is_written_as_a_readable_record(quick: Path, results: dict[str, Any]) -> None:
    """Only where there is something left to find out is there a schedule, and then it is the one that is shown."""
    path = quick / "next_experiment.csv"
    assert path.exists() == (results["verdict"]["next_experiment"] is not None)
    if path.exists():
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        assert rows.shape[1] == 4
        assert rows[-1, 0] == pytest.approx(results["next"]["duration_s"], rel=1e-3)


def test_files_round_trip(own: Made, tmp_path: Path) -> None:
    again = load_record(write(own.records[0], tmp_path / "one.csv")).content
    assert isinstance(again, Record)
    assert np.max(np.abs(again.position - own.records[0].position)) < 1e-15
