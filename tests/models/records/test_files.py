"""Records of every format come in as they are; a wrong file of each kind gets its sentence."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow
import pytest
from numpy.typing import NDArray
from pyarrow.parquet import write_table
from scipy.io import savemat

from models.controller import PID, Controller
from models.machine import load as load_machine
from models.records.checks import derivative_of_error, quantisation, replay
from models.records.columns import Columns
from models.records.files import Loaded, load, read, with_columns
from models.records.record import Record, cut, feeding_sequence
from models.records.tables.sizes import RecordError
from models.simulation.simulator import simulate

Array = NDArray[np.float64]
Table = dict[str, Array]

MACHINE = load_machine()
WITHHELD = Path(__file__).parents[4] / "shared" / "withheld"


@pytest.fixture(scope="module")
def record() -> Record:
    """A simulated record of six motions with a smooth feedforward of 10 ms."""
    n_ff = np.hanning(22)[1:-1] / np.sum(np.hanning(22))
    d_ff = np.diff(n_ff, prepend=0.0, append=0.0) * 1e5
    control = MACHINE.control
    controller = Controller(MACHINE.sample_time, control.pid, control.reference_delay, tuple(n_ff), tuple(d_ff))
    return simulate(MACHINE, controller, feeding_sequence(20e-6, 3, 0.1, MACHINE.sample_time)).record


@pytest.fixture(scope="module")
def table(record: Record) -> Table:
    """The record as columns under the standard names."""
    names = {name: name for name in ("target", "reference", "feedforward", "command", "position")}
    columns = {getattr(Columns(), name): getattr(record, name) for name in names}
    return {"time_s": np.arange(record.position.size) * record.sample_time, **columns}


def test_a_reference_that_moves_by_rounding_alone_stands_still(tmp_path: Path, record: Record, table: Table) -> None:
    """A profile that was summed up in floating point: a motion of 1e-17 m was one of a type of its own."""
    moves, halts = cut(record), record.reference.copy()
    rests = np.flatnonzero((np.diff(halts, prepend=np.nan) == 0) & (np.diff(halts, append=np.nan) == 0) & (halts != 0))
    assert rests.size > 100
    halts[rests[50]] = np.nextafter(halts[rests[50]], 1.0)  # and back
    stops = np.flatnonzero((np.diff(halts, prepend=halts[0]) != 0) & (np.diff(halts, append=halts[-1]) == 0))
    halts[stops[2] + 1] = np.nextafter(halts[stops[2]], -1.0)  # right behind a motion, and back
    end = int(np.flatnonzero(np.diff(halts[rests[90] :]))[0])
    halts[rests[90] :][: end + 1] = np.nextafter(halts[rests[90]], 1.0)  # and on from there
    assert np.count_nonzero(np.diff(halts)) > np.count_nonzero(np.diff(record.reference))
    read_ = load(csv(tmp_path / "r.csv", {**table, Columns().reference: halts})).content
    assert isinstance(read_, Record)
    np.testing.assert_array_equal(read_.reference, record.reference)
    assert cut(read_) == moves


def csv(path: Path, table: Table, delimiter: str = ",") -> Path:
    rows = np.column_stack(list(table.values()))
    text = delimiter.join(table) + "\n" + "\n".join(delimiter.join(map(repr, row)) for row in rows.tolist()) + "\n"
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text, encoding="utf-8")
    return path


def mat73(path: Path, table: Table) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in table.items():
            file[f"log/{name}"] = column[None]
    return with_head(path)


def with_head(path: Path) -> Path:
    """The HDF5 file with what MATLAB writes before it."""
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(bytes(content))
    return path


def parquet(path: Path, table: Table) -> Path:
    write_table(pyarrow.table(table), path)
    return path


def same(loaded: Loaded, record: Record) -> None:
    assert isinstance(loaded.content, Record)
    assert loaded.content.sample_time == pytest.approx(record.sample_time, rel=1e-9)
    for name in ("target", "reference", "feedforward", "command", "position"):
        np.testing.assert_array_equal(getattr(loaded.content, name), getattr(record, name), name)


@pytest.mark.parametrize(
    ("entry", "name", "factor"),
    [
        ("Axes[1].ActPos [mm]", "Axes[1].ActPos", 1e-3),
        ("Axes[1].ActPos", "Axes[1].ActPos", 1.0),
        ("a[2][3] [um] * -1", "a[2][3]", -1e-6),
        ("pos[2] [mm]", "pos[2]", 1e-3),
    ],
)
def test_a_column_with_an_index_in_brackets_is_mapped(entry: str, name: str, factor: float) -> None:
    source = Columns(position=entry).source("position")
    assert source.name == name
    assert source.factor == pytest.approx(factor)


def test_csv_plain_and_compressed(tmp_path: Path, table: Table, record: Record) -> None:
    plain, packed = load(csv(tmp_path / "a.csv", table)), load(csv(tmp_path / "a.csv.gz", table))
    same(plain, record)
    same(packed, record)
    same(load(csv(tmp_path / "b.csv", table, ";")), record)
    assert plain.sha256 != packed.sha256
    assert len(plain.sha256) == 64


def test_mat_of_both_versions_and_parquet(tmp_path: Path, table: Table, record: Record) -> None:
    savemat(tmp_path / "a.mat", table)
    same(load(tmp_path / "a.mat"), record)
    signals = ("time", "command", "position", "target", "reference", "feedforward")
    dotted = Columns(**{name: f"log.{getattr(Columns(), name)}" for name in signals})
    savemat(tmp_path / "s.mat", {"log": table})
    same(load(tmp_path / "s.mat", dotted), record)
    savemat(tmp_path / "m.mat", {"log": np.column_stack(list(table.values()))})
    numbered = [f"log:{i}" for i in range(1, len(table) + 1)]
    by_name = dict(zip(table, numbered, strict=True))
    same(load(tmp_path / "m.mat", Columns(**{one: by_name[getattr(Columns(), one)] for one in signals})), record)
    same(load(mat73(tmp_path / "h.mat", table), dotted), record)
    same(load(parquet(tmp_path / "a.parquet", table)), record)


def test_a_derivative_of_the_position_alone_replays(table: Table, record: Record, tmp_path: Path) -> None:
    """The same commands from a controller that differentiates the position and has the rest in no column."""
    control = MACHINE.control
    waits = np.concatenate([np.full(control.reference_delay, record.reference[0]), record.reference])
    keep = control.pid.derivative_filter / (control.pid.derivative_filter + record.sample_time)
    slope = np.zeros(record.position.size)
    for k in range(1, slope.size):
        slope[k] = keep * slope[k - 1] + (1 - keep) * (waits[k] - waits[k - 1]) / record.sample_time
    command = record.command - control.pid.kd * slope
    path = csv(tmp_path / "a.csv", {**table, "command_N": command})
    facts: dict[str, Any] = {"pid": control.pid, "reference_delay": control.reference_delay}
    assert any("does not reproduce" in text for text in load(path, **facts).findings)
    own = load(path, Columns(derivative="position"), **facts)
    assert not any("does not reproduce" in text for text in own.findings)
    assert isinstance(own.content, Record)
    law = derivative_of_error(own.content, control.pid, control.reference_delay)
    left = (command - replay(law, control.pid, control.reference_delay))[60:]
    assert np.ptp(left) < 1e-8
    with pytest.raises(ValueError, match="derivative: 'speed' is neither of error, position"):
        Columns(derivative="speed")


def test_other_names_units_factors_and_signs_are_mapped(tmp_path: Path, table: Table, record: Record) -> None:
    own = {"t": table["time_s"] * 1e3, "x": -table["position_m"] * 1e6, "u": table["command_N"] / 35.2}
    columns = Columns(time="t [ms]", position="x [um] * -1", command="u [V] * 35.2 N/V")
    content = load(csv(tmp_path / "own.csv", own), columns).content
    assert isinstance(content, Record)
    np.testing.assert_allclose(content.position, record.position, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(content.command, record.command, rtol=1e-12)
    assert content.sample_time == pytest.approx(record.sample_time)


def test_an_axis_of_two_motors_and_two_encoders_is_their_sum_and_mean(
    tmp_path: Path, table: Table, record: Record
) -> None:
    """As on a gantry: the command is the sum of two, the position the mean; a count needs no unit of its own."""
    yaw, share = 3e-6 * np.sin(np.arange(record.position.size)), 0.3
    each = {"x1": (record.position + yaw) * 1e8, "x2 (um)": (record.position - yaw) * 1e6}
    forces = {"u1": share * record.command / 48, "u2": (1 - share) * record.command}
    path = csv(tmp_path / "gantry.csv", {"time_s": table["time_s"], **each, **forces})
    loaded = load(path, Columns(position="x1 [inc] * 5 nm + x2 * 0.5", command="u1 [A] * 48 N/A + u2 [N]"))
    assert isinstance(loaded.content, Record)
    np.testing.assert_allclose(loaded.content.position, record.position, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(loaded.content.command, record.command, rtol=1e-9)
    rows = [line.split() for line in loaded.recognised]
    assert ["position", "x1", "5e-09", "m"] in rows
    assert ["x2", "um", "5e-07", "m"] in rows
    whole = with_columns(loaded, path, Columns(position="x1 * 5 nm + x2 * 0.5", command="u1 * 48 N/A + u2"))
    assert isinstance(whole.content, Record)
    assert not {column.name for column in whole.content.columns} & {"x1", "x2", "u1", "u2"}
    with pytest.raises(RecordError, match="column 'x3' for the position is missing"):
        load(path, Columns(position="x1 * 5 nm + x3 * 5 nm", command="u2 [N]"))


def test_a_following_error_gives_the_reference_that_a_log_lacks(tmp_path: Path, table: Table, record: Record) -> None:
    """Many drives trace the actual position and the following error, and no demand; some with the other sign."""
    named = {name: column for name, column in table.items() if name not in {"reference_m", "target_m"}}
    path = tmp_path / "trace.csv"
    csv(path, {**named, "lag [um]": 1e6 * (record.position - record.reference)})
    loaded = load(path, Columns(error="lag * -1"))
    assert isinstance(loaded.content, Record)
    assert loaded.content.reference == pytest.approx(record.reference, abs=1e-12)
    assert "reference" in loaded.given
    (row,) = (line.split() for line in loaded.recognised if line.split()[0] == "error")
    assert row == ["error", "lag", "um", "-1e-06", "m"]
    both = tmp_path / "both.csv"
    csv(both, {**table, "error_m": np.zeros(record.position.size)})
    whole = load(both)
    assert isinstance(whole.content, Record)
    assert np.array_equal(whole.content.reference, record.reference)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"position": "x [kg]"}, "quantity in m"),
        ({"command": "u [V]"}, "quantity in N"),
        ({"command": "u [V] * big"}, "must be a number with a unit"),
        ({"phase": "p [m]"}, "must be an angle"),
        ({"position": "[mm]"}, "must be a column"),
        ({"position": "x1 [mm] + x2 [kg]"}, "quantity in m"),
        ({"time": "t1 [s] + t2 [s]"}, "time: must be one column; a sum can be target, reference, "),
    ],
)
def test_a_wrong_mapping_is_said(entry: dict[str, str], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Columns(**entry)


@pytest.mark.parametrize(
    ("entry", "stated", "factor"),
    [
        ("x", "mm", 1e-3),
        ("x * -1", "mm", -1e-3),
        ("x [um]", "mm", 1e-6),  # what the user says counts more than what the file says
        ("x * 5 nm", "counts", 5e-9),
        ("x [inc] * 5 [nm]", "inc", 5e-9),
        ("x_um * 1e-6", "um", 1e-6),  # the number is the unit's own, which is not counted twice
        ("x * 2", "um", 2e-6),
        ("x", "", 1.0),
    ],
)
def test_the_unit_that_a_file_states_counts_where_the_mapping_states_none(
    entry: str, stated: str, factor: float
) -> None:
    assert Columns(position=entry).source("position", stated).factor == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(
    ("entry", "stated", "factor"),
    [
        ("i * 31.5 N/A", "", 31.5),
        ("i * 31.5 N/A", "mA", 0.0315),
        ("i [mA] * 31.5 N/A", "A", 0.0315),
        ("i * 2 N", "A", 2),
        ("i * 16.3 N/%", "", 16.3),  # of the rated thrust
        ("i * 16.3 N/%", "%", 16.3),
        ("i * 16.3 N/%", "‰", 1.63),
        ("i [%] * 16.3 N/%", "‰", 16.3),
        ("i * 16.3 N/count", "increments", 16.3),
        ("i * 1257 N/(N m)", "Nm", 1257.0),  # of a screw with a lead of 5 mm
        ("i * 1257 N/Nm", "mNm", 1.257),
        ("i * 12.57 N/Ncm", "", 12.57),
    ],
)
def test_a_factor_states_the_unit_of_what_it_is_for(entry: str, stated: str, factor: float) -> None:
    assert Columns(command=entry).source("command", stated).factor == pytest.approx(factor, rel=1e-15)


def test_a_record_is_cut_into_its_motions(record: Record) -> None:
    found = cut(record)
    assert [motion.reversal for motion in found] == [True, False, False, True, False, False]
    wave = np.sin(np.arange(record.target.size) / 100.0)  # turns at 157, 471, 785 and 1100
    assert [motion.start for motion in cut(replace(record, target=wave, reference=wave))] == [0, 157, 471, 785, 1100]


def changed(name: str, change: Callable[[Array], Array]) -> Callable[[Table], Table]:
    return lambda table: {**table, name: change(table[name].copy())}


def at(row: int, value: float) -> Callable[[Array], Array]:
    def change(column: Array) -> Array:
        column[row] = value
        return column

    return change


def without(rows: slice) -> Callable[[Table], Table]:
    return lambda table: {name: np.delete(column, rows) for name, column in table.items()}


def swapped(one: str, other: str) -> Callable[[Table], Table]:
    return lambda table: {**table, one: table[other], other: table[one]}


WRONG: dict[str, tuple[Callable[[Table], Table], str]] = {
    "uneven": (changed("time_s", lambda t: t + 1e-4 * np.sin(np.arange(t.size))), "uneven sampling"),
    "gap": (without(slice(500, 510)), "10 samples are missing in 1 gap"),
    "nan": (changed("command_N", at(77, np.nan)), "'command_N' has 1 values that are not numbers, the first in row 78"),
    "constant": (changed("position_m", lambda x: 0 * x), "the position is constant"),
    "thousand": (changed("position_m", lambda x: 1e3 * x), "as far as the reference, a factor of 1000"),
    "milliseconds": (changed("time_s", lambda t: 1e3 * t), "a factor of 1000: the time's unit"),
    "sign": (changed("position_m", lambda x: -x), "a sign is wrong"),
    "time swapped": (swapped("time_s", "position_m"), "columns 'time_s' and 'position_m' are swapped"),
    "command swapped": (swapped("command_N", "position_m"), "position and command look swapped"),
    "reference swapped": (swapped("reference_m", "position_m"), "reference and position look swapped"),
    "missing": (lambda table: {n.replace("position", "positon"): c for n, c in table.items()},
                "column 'position_m' for the position is missing; the nearest that the file has is 'positon_m'"),
    "no command": (lambda table: {n.replace("command_N", "c"): x for n, x in table.items()},
                   "column 'command_N' for the command is missing; the nearest that the file has is 'c'"),
    "own names": (lambda table: {{"time_s": "Zeit [ms]", "target_m": "t"}.get(n, n): x for n, x in table.items()},
                  "column 'time_s' for the time is missing; the nearest that the file has is 'Zeit'"),
    "backward": (changed("time_s", at(40, 0.0)), "falls after row 40, once; sort the rows"),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(WRONG))
def test_a_wrong_file_gets_its_sentence(kind: str, tmp_path: Path, table: Table) -> None:
    make, says = WRONG[kind]
    path = csv(tmp_path / "wrong.csv", make(table))
    with pytest.raises(RecordError) as error:
        load(path, sample_time=MACHINE.sample_time)
    assert says in str(error.value)
    assert str(path) in str(error.value)


def test_a_record_that_is_trusted_is_read_and_its_doubts_are_said(tmp_path: Path, table: Table, record: Record) -> None:
    path = csv(tmp_path / "a.csv", WRONG["thousand"][0](table))
    with pytest.raises(RecordError, match="if the record is right as it is, give --trust-records"):
        load(path)
    loaded = load(path, trusted=True)
    assert isinstance(loaded.content, Record)
    np.testing.assert_array_equal(loaded.content.position, 1e3 * record.position)
    assert loaded.findings[0].startswith("The position moves ")
    assert loaded.findings[0].endswith("as in [mm].")


def said(path: Path, table: Table) -> str:
    control = MACHINE.control
    loaded = load(csv(path, table), pid=control.pid, reference_delay=control.reference_delay, limit=150.0)
    return " ".join(loaded.findings)


def test_what_is_no_error_is_said_too(tmp_path: Path, table: Table) -> None:
    plain = said(tmp_path / "plain.csv", table)
    assert "The position has steps of 100 nm" in plain
    assert "delay between channels" not in plain
    assert "saturated" not in plain
    top = 0.5 * float(np.max(np.abs(table["command_N"])))
    clipped = {**table, "command_N": np.clip(table["command_N"], -top, top)}
    assert "The command is saturated" in said(tmp_path / "clipped.csv", clipped)
    late = {**table, "command_N": np.concatenate([np.full(3, table["command_N"][0]), table["command_N"][:-3]])}
    assert "the command is logged 3 samples (1.5 ms) late" in said(tmp_path / "late.csv", late)


@pytest.mark.parametrize("stated", [1, 4])
def test_another_reference_delay_is_no_shift_of_the_log(tmp_path: Path, stated: int) -> None:
    """Of a command that is nearly all of the reference they look alike; "shift it back" would spoil the dead time."""
    time, still, pid = np.arange(3000) * 5e-4, np.zeros(3000), PID(1e5, 0.0, 0.0, 0.0)
    reference, position = (1e-4 * size * np.sin(2 * np.pi * f * time) for size, f in ((1.0, 4.0), (0.2, 3.0)))
    ran = Record(5e-4, reference, reference, still, still, position)
    table = {"time_s": time, "reference_m": reference, "position_m": position, "command_N": replay(ran, pid, 2)}
    loaded = load(csv(tmp_path / "a.csv", table), pid=pid, reference_delay=stated, trusted=True)
    found = " ".join(loaded.findings)
    assert f"with a reference delay of 2 samples, and not of {stated}" in found
    assert "delay between channels" not in found


def test_a_controller_that_did_not_run_is_said(tmp_path: Path, table: Table) -> None:
    other = PID(1e3, 0.0, 10.0, 1e-4)
    findings = load(csv(tmp_path / "a.csv", table), pid=other, reference_delay=2).findings
    assert any("does not reproduce the logged command" in sentence for sentence in findings)


def test_the_replay_is_the_simulated_controller(record: Record) -> None:
    control = MACHINE.control
    made = replay(record, control.pid, control.reference_delay)
    assert np.max(np.abs(made - record.command)) < 1e-6 * np.max(np.abs(record.command))


def test_a_step_is_found_and_none_where_there_is_none() -> None:
    x = np.sin(np.arange(3000) / 200.0) * 1e-5
    assert quantisation(np.round(x / 1e-7) * 1e-7) == pytest.approx(1e-7, rel=1e-6)
    assert quantisation(x) == 0


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.doc", b"x", "give a .csv"),
        ("a.csv", b"time_s,command_N,position_m\n", "has no rows"),
        ("a.csv", b"time_s,command_N,position_m\n0,1,2\n1,x,2\n", "line 3"),
        ("a.csv", b"time_s,command_N,position_m\n0,1,2\n1,2\n", "line 3 has 2 cells"),
        ("a.csv", b"time_s,time_s\n0,1\n", r"several columns are called 'time_s'; map one .* 'time_s \(2\)'"),
        ("a.mat", b"nothing", "can't be read as a .mat file"),
        ("a.parquet", b"nothing", "can't be read as a .parquet file"),
    ],
)
def test_an_unreadable_file_is_said(name: str, content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=says):
        load(tmp_path / name)


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="can't be read"):
        load(tmp_path / "nowhere.csv")


@pytest.mark.skipif(not WITHHELD.is_dir(), reason="needs the sealed records beside the project")
def test_the_agreed_format_is_read() -> None:
    loaded = load(WITHHELD / "case-01" / "sequential.csv.gz")
    assert isinstance(loaded.content, Record)
    assert loaded.content.sample_time == pytest.approx(5e-4)
    assert len(loaded.given) == 6


def test_samples_that_a_file_keeps_in_another_one_are_not_read(tmp_path: Path) -> None:
    """HDF5 can refer to the bytes of any file, and to data sets of others."""
    (tmp_path / "secret").write_bytes(np.arange(4.0).tobytes())
    with h5py.File(tmp_path / "raw.mat", "w", userblock_size=512) as file:
        file.create_dataset("time_s", (4,), "f8", external=[(str(tmp_path / "secret"), 0, 32)])
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.arange(4.0)
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (4,))
    with h5py.File(tmp_path / "virtual.mat", "w", userblock_size=512) as file:
        file.create_virtual_dataset("time_s", layout)
    for name in ("raw.mat", "virtual.mat"):
        with pytest.raises(RecordError, match="time_s keeps its samples in another file"):
            read(with_head(tmp_path / name))


@pytest.mark.parametrize(
    ("entry", "hint"),
    [
        ("Iq_set [mA]", 'give its factor, like "NAME [mA] * 35 N/A"'),
        ("u [V]", 'give its factor, like "NAME [V] * 35 N/V"'),
    ],
)
def test_a_command_in_what_the_drive_counts_is_asked_for_its_factor(entry: str, hint: str) -> None:
    with pytest.raises(ValueError, match=re.escape(hint)):
        Columns(command=entry)


@pytest.mark.parametrize(("unit", "hint"), [("mA", "35 N/A"), ("mV", "35 N/V"), ("bar", "35 N")])
def test_a_command_that_the_file_states_in_amperes_is_asked_for_a_factor_of_them(
    tmp_path: Path, unit: str, hint: str
) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{1e-3 * i},{1e-6 * i},{i % 7}\n" for i in range(50))
    path.write_text(f"time_s,position_m,Strom [{unit}]\n{rows}", encoding="utf-8")
    with pytest.raises(RecordError, match=re.escape(f'command = "Strom * {hint}"')):
        load(path, Columns(command="Strom"))


def test_the_column_that_a_missing_one_may_be_is_in_its_unit_whatever_unit_the_mapping_states(tmp_path: Path) -> None:
    """Of a log with a column of seconds a user had read that "Ziel" [deg] is the nearest to time_s."""
    path = tmp_path / "drive.csv"
    path.write_text("Zeit [s];Ziel [°];Moment [Nm];Winkel [°]\n0;1;2;3\n0,001;1;2;3\n", encoding="utf-8")
    columns = Columns(time="time_s [s]", command="Moment [N m]", position="Winkel [deg]", target="Ziel [deg]")
    with pytest.raises(RecordError, match="the nearest that the file has is 'Zeit'"):
        load(path, replace(columns, target="target_deg"))
