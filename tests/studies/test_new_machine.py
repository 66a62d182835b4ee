"""Ten answers give a machine file that runs, whatever the size of the axis."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.machine import load, parameters
from studies.deadbeat_design.__main__ import STUDY
from studies.new_machine.__main__ import main
from studies.new_machine.answers import ANSWERS

TEN = [one.name for one in ANSWERS]
AXES = {
    "20 g": ("20 g", "2 N", "50 mm/s", "50 us", "1 nm", "1 um", "20 nm", "4 ms", "50 mN", "2 um"),
    "12 kg": ("12 kg", "200 N", "1 m/s", "250 us", "10 nm", "50 um", "1 um", "20 ms", "10 N", "50 um"),
    "3 t": ("3 t", "20 kN", "0.5 m/s", "4 ms", "1 um", "5 mm", "50 um", "400 ms", "900 N", "1 mm"),
}


def command(file: Path, answers: dict[str, str], *more: str) -> list[str]:
    """The command line that gives these answers."""
    given = [word for name, text in answers.items() for word in (f"--{name.replace('_', '-')}", text)]
    return [str(file), *given, *more]


def middle(**changed: str) -> dict[str, str]:
    """The answers for the axis of 12 kg, some of them changed."""
    return dict(zip(TEN, AXES["12 kg"], strict=True)) | changed


@pytest.mark.parametrize("axis", AXES)
def test_a_file_from_ten_answers_meets_its_specification_as_it_stands(axis: str, tmp_path: Path) -> None:
    file = tmp_path / "axis.toml"
    assert main(command(file, dict(zip(TEN, AXES[axis], strict=True)))) == 0
    answer = STUDY(file, quick=True)
    assert [check.name for check in answer.checks if not check.holds] == []
    assert "identify it from slow loops" in dict(answer.summary)["WARNING, friction"]


def test_what_to_do_next_is_to_know_the_axis_or_to_design(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "axis.toml"
    assert main(command(file, middle())) == 0
    told = capsys.readouterr().out.splitlines()
    assert any(f"identify_machine --machine {file} --write-references" in line for line in told)
    assert any(f"deadbeat_design --machine {file}" in line for line in told)


def test_the_file_holds_the_answers_and_says_of_every_value_where_it_is_from(tmp_path: Path) -> None:
    file = tmp_path / "axis.toml"
    assert main(command(file, middle(), "--dead-time", "300 us", "--offset", "-60 N", "--travel", "40 mm")) == 0
    machine = load(file)
    assert machine.plant.mass == pytest.approx(12, rel=1e-5)
    assert machine.friction.coulomb_force == pytest.approx(10, rel=1e-5)
    assert max(machine.friction.limit) == pytest.approx(50e-6)
    assert machine.plant.dead_time == 300e-6
    assert machine.drive.offset == -60
    assert machine.drive.travel == 40e-3
    kinds = {one.name: one.provenance.kind for one in parameters(machine)}
    assert set(kinds.values()) == {"given", "derived", "assumed"}
    assert all(one.provenance.detail for one in parameters(machine))
    assert machine.control.compensator_elements == "auto"
    assert "chosen by the study" in machine.sources["control.compensator_elements"].detail
    assert machine.tolerance.offset == pytest.approx(machine.drive.rated_thrust / 750, rel=1e-5)
    assert machine.tolerance.dead_time == pytest.approx(0.04 * machine.sample_time)
    assert kinds["tolerance.offset"] == kinds["tolerance.dead_time"] == "assumed"
    wanted = machine.specification
    assert (wanted.stroke, wanted.tolerance, wanted.settling_time) == (50e-6, 1e-6, 20e-3)
    for name in ("drive.rated_thrust", "plant.dead_time", "control.sample_time", "specification.settling_time"):
        assert kinds[name] == "given", name


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ({"mass": "3 N"}, "--mass: '3 N' is in N"),
        ({"mass": "-1 kg"}, "--mass: '-1 kg' must be above 0"),
        ({"friction_force": "0 N"}, "above 0; for an axis without friction, as on an air bearing, give one far below"),
        ({"offset": "3 N m"}, "and --offset of a rotary one; give all in"),
        ({"settling_time": "1 ms"}, "--settling-time: 1 ms are too few samples of 250 µs"),
        ({"friction_force": "300 N"}, "friction takes 300 N, all of the rated 200 N"),
        ({"stroke": "50 mm"}, "--settling-time, --stroke, --rated-thrust: "),
        ({"resolution": "5 um"}, "scale.resolution: 5 µm is above specification.tolerance"),
    ],
)
def test_answers_that_cannot_be_are_said_and_nothing_is_written(
    answers: dict[str, str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "axis.toml"
    assert main(command(file, middle(**answers))) == 2
    assert said in capsys.readouterr().err
    assert not file.exists()


def test_the_least_settling_time_that_is_proposed_is_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, weak = tmp_path / "axis.toml", middle(stroke="1.5 um", settling_time="1 ms")
    assert main(command(file, weak)) == 2
    proposed = capsys.readouterr().err.partition("give at least ")[2].partition(",")[0]
    assert main(command(file, weak | {"settling_time": proposed})) == 0


def test_all_answers_that_are_missing_are_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "axis.toml"), "--mass", "12 kg"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: 9 answers are missing")
    assert said.count("\n") == 1
    assert all(one.option in said for one in ANSWERS if one.name != "mass")


def test_a_file_that_exists_is_replaced_only_when_asked_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "axis.toml"
    file.write_text("mine", encoding="utf-8")
    assert main(command(file, middle())) == 2
    assert "exists; give another name, or --overwrite" in capsys.readouterr().err
    assert file.read_text(encoding="utf-8") == "mine"
    assert main(command(file, middle(), "--overwrite")) == 0
    assert load(file).name == "axis"


def test_a_name_that_is_no_machine_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(command(tmp_path / "axis.csv", middle())) == 2
    assert "ends in .toml" in capsys.readouterr().err
