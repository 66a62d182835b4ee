"""A rotary axis: the same numbers in rad, N m and kg m^2, from the machine file to what a study prints."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.effects.structure import Gravity
from models.machine import Machine, MachineError, from_table, load, parameters
from models.machine_file import to_toml
from models.records.columns import Columns
from models.records.files import load as load_record
from models.records.record import Record
from models.records.tables.sizes import RecordError
from models.simulation.simulator import simulate
from studies.deadbeat_design.__main__ import STUDY
from studies.new_machine.__main__ import main
from studies.options import BadInputError
from tests.studies.test_new_machine import TEN, command

ANSWERS = (
    "0.02 kg m^2", "5 N m", "600 rpm", "250 us", "2 urad", "2 deg", "0.02 deg", "60 ms", "0.2 N m", "0.05 deg",
)  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A machine file from ten answers in units of a rotary axis."""
    path = tmp_path_factory.mktemp("rotary") / "axis.toml"
    assert main(command(path, dict(zip(TEN, ANSWERS, strict=True)))) == 0
    return path


@pytest.fixture(scope="module")
def machine(file: Path) -> Machine:
    """The machine in it."""
    return load(file)


def test_its_file_says_so_and_is_read_and_written_in_its_units(machine: Machine) -> None:
    assert machine.axis == "rotary"
    assert machine.specification.stroke == pytest.approx(2 * np.pi / 180, rel=1e-15)
    assert machine.drive.rated_speed == pytest.approx(20 * np.pi, rel=1e-15)
    text = to_toml(machine)
    assert 'axis = "rotary"' in text
    assert "N m s/rad" in text
    assert from_table(tomllib.loads(text), Path("axis.toml")) == replace(machine)
    units = {one.name: one.unit for one in parameters(machine)}
    assert (units["specification.stroke"], units["control.pid.kp"]) == ("rad", "N m/rad")


def test_units_of_the_other_kind_are_refused(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    for old, new, said in (
        ('axis = "rotary"', "", 'is in units of a rotary axis; write axis = "rotary" above all tables'),
        ('"2 deg"', '"2 mm"', "specification.stroke: is in units of a linear axis"),
        ('axis = "rotary"', 'axis = "round"', 'must be "linear" or "rotary"'),
        ('["4.36332e-05 rad"', '["4.36332e-05 m"', "friction.limit: mixes m with rad"),
    ):
        assert old in text
        with pytest.raises(MachineError, match=said):
            from_table(tomllib.loads(text.replace(old, new)), file)
    mixed = dict(zip(TEN, ("12 kg", *ANSWERS[1:]), strict=True))
    assert main(command(file.with_name("mixed.toml"), mixed)) == 2
    assert not file.with_name("mixed.toml").exists()


def test_a_study_takes_and_prints_its_units(machine: Machine) -> None:
    with pytest.raises(BadInputError, match="--stroke: '2 mm' is not a size of this machine, whose axis is rotary"):
        STUDY(machine, stroke="2 mm")
    with pytest.raises(BadInputError, match="--stroke: '1 deg' is not a size of this machine, whose axis is linear"):
        STUDY(load(), stroke="1 deg")
    answer = STUDY(machine, quick=True, stroke="1 deg")
    assert {"N m", "s"} <= {check.unit for check in answer.checks}
    assert "m" not in {check.unit for check in answer.checks}
    assert all(check.holds for check in answer.checks)


def test_columns_in_degrees_and_newton_metres_are_those_of_a_rotary_axis(tmp_path: Path) -> None:
    t = np.arange(400) * 1e-3
    angle = 10 * np.sin(2 * np.pi * 2 * t) + 1e-4 * np.sin(900 * t)
    path = tmp_path / "log.csv"
    rows = np.column_stack([t, 0.3 * np.cos(12.6 * t), angle])
    np.savetxt(path, rows, delimiter=",", header="t [s],i [A],q [deg]", comments="")
    columns = Columns(time="t", command="i * 0.1 N m/A", position="q")
    record = load_record(path, columns, rotary=True).content
    assert isinstance(record, Record)
    np.testing.assert_allclose(record.position, np.deg2rad(angle), rtol=1e-6)
    np.testing.assert_allclose(record.command, 0.1 * rows[:, 1], rtol=1e-6)
    for table in (load_record(path, columns, rotary=True).recognised, load_record(path, columns).recognised):
        assert any(line.endswith("0.01745329252 rad") for line in table)
        assert any(line.endswith("0.1 N m") for line in table)
    with pytest.raises(RecordError, match="is in angles or N m, and the machine's axis is linear"):
        load_record(path, columns, rotary=False)
    with pytest.raises(RecordError, match="is in units of a linear axis, and the machine's axis is rotary"):
        load_record(path, replace(columns, position="q [mm]"), rotary=True)


def test_gravity_is_held_at_rest(machine: Machine) -> None:
    """By statics: at rest the drive holds A sin(x + phi), to what the friction takes."""
    size, phase = 2.0, 0.4
    table = {**tomllib.loads(to_toml(machine)), "effects": {"gravity": {"amplitude": "2 N m", "phase": phase}}}
    heavy = from_table(table, Path("axis.toml"))
    assert heavy.effects == (Gravity(size, phase),)
    target = 0.03 * np.clip(np.arange(3000) / 2000, 0.0, 1.0)
    run = simulate(heavy, heavy.feedback_only(), target).record
    held = size * np.sin(run.position[-1] + phase)
    assert abs(run.position[-1] - 0.03) < 1e-4
    assert abs(run.command[-1] - held) <= machine.friction.coulomb_force < 0.5 * held


def test_a_refusal_is_in_its_units(machine: Machine, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadInputError, match=r"a stroke of 34\.91 mrad .* within [\d.]+ N m \(it takes [\d.]+ N m\)"):
        STUDY(machine, settling_time=1e-3 + 3 * machine.sample_time)
    weak = dict(zip(TEN, ANSWERS, strict=True)) | {"rated_thrust": "0.25 N m"}
    assert main(command(file.with_name("weak.toml"), weak)) == 2
    said = capsys.readouterr().err
    assert "a stroke of 34.91 mrad" in said
    assert " N m" in said
    with pytest.raises(MachineError, match=r"motions of 34\.91 mrad"):
        from_table({**tomllib.loads(to_toml(machine)), "drive": {**_drive(machine), "travel": "1 mrad"}}, file)


def _drive(machine: Machine) -> dict[str, object]:
    """The drive's table in the machine's file."""
    drive: dict[str, object] = tomllib.loads(to_toml(machine))["drive"]
    return drive


def test_the_mirror_of_a_scanner_may_be_light(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mirror = (
        "3e-9 kg m^2", "0.01 N m", "100 rad/s", "20 us", "0.2 urad", "0.2 mrad", "10 urad", "1 ms", "1e-5 N m",
        "0.2 mrad",
    )  # fmt: skip
    path = file.with_name("mirror.toml")
    assert main(command(path, dict(zip(TEN, mirror, strict=True)))) == 0
    assert load(path).plant.mass == pytest.approx(3e-9, rel=1e-5)
    feather = dict(zip(TEN, ("3e-13 kg m^2", *mirror[1:]), strict=True))
    assert main(command(path.with_name("feather.toml"), feather)) == 2
    assert "an inertia of 3e-13 kg m^2" in capsys.readouterr().err
    assert all(check.holds for check in STUDY(path, quick=True).checks)
