"""Logs in binary containers give the same record as the plain CSV, and nothing in them runs or fills the memory."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray
from scipy.io import savemat

from models.records.columns import Columns
from models.records.files import load, read
from models.records.record import Record
from models.records.tables.formats import FORMATS
from models.records.tables.reader import READERS, read_table
from models.records.tables.sizes import RecordError
from tests.models.records.tables.test_sizes import FEW, memory
from tests.models.records.test_files import csv

Array = NDArray[np.float64]

STEP: Final = 250e-6
TIME: Final = STEP * np.arange(2_000)
POSITION: Final = 1e-3 * np.sin(8 * TIME) ** 3
COMMAND: Final = 12 * np.gradient(np.gradient(POSITION, STEP), STEP) + 3 * np.sin(40 * TIME)
MILLIMETRES: Final = Columns(time="log/t", position="log/x", command="log/u")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """The record as everybody's CSV has it."""
    table = {"time_s": TIME, "command_N": COMMAND, "position_m": POSITION}
    return record(load(csv(tmp_path_factory.mktemp("plain") / "plain.csv", table)).content)


def record(content: object) -> Record:
    assert isinstance(content, Record)
    return content


def agrees(content: object, plain: Record) -> None:
    """The same numbers, but for the rounding of a unit's factor."""
    one = record(content)
    assert one.sample_time == pytest.approx(plain.sample_time, rel=1e-9)
    np.testing.assert_allclose(one.position, plain.position, rtol=1e-14, atol=0)
    np.testing.assert_allclose(one.command, plain.command, rtol=1e-14, atol=0)


def npz(path: Path) -> Columns:
    np.savez_compressed(path, t=TIME, data=np.column_stack([COMMAND, 1e3 * POSITION]), note=np.array("run 7"))
    return Columns(time="t", command="data:1", position="data:2 [mm]")


def npz_of_structures(path: Path) -> Columns:
    rows = np.zeros(TIME.size, [("t", "f8"), ("u", "f8"), ("x", "f8"), ("state", "U8")])
    rows["t"], rows["u"], rows["x"] = TIME, COMMAND, POSITION
    np.savez(path, log=rows)
    return Columns(time="log.t", command="log.u", position="log.x")


def hdf5(path: Path) -> Columns:
    """Paths, attributes with units in text of either kind, a matrix, text, a scalar and an empty data set beside."""
    with h5py.File(path, "w") as file:
        file["log/t"] = 1e3 * TIME
        file["log/t"].attrs["units"] = np.bytes_(b"ms")
        file["log/axis/x"] = 1e6 * POSITION
        file["log/axis/x"].attrs["unit"] = "um"
        file.create_dataset("log/matrix", data=np.vstack([np.zeros(TIME.size), COMMAND / 35]), compression="gzip")
        file["log/matrix"].attrs["unit"] = "V"
        file["log/operator"] = "somebody"
        file["log/number"] = 3
        file["log/nothing"] = h5py.Empty("f8")
        file["log/image"] = np.zeros((3, 4, 5))
    return Columns(time="log/t", position="/log/axis/x", command="log/matrix:2 [V] * 35 N/V")


def hdf5_of_structures(path: Path) -> Columns:
    rows = np.zeros(TIME.size, [("t", "f8"), ("u", "f8"), ("x", "f4"), ("fine", "f8")])
    rows["t"], rows["u"], rows["fine"] = TIME, COMMAND, POSITION
    with h5py.File(path, "w") as file:
        file.create_dataset("table", data=rows, chunks=(100,))
    return Columns(time="table.t", command="table.u", position="table.fine")


def tdms(path: Path) -> Columns:
    """Two channels of waveforms, whose clock is stated, in two segments."""
    start = np.datetime64("2026-05-12T08:00:00")
    waveform: dict[str, Any] = {"wf_start_time": start, "wf_increment": STEP, "wf_start_offset": 0.0}
    with TdmsWriter(path) as file:
        for part in (slice(0, 900), slice(900, None)):
            file.write_segment(
                [
                    ChannelObject("axis", "x", 1e3 * POSITION[part], {**waveform, "unit_string": "mm"}),
                    ChannelObject("drive", "force", COMMAND[part], {**waveform, "unit_string": "N"}),
                    ChannelObject("drive", "state", np.ones(COMMAND[part].size, np.int16), {}),
                ]
            )
    return Columns(position="axis/x", command="drive/force")


def tdms_with_a_channel_of_time(path: Path) -> Columns:
    stamps = np.datetime64("2026-05-12T08:00:00", "us") + np.rint(1e6 * TIME).astype("timedelta64[us]")
    with TdmsWriter(path) as file:
        file.write_segment(
            [
                ChannelObject("log", "stamp", stamps),
                ChannelObject("log", "x", POSITION),
                ChannelObject("log", "u", COMMAND),
            ]
        )
    return Columns(time="log/stamp", position="log/x", command="log/u")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.npz", npz),
        ("a.npz", npz_of_structures),
        ("a.h5", hdf5),
        ("a.hdf5", hdf5_of_structures),
        ("a.tdms", tdms),
        ("a.tdms", tdms_with_a_channel_of_time),
    ],
)
def test_a_log_reads_as_the_plain_csv_does(
    name: str, write: Callable[[Path], Columns], plain: Record, tmp_path: Path
) -> None:
    columns = write(tmp_path / name)
    agrees(load(tmp_path / name, columns).content, plain)


def test_only_what_is_wanted_is_read_and_all_names_are_known(tmp_path: Path) -> None:
    hdf5(tmp_path / "a.h5")
    table = read_table(tmp_path / "a.h5", {"log/t"})
    assert set(table.columns) == {"log/t"}
    assert sorted(table.names) == ["log/axis/x", "log/matrix:1", "log/matrix:2", "log/t"]
    assert table.units == {"log/t": "ms"}


def test_clocks_are_called_alike_whatever_is_wanted(tmp_path: Path) -> None:
    tdms(tmp_path / "one.tdms")
    assert read_table(tmp_path / "one.tdms", {"drive/force"}).clocks == {"drive/force": "time"}
    two_rates(tmp_path / "two.tdms", 2 * STEP)
    table = read_table(tmp_path / "two.tdms", {"axis/u"})
    assert table.clocks == {"axis/u": "time of axis/u"}
    assert set(table.columns) == {"axis/u", "time of axis/u"}
    assert table.names == ["axis/x", "axis/u", "time of axis/u", "time of axis/x"]


def two_rates(path: Path, increment: float, **late: float) -> Columns:
    with TdmsWriter(path) as file:
        every = round(increment / STEP)
        slow = {"wf_increment": increment, "wf_start_offset": late.get("late", 0.0)}
        file.write_segment(
            [
                ChannelObject("axis", "x", POSITION[::every], slow),
                ChannelObject("axis", "u", COMMAND, {"wf_increment": STEP}),
            ]
        )
    return Columns(position="axis/x", command="axis/u")


def test_channels_of_two_rates_come_onto_the_slower_one_and_it_is_said(tmp_path: Path) -> None:
    loaded = load(tmp_path / "a.tdms", two_rates(tmp_path / "a.tdms", 2 * STEP))
    np.testing.assert_array_equal(record(loaded.content).command, COMMAND[::2])
    np.testing.assert_array_equal(record(loaded.content).position, POSITION[::2])
    assert record(loaded.content).sample_time == pytest.approx(2 * STEP)
    assert loaded.findings[0].startswith("The command was sampled every 250 µs at 2,000 times; the 1,000 samples")


def test_channels_at_other_times_are_refused(tmp_path: Path) -> None:
    columns = two_rates(tmp_path / "a.tdms", 2 * STEP, late=0.1e-3)
    with pytest.raises(RecordError, match=r"a.tdms: the command is sampled every 250 µs .* record both in one task"):
        load(tmp_path / "a.tdms", columns)


def test_a_unit_of_another_kind_is_refused_and_named(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, column in (("t", TIME), ("x", POSITION), ("u", COMMAND)):
            file[name] = column
        file["u"].attrs["unit"] = "A"
    says = r"column .u. is in .A., as the file states, which is .*; write what .* as in command = \"u \* 35 N/A\""
    with pytest.raises(RecordError, match=says):
        load(tmp_path / "a.h5", Columns(time="t", position="x", command="u"))
    for factor in ("60 N", "60 N/A"):
        loaded = load(tmp_path / "a.h5", Columns(time="t", position="x", command=f"u * {factor}"))
        np.testing.assert_allclose(record(loaded.content).command, 60 * COMMAND)


class Planted:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    """A pickle in an array of objects, in the place of an array, in an attribute and in text, in three formats."""
    trap = np.array([Planted(tmp_path / "ran")], object)
    packed = pickle.dumps(Planted(tmp_path / "ran"))
    np.savez(tmp_path / "objects.npz", t=TIME, x=trap)
    with pytest.raises(RecordError, match=r"objects.npz: x holds Python objects, which are pickled and are not read"):
        read(tmp_path / "objects.npz")
    with zipfile.ZipFile(tmp_path / "raw.npz", "w") as archive:
        archive.writestr("x.npy", packed)
    with pytest.raises(RecordError, match=r"raw.npz: can't be read"):
        read(tmp_path / "raw.npz")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = TIME
        file["t"].attrs["unit"] = np.void(packed)
        file["x"] = np.void(packed)
    assert set(read(tmp_path / "a.h5")) == {"t"}
    savemat(tmp_path / "a.mat", {"t": TIME, "x": np.frombuffer(packed, "u1"), "note": packed.decode("latin-1")})
    assert set(read(tmp_path / "a.mat")) == {"t", "x"}
    assert not (tmp_path / "ran").exists()
    pickle.loads(packed)
    assert (tmp_path / "ran").exists()  # the trap would have shown


def member(path: Path, arrays: Mapping[str, tuple[tuple[int, ...], bytes]]) -> None:
    """An NPZ whose heads state these shapes before these bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, (shape, content) in arrays.items():
            head = io.BytesIO()
            np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": shape})
            archive.writestr(f"{name}.npy", head.getvalue() + content)


def channel(path: Path, stated: int) -> None:
    """A TDMS file of one channel that states so many values, and holds three."""
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("g", "c", np.arange(3.0))])
    content = path.read_bytes()
    at = content.index(b"/'g'/'c'") + len(b"/'g'/'c'") + 12  # behind the index' length, the type and the dimension
    assert content[at : at + 8] == struct.pack("<Q", 3)
    path.write_bytes(content[:at] + struct.pack("<Q", stated) + content[at + 8 :])


def scaled(path: Path) -> None:
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("g", "c", np.arange(3.0), {"NI_Number_Of_Scales": 2**31 - 1})])


def many_channels(path: Path) -> None:
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("g", f"c{i}", np.zeros(2)) for i in range(21)])


def h5(**arrays: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, array in arrays.items():
                file.create_dataset(name, **array)

    return write


@pytest.mark.parametrize(
    ("name", "write", "says"),
    [
        ("a.npz", lambda path: member(path, {"x": ((10**12,), b"")}), "more than 5,000 numbers"),
        ("a.npz", lambda path: member(path, {"x": ((1_001,), bytes(8_008))}), "more than 1,000 samples"),
        ("a.npz", lambda path: member(path, {f"x{i}": ((900,), bytes(7_200)) for i in range(6)}), "5,000 numbers"),
        ("a.npz", lambda path: member(path, {f"x{i}": ((2,), bytes(16)) for i in range(21)}), "more than 20 columns"),
        ("a.npz", lambda path: member(path, {"x": ((900,), b"")}), "can't be read as a .npz file"),
        ("a.npz", lambda path: np.savez(path, x=np.zeros((3, 1_001))), "more than 1,000 samples"),
        ("a.npz", lambda path: path.write_bytes(b"nothing"), "can't be read as a .npz file"),
        ("a.h5", h5(x={"shape": (10**12,), "dtype": "f8", "chunks": (1000,)}), "more than 5,000 numbers"),
        ("a.h5", h5(x={"shape": (1_001,), "dtype": "f8"}), "more than 1,000 samples"),
        ("a.h5", h5(**{f"x{i}": {"data": np.zeros(2)} for i in range(21)}), "more than 20 columns"),
        ("a.h5", lambda path: path.write_bytes(b"nothing"), "can't be read as a .h5 file"),
        ("a.tdms", lambda path: channel(path, 2**63), "can't be read as a .tdms file"),
        ("a.tdms", scaled, "states 2147483647 for NI_Number_Of_Scales; 100 is the most that is read"),
        ("a.tdms", many_channels, "more than 20 columns"),
        ("a.tdms", lambda path: path.write_bytes(b"nothing"), "can't be read as a .tdms file"),
    ],
)
def test_what_is_too_large_or_spoiled_is_refused(
    name: str, write: Callable[[Path], object], says: str, tmp_path: Path
) -> None:
    write(tmp_path / name)
    with memory(2 * FEW.memory / 1e6), pytest.raises(RecordError, match=says) as error:
        read(tmp_path / name, FEW)
    assert str(tmp_path / name) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_bomb_in_an_npz_is_refused_before_it_is_expanded(tmp_path: Path) -> None:
    """Eighty megabytes of zeros behind a head that states three numbers; and a head that states them honestly."""
    member(tmp_path / "more.npz", {"x": ((3,), bytes(80_000_000))})
    with memory(20):
        np.testing.assert_array_equal(read(tmp_path / "more.npz", FEW)["x"], np.zeros(3))
    member(tmp_path / "honest.npz", {"x": ((10_000_000,), bytes(80_000_000))})
    with memory(20), pytest.raises(RecordError, match="more than 7,000,000 samples"):
        read(tmp_path / "honest.npz")


def test_a_tdms_file_that_states_more_than_it_holds_gives_what_it_holds(tmp_path: Path) -> None:
    channel(tmp_path / "a.tdms", 10**12)
    with memory(5):
        np.testing.assert_array_equal(read(tmp_path / "a.tdms", FEW)["g/c"], [0, 1, 2])


def test_the_formats_that_help_lists_are_those_that_are_read() -> None:
    assert {Path(f"a{end}").suffix for end in FORMATS} == set(READERS)
