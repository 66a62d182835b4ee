"""Logs that need optional packages: MDF4 and ROS 2 bags, and what is said where these packages are missing.

The tests that write and read such files are skipped where the package is not installed: pip install asammdf rosbags.
"""

from __future__ import annotations

import importlib
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.records.columns import Columns
from models.records.files import load, read
from models.records.recipes.mapping_file import read_rules, recipes
from models.records.recipes.rules import columns_for
from models.records.record import Record
from models.records.tables.binary.mdf4_process import read_mdf4
from models.records.tables.reader import read_table
from models.records.tables.sizes import LIMITS, RecordError
from tests.models.records.tables.binary.test_containers import COMMAND, POSITION, STEP, TIME, agrees, plain, record
from tests.models.records.tables.test_sizes import FEW

__all__ = ["plain"]  # a fixture


def needs(package: str) -> Any:
    return pytest.importorskip(package, reason=f"needs the optional package {package}: pip install {package}")


@pytest.mark.parametrize(("name", "package"), [("a.mf4", "asammdf"), ("a.mcap", "rosbags"), ("a.db3", "rosbags")])
def test_a_missing_package_is_said_with_the_command_that_installs_it(
    name: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("models.records.tables.binary.extras.find_spec", lambda _: None)
    (tmp_path / name).write_bytes(b"anything")
    says = rf"{name}: .* needs the package {package}, which is not installed; run python -m pip install {package} in"
    with pytest.raises(RecordError, match=says) as error:
        read(tmp_path / name)
    assert "\n" not in str(error.value)


def mdf(path: Path, *, conversion: dict[str, Any] | None = None, step: float = STEP) -> None:
    """A group of position and raw command, and another group of the slower kind with a channel of its own."""
    asammdf = needs("asammdf")
    raw = np.rint(COMMAND / 1e-3).astype("i4")
    linear = {"a": 1e-3, "b": 0.0, "unit": "N"} if conversion is None else conversion
    with asammdf.MDF(version="4.10") as file:
        file.append(
            [
                asammdf.Signal(1e3 * POSITION, TIME, name="Position actual value", unit="mm"),
                asammdf.Signal(1e3 * POSITION, TIME, name="Target position", unit="mm"),
                asammdf.Signal(raw, TIME, name="Target torque", conversion=linear),
            ],
            acq_name="drive",
        )
        every = round(step / STEP) if step >= STEP else 1
        file.append([asammdf.Signal(COMMAND[::every], TIME[::every], name="force", unit="N")], acq_name="amplifier")
        file.append([asammdf.Signal(np.array([b"run", b"stop"]), np.array([0.0, 1.0]), name="state", encoding="utf-8")])
        file.save(path, overwrite=True, compression=2)


def test_mdf4_reads_as_the_plain_csv_does_by_the_recipe_of_a_drive(plain: Record, tmp_path: Path) -> None:
    mdf(tmp_path / "a.mf4")
    columns = columns_for(tmp_path / "a.mf4", read_rules(recipes()["cia402_mdf"]))
    found = record(load(tmp_path / "a.mf4", columns).content)
    np.testing.assert_allclose(found.position, plain.position, rtol=1e-14)
    np.testing.assert_allclose(found.command, 1e-3 * np.rint(COMMAND / 1e-3), rtol=1e-14)
    assert found.sample_time == pytest.approx(STEP, rel=1e-9)
    agrees(load(tmp_path / "a.mf4", Columns(position="Position actual value", command="force")).content, plain)
    assert {"drive/time", "amplifier/time"} <= set(read_table(tmp_path / "a.mf4").names)


def test_groups_of_mdf4_at_two_rates_come_onto_the_slower_one(tmp_path: Path) -> None:
    mdf(tmp_path / "a.mf4", step=4 * STEP)
    loaded = load(tmp_path / "a.mf4", Columns(position="Position actual value [mm]", command="force"))
    np.testing.assert_allclose(record(loaded.content).position, POSITION[::4], rtol=1e-14)
    assert "The position was sampled every 250 µs at 2,000 times" in loaded.findings[0]


def test_a_reader_of_mdf4_that_breaks_off_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.mf4").write_bytes(b"MDF     4.10    ")
    monkeypatch.setattr("models.records.tables.binary.extras.find_spec", lambda _: True)
    monkeypatch.setattr("models.records.tables.binary.mdf4_process.__name__", "signal; raise SystemExit(3)")
    with pytest.raises(RecordError, match=r"a.mf4: is damaged: reading it broke off; export it again"):
        read(tmp_path / "a.mf4")


def test_formulas_in_mdf4_are_not_evaluated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mdf(tmp_path / "a.mf4", conversion={"formula": "X1 * 2"})
    for module in ("asammdf.blocks.v4_blocks", "asammdf.blocks.v2_v3_blocks"):
        monkeypatch.setattr(importlib.import_module(module), "evaluate", lambda *_: pytest.fail("evaluated"))
    assert "Target torque" not in read_mdf4(tmp_path / "a.mf4", LIMITS, None).columns
    with pytest.raises(RecordError, match="Target torque is converted by a table or formula in the file, which is not"):
        read_mdf4(tmp_path / "a.mf4", LIMITS, {"Position actual value", "Target torque"})


def test_mdf4_that_is_too_large_or_spoiled_is_refused(tmp_path: Path) -> None:
    mdf(tmp_path / "a.mf4")
    with pytest.raises(RecordError, match=r"more than 1,000 samples|more than 5,000 numbers"):
        read(tmp_path / "a.mf4", FEW)
    (tmp_path / "b.mf4").write_bytes(b"nothing")
    with pytest.raises(RecordError, match=r"b.mf4: is not an MDF file, whatever its name ends in"):
        read(tmp_path / "b.mf4")
    (tmp_path / "b.mf4").write_bytes(b"MDF     3.30    ")
    with pytest.raises(RecordError, match=r"b.mf4: is an MDF file of version 3.30; convert it to version 4"):
        read(tmp_path / "b.mf4")
    (tmp_path / "b.mf4").write_bytes(b"UnFinMF 4.10    ")
    with pytest.raises(RecordError, match=r"b.mf4: was not finished by its logger"):
        read(tmp_path / "b.mf4")
    content = (tmp_path / "a.mf4").read_bytes()
    (tmp_path / "c.mf4").write_bytes(content[: len(content) // 2])
    with pytest.raises(RecordError) as error:
        load(tmp_path / "c.mf4", Columns(position="Position actual value", command="force"))
    assert "\n" not in str(error.value)


OWN = "builtin_interfaces/Time stamp\nfloat64 force\nstring note\nfloat32[] rest\n"


def bag(path: Path, *, extra: Callable[[int], int] = lambda _: 2, late: int = 0, pixels: int = 10_000) -> Path:
    """Joint states, a message of an own type 'late' [ns] behind them, and an image that nobody asks for."""
    needs("rosbags")
    rosbag2, typesys = importlib.import_module("rosbags.rosbag2"), importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(OWN, "axis/msg/Drive"))
    stamp, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    joint, drive = store.types["sensor_msgs/msg/JointState"], store.types["axis/msg/Drive"]
    image = store.types["std_msgs/msg/UInt8MultiArray"]
    layout = store.types["std_msgs/msg/MultiArrayLayout"]
    plugin = rosbag2.StoragePlugin.MCAP if path.suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
    opened = rosbag2.Writer(path.parent / path.stem, version=9, storage_plugin=plugin)
    if plugin == rosbag2.StoragePlugin.MCAP:
        opened.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with opened as writer:
        joints = writer.add_connection("/joint_states", joint.__msgtype__, typestore=store)
        drives = writer.add_connection("/axis/drive", drive.__msgtype__, typestore=store)
        images = writer.add_connection("/camera", image.__msgtype__, typestore=store)
        for k, (t, x, u) in enumerate(zip(TIME, POSITION, COMMAND, strict=True)):
            now = 1_750_000_000_000_000_000 + round(1e9 * t)
            sec, nanosec = divmod(now, 10**9)
            head = header(stamp(sec, nanosec), "x" * (k % 7))
            one = joint(head, ["axis"], np.array([x]), np.array([]), np.array([u]))
            writer.write(joints, now + 1_000_000 * (k % 3), store.serialize_cdr(one, joint.__msgtype__))
            sec, nanosec = divmod(now + late, 10**9)
            two = drive(stamp(sec, nanosec), float(u), "y" * (k % 5), np.zeros(extra(k), np.float32))
            writer.write(drives, now + 5_000_000, store.serialize_cdr(two, drive.__msgtype__))
            if k % 5_000 == 0:
                three = image(layout([], 0), np.zeros(pixels, np.uint8))
                writer.write(images, now, store.serialize_cdr(three, image.__msgtype__))
    (path.parent / path.stem / path.with_suffix(path.suffix).name).rename(path)
    return path


@pytest.mark.parametrize("name", ["a.mcap", "a.db3"])
def test_a_bag_reads_as_the_plain_csv_does_by_the_recipe_of_joint_states(
    name: str, plain: Record, tmp_path: Path
) -> None:
    """The times at which the messages came jitter by milliseconds; their stamps do not."""
    path = bag(tmp_path / name)
    agrees(load(path, columns_for(path, read_rules(recipes()["ros2_joint_state"]))).content, plain)
    agrees(load(path, Columns(position="joint_states/position:1", command="axis/drive/force")).content, plain)
    table = read_table(path)
    assert "axis/drive/rest:2" in table.names
    assert not any(column.startswith("camera") for column in table.names)
    assert "times of joint_states: its stamps" in table.recognised


def test_topics_at_other_times_and_lists_of_several_lengths_are_refused(tmp_path: Path) -> None:
    path = bag(tmp_path / "late.mcap", late=100_000)
    with pytest.raises(RecordError, match=r"every 250 µs from 0 s on and the command every 250 µs from 100 µs on"):
        load(path, Columns(position="joint_states/position:1", command="axis/drive/force"))
    path = bag(tmp_path / "ragged.mcap", extra=lambda k: 1 + (k == 700))
    with pytest.raises(RecordError, match=r"the messages of axis/drive do not have as many numbers each"):
        load(path, Columns(position="joint_states/position:1", command="axis/drive/force"))


def test_no_code_is_made_of_the_types_in_a_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path / "a.mcap")
    for module in ("rosbags.typesys.store", "rosbags.serde.utils"):
        monkeypatch.setattr(f"{module}.exec", lambda *_: pytest.fail("made code"), raising=False)
    assert read_table(path, {"axis/drive/force"}).columns["axis/drive/force"].size == TIME.size


def test_a_bomb_in_a_bag_is_refused_where_memory_ends(tmp_path: Path) -> None:
    """One message of so many zeros that they take a few kilobytes compressed."""
    path = bag(tmp_path / "a.mcap", pixels=2 * FEW.memory)
    assert path.stat().st_size < 1_000_000
    with pytest.raises(RecordError, match=r"expands to more than 0.0671089 GB in memory"):
        read(path, FEW)


def test_a_bag_that_is_too_large_or_spoiled_or_has_a_view_is_refused(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.db3")
    with pytest.raises(RecordError, match=r"more than 1,000 messages of one topic|more than 5,000 numbers"):
        read(path, FEW)
    with sqlite3.connect(path) as database:
        database.execute("CREATE VIEW v AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i FROM n")
    database.close()
    with pytest.raises(RecordError, match="is a database with views, triggers or virtual tables"):
        read(path)
    for name in ("b.mcap", "b.db3"):
        (tmp_path / name).write_bytes(b"nothing")
        with pytest.raises(RecordError, match=rf"{name}: can't be read as a .\w+ file") as error:
            read(tmp_path / name)
        assert "\n" not in str(error.value)
    (tmp_path / "a?immutable=0.db3").write_bytes(b"nothing")
    with pytest.raises(RecordError, match="which SQLite reads as options"):
        read(tmp_path / "a?immutable=0.db3")
