"""A file may hold a thousand times what it takes on the disk, or say that it does: it is refused, soon and cheaply."""

from __future__ import annotations

import gzip
import os
import resource
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pyarrow
import pytest
from pyarrow.parquet import write_table
from scipy.io import savemat

from models.records.files import load, read
from models.records.tables.sizes import LIMITS, Limits, RecordError
from tests.models.records.test_files import with_head

FEW = Limits(samples=1_000, numbers=5_000, text=1_300_000, line=2_000, columns=20, memory=1 << 26)
HEADER = b"time_s,command_N,position_m\n"


@contextmanager
def memory(most: float) -> Iterator[None]:
    """Fails where this process, with all its libraries, takes more than so many MB at a time."""
    Path("/proc/self/clear_refs").write_text("5")  # the largest use so far is forgotten
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1e3 * most


def test_a_gigabyte_of_zeros_in_a_megabyte_is_refused_at_once(tmp_path: Path) -> None:
    part = gzip.compress(bytes(10_000_000))
    path = tmp_path / "zeros.csv.gz"
    path.write_bytes(part * 100)  # gzip files may be put one behind another
    assert path.stat().st_size < 1_100_000
    with memory(10), pytest.raises(RecordError, match=r"zeros.csv.gz: line 1 has more than 1,000,000 characters"):
        load(path)


def test_a_gigabyte_of_rows_is_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv.gz"
    path.write_bytes(gzip.compress(HEADER) + gzip.compress(b"0,0,0\n" * 1_000_000) * 170)
    with memory(10), pytest.raises(RecordError, match=r"more than 7,000,000 samples, .*; cut it .* decimate it"):
        load(path)


def element(kind: int, data: bytes, stated: int | None = None) -> bytes:
    """A part of a MAT file of version 5."""
    length = len(data) if stated is None else stated
    return struct.pack("<II", kind, length) + data + bytes(-len(data) % 8)


def array(data: bytes, dimensions: tuple[int, ...], kind: int = 6) -> bytes:
    """An array of this class, named x."""
    flags = element(6, struct.pack("<II", kind, 0))
    shape = element(5, struct.pack(f"<{len(dimensions)}i", *dimensions))
    return element(14, flags + shape + element(1, b"x") + data)


def mat(path: Path, content: bytes) -> Path:
    packed = zlib.compress(content)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed)
    return path


def zeros(path: Path) -> Path:
    return mat(path, array(element(9, bytes(8 * 6_000)), (6_000, 1)))


def cells(path: Path) -> Path:
    """An array of so many arrays, of which none is there."""
    return mat(path, array(b"", (30_000, 30_000), kind=1))


def tiny_cells(path: Path) -> Path:
    return mat(path, array(element(14, b"") * 500, (20, 1), kind=1))


def unallocated(path: Path) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("x", (10**12,), "f8", chunks=(1000,), compression="gzip")
    return with_head(path)


def dishonest_chunk(path: Path) -> Path:
    """A data set of a thousand numbers whose one part expands to a hundred megabytes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        data = file.create_dataset("x", (1000,), "f8", chunks=(1000,), compression="gzip")
        data.id.write_direct_chunk((0,), zlib.compress(bytes(100_000_000)))
    return with_head(path)


def many_rows(path: Path) -> Path:
    write_table(pyarrow.table({"x": np.zeros(1_001)}), path)
    return path


def many_columns(path: Path) -> Path:
    write_table(pyarrow.table({f"x{i}": np.zeros(10) for i in range(21)}), path)
    return path


def long_row(path: Path) -> Path:
    """One row of two hundred megabytes."""
    pyarrow.set_memory_pool(pyarrow.system_memory_pool())  # that of Arrow may have reserved what is needed
    write_table(pyarrow.table({"x": [np.zeros(25_000_000)]}), path, compression="zstd", write_statistics=False)
    return path


def pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def text(path: Path, content: bytes) -> Path:
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


@pytest.mark.parametrize(
    ("name", "make", "says"),
    [
        ("a.csv", lambda path: text(path, HEADER + b"0,0,0\n" * 1_001), "more than 1,000 samples, a line each"),
        ("a.csv", lambda path: text(path, HEADER + b"# nothing\n" * 900), "has no rows below its first line"),
        ("a.csv", lambda path: text(path, HEADER + b"\n" * 1_002), "more than 1,000 samples, a line each"),
        ("a.csv", lambda path: text(path, HEADER + b"#" * 2_100_000 + b"\n"), "line 2 has more than 2,000 characters"),
        ("a.csv", lambda path: text(path, b"a,a\n0," + b"1" * 2_100_000), "line 2 has more than 2,000 characters"),
        ("a.csv", lambda path: text(path, b",".join(b"x%d" % i for i in range(21)) + b"\n"), "more than 20 columns"),
        ("a.csv.gz", lambda path: text(path, b"a,b,c,d,e,f\n" + b"0,0,0,0,0,0\n" * 900), "5,000 numbers"),
        ("a.csv.gz", lambda path: text(path, HEADER + (b" " * 1_500 + b"\n") * 900), "more than 0.0013 GB of text"),
        ("a.mat", zeros, "more than 5,000 numbers"),
        ("a.mat", cells, "more than 20 columns or fields"),
        ("a.mat", tiny_cells, "more than 20 columns or fields"),
        ("a.mat", lambda path: savemat(path, {"x": np.zeros(1_001)}), "more than 1,000 samples"),
        ("a.mat", lambda path: savemat(path, {"x": np.zeros(5_001)}, format="4"), "more than 5,000 numbers"),
        ("a.mat", unallocated, "more than 5,000 numbers"),
        ("a.mat", dishonest_chunk, "filter returned failure .*; export it again"),
        ("a.parquet", many_rows, "more than 1,000 samples"),
        ("a.parquet", many_columns, "more than 20 columns"),
        ("a.parquet", long_row, "more than 0.0671089 GB in memory"),
        ("a.csv", pipe, "is not a plain file"),
        ("a.mcap", Path.mkdir, "is a folder; give the file that holds the record, of a ROS 2 bag its .mcap or .db3"),
    ],
)
def test_what_is_too_large_is_refused(name: str, make: Callable[[Path], object], says: str, tmp_path: Path) -> None:
    make(tmp_path / name)
    # The bound is on what the process may ask for; what it was given before and has freed comes on top.
    with memory(5 if "csv" in name else 2 * FEW.memory / 1e6), pytest.raises(RecordError, match=says) as error:
        read(tmp_path / name, FEW)
    assert str(tmp_path / name) in str(error.value)


def test_cells_too_deep_for_the_stack_are_refused(tmp_path: Path) -> None:
    """Each states a length of one byte. SciPy, which follows them nevertheless, would end the process."""
    head = array(b"", (1, 1), kind=1)
    path = mat(tmp_path / "a.mat", (head[:4] + struct.pack("<I", 1) + head[8:]) * 100_000)
    with memory(20), pytest.raises(RecordError, match="more than 1,000 columns or fields"):
        read(path)


def test_a_csv_is_the_same_however_its_lines_fall_into_chunks(tmp_path: Path) -> None:
    """Two chunks and a half, with Windows' ends of lines, an empty cell in the last chunk, and no end of the last."""
    rows = np.column_stack([np.arange(60_000) * 5e-4, np.sin(np.arange(60_000)), np.arange(60_000) / 7])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    lines[-2] = lines[-2].rpartition(",")[0] + ","
    path = text(tmp_path / "a.csv", b"\xef\xbb\xbf" + "\r\n".join(["t,u,x", *lines]).encode())
    assert path.stat().st_size > 2.5e6
    columns = read(path)
    rows[-2, 2] = np.nan
    for i, name in enumerate("tux"):
        np.testing.assert_array_equal(columns[name], rows[:, i])
    path.write_bytes(path.read_bytes() + b"\r\n0,zero,0")
    with pytest.raises(RecordError, match="line 60002: could not convert"):
        read(path)


def test_ten_minutes_at_ten_kilohertz_are_within_the_limits() -> None:
    LIMITS.check_samples(6_000_001)
    LIMITS.check_numbers(6 * 6_000_001)
    LIMITS.check_text(6 * 6_000_001 * 25)
