"""MAT files, v4 to v7 and v7.3 (HDF5): their sizes are walked through before an array is made.

Compressed parts of a file may hold a thousand times what they take on the disk. So the parts of v5 to v7 are expanded
chunk by chunk, to where the next part begins (MathWorks, MAT-File Format), and those of HDF5 one by one, before SciPy
or h5py read them.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from models.records.sizes import CHUNK, Limits, RecordError

Array = NDArray[np.float64]

HEAD: Final = 128  # bytes before the first variable
MATRIX, COMPRESSED, DIMENSIONS = 14, 15, 5
WIDTH: Final = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # bytes of a number, by its type
HOLDING: Final = {1, 2, 3}  # classes of arrays whose members are arrays: cells, structures, objects
DEFLATE, FILTERS = 1, {1, 2, 3}  # of HDF5: deflate, shuffle and a checksum, which is all that MATLAB writes


def columns_of_mat(path: Path, limits: Limits) -> dict[str, Array]:
    """Every numeric array of a MAT file [as the file has it]; fields of structures as dotted names: data.t, data.x.

    Raises RecordError for one that is too large, and what SciPy or h5py raise for one that is spoiled.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
        if 0 not in head[:4] and len(head) == HEAD:
            order = "<" if head[126:128] == b"IM" else ">"
            if head[125 if order == "<" else 124] == 2:
                return _columns_of_hdf5(path, limits)
            _walked(file, order, path.stat().st_size, _Tally(limits))
    from scipy.io import loadmat, whosmat  # noqa: PLC0415

    if 0 in head[:4]:  # v4 has neither compression nor structures
        variables = whosmat(path)
        limits.check_columns(len(variables))
        limits.check_numbers(sum(math.prod(shape) for _, shape, _ in variables))
    content = loadmat(path, simplify_cells=True)
    return _flat({name: item for name, item in content.items() if not name.startswith("__")}, "")


def _flat(content: Mapping[str, Any], where: str) -> dict[str, Array]:
    """Structures as dotted names: data.t, data.x."""
    found: dict[str, Array] = {}
    for name, item in content.items():
        if isinstance(item, Mapping):
            found |= _flat(item, f"{where}{name}.")
        elif isinstance(item, np.ndarray) and item.dtype.kind in "fiub":
            found[f"{where}{name}"] = np.asarray(np.squeeze(item), float)
    return found


@dataclass
class _Tally:
    """What the parts of a file hold so far."""

    limits: Limits
    parts: int = 0
    numbers: int = 0

    def add(self, numbers: int) -> None:
        """One part more. Raises RecordError where all of them are too much."""
        self.parts, self.numbers = self.parts + 1, self.numbers + numbers
        if self.parts > 8 * self.limits.columns:  # an array has four parts, with its own head six
            raise RecordError(
                f"holds more than {self.limits.columns:,} variables and fields, the most that is read; "
                "save the record's signals alone"
            )
        self.limits.check_numbers(self.numbers)


class _Stream(Protocol):
    """Bytes that can only be read onwards; `at`: how many were."""

    at: int

    def read(self, count: int) -> bytes:
        """At most so many bytes; fewer only where the stream ends."""


class _Plain:
    """`left` bytes of a file."""

    def __init__(self, file: IO[bytes], left: int) -> None:
        self._file, self._left, self.at = file, left, 0

    def read(self, count: int) -> bytes:
        """See _Stream."""
        got = self._file.read(min(count, self._left))
        self._left, self.at = self._left - len(got), self.at + len(got)
        return got


class _Inflated:
    """What `left` bytes of a file expand to."""

    def __init__(self, file: IO[bytes], left: int) -> None:
        self._packed, self._inflate, self._ready, self.at = _Plain(file, left), zlib.decompressobj(), b"", 0

    def read(self, count: int) -> bytes:
        """See _Stream."""
        parts, wanted = [self._ready], count - len(self._ready)
        while wanted > 0:
            packed = self._inflate.unconsumed_tail or self._packed.read(1 << 16)
            made = self._inflate.decompress(packed, 1 << 16)
            if not (packed or made) or (self._inflate.eof and not made):
                break
            parts.append(made)
            wanted -= len(made)
        whole = b"".join(parts)
        got, self._ready = whole[:count], whole[count:]
        self.at += len(got)
        return got


def _walked(file: IO[bytes], order: str, size: int, tally: _Tally) -> None:
    """Goes through all variables from the head on. Raises RecordError where they are too many or too large."""
    while file.tell() + 8 <= size:
        begin = file.tell()
        kind, length = struct.unpack(f"{order}II", file.read(8))
        if kind == COMPRESSED:
            _through(_Inflated(file, length), order, tally)
        elif kind == MATRIX:
            file.seek(begin)
            _through(_Plain(file, 8 + length), order, tally)
        else:
            tally.add(0)
        file.seek(begin + 8 + length)


def _through(stream: _Stream, order: str, tally: _Tally) -> None:
    """Goes through the parts of one variable, in the order in which SciPy reads them."""
    ends: list[int] = []
    for kind, length, data in _parts(stream, order):
        while ends and stream.at > ends[-1]:
            ends.pop()
        if kind == MATRIX:
            tally.add(0)
            ends.append(stream.at + length)
            if len(ends) > tally.limits.depth:
                raise RecordError(f"holds structures more than {tally.limits.depth} deep; save the signals alone")
            if length:
                _check_shape(stream, order, tally)
        else:
            tally.add(length // WIDTH.get(kind, 1))
            if data is None:
                _skip(stream, length)


def _check_shape(stream: _Stream, order: str, tally: _Tally) -> None:
    """Reads class and dimensions at the head of a matrix: an array of arrays has a place for each, even if empty."""
    flags = stream.read(16)
    if len(flags) < 16:
        return
    kind = flags[8] if order == "<" else flags[11]
    tag = stream.read(8)
    if len(tag) < 8:
        return
    first, length = struct.unpack(f"{order}II", tag)
    packed = tag[4:] if first >> 16 else stream.read(min(length + -length % 8, 1024))[:length]
    count = math.prod(max(one, 0) for (one,) in struct.iter_unpack(f"{order}i", packed[: len(packed) // 4 * 4]))
    tally.limits.check_numbers(count)
    if kind in HOLDING:
        tally.limits.check_columns(count)


def _parts(stream: _Stream, order: str) -> Iterator[tuple[int, int, bytes | None]]:
    """Type and length [bytes] of each part, and its data where the tag holds them."""
    while len(tag := stream.read(8)) == 8:
        kind, length = struct.unpack(f"{order}II", tag)
        if kind >> 16:
            yield kind & 0xFFFF, kind >> 16, tag[4:]
        else:
            yield kind, length, None


def _skip(stream: _Stream, length: int) -> None:
    left = length + -length % 8
    while left > 0 and (got := len(stream.read(min(left, CHUNK)))):
        left -= got


def _columns_of_hdf5(path: Path, limits: Limits) -> dict[str, Array]:
    try:
        import h5py  # noqa: PLC0415
    except ImportError as error:
        raise RecordError("MAT v7.3 needs the package h5py; install it, or save with -v7") from error
    found: dict[str, Array] = {}
    tally = _Tally(limits)

    def visit(name: str, item: Any) -> None:
        tally.add(0)
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and not name.startswith("#"):
            if item.external or item.is_virtual:
                raise RecordError(f"{name} keeps its samples in another file; save them in this one")
            tally.add(int(item.size or 0))
            _check_chunks(name, item, limits)
            found[name.replace("/", ".")] = np.squeeze(np.asarray(item, float))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


def _check_chunks(name: str, item: Any, limits: Limits) -> None:
    """Raises RecordError for a data set whose chunks expand to more than they state, or to more than is read."""
    if item.chunks is None:
        return
    stated = math.prod(item.chunks) * item.dtype.itemsize
    limits.check_numbers(math.prod(item.chunks))
    made = item.id.get_create_plist()
    used = [made.get_filter(i)[0] for i in range(made.get_nfilters())]
    if not FILTERS.issuperset(used) or used.count(DEFLATE) > 1:
        raise RecordError(f"{name} is compressed in a way that MATLAB does not write; save it with -v7.3 or -v7")
    if DEFLATE not in used:
        return

    def expand(chunk: Any) -> None:
        left_out, packed = item.id.read_direct_chunk(chunk.chunk_offset)
        if left_out >> used.index(DEFLATE) & 1:  # a part that deflate does not shorten is kept as it is
            return
        inflate, left = zlib.decompressobj(), stated + 64  # a checksum may follow
        while packed and left > 0 and not inflate.eof:
            left -= len(inflate.decompress(packed, min(CHUNK, left)))
            packed = inflate.unconsumed_tail
        if left <= 0:
            raise RecordError(f"{name} has a part that expands to more than it states; export it again")

    item.id.chunk_iter(expand)
