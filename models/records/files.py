"""Records and frequency responses from CSV, CSV.gz, MAT (v5 and v7.3) and Parquet files, in SI units.

`read` gives whatever the file holds under its own names; `load` maps the names by `Columns`, checks, and returns a
Record or a measured FrequencyResponse, whichever the file is. Every fault is one sentence in a RecordError.
"""

from __future__ import annotations

import csv
import difflib
import gzip
import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.controller import PID
from models.identification.response import FrequencyResponse
from models.records.checks import RecordError, check_samples, derivative_of_error, findings
from models.records.columns import UNITS, Columns
from models.records.record import Record

Array = NDArray[np.float64]
NEEDED: Final = ("time", "command", "position")
OPTIONAL: Final = ("target", "reference", "feedforward")


@dataclass(frozen=True)
class Loaded:
    """One file: its name, its SHA-256, what it holds, which signals were in it, and what is to be said about it."""

    name: str
    sha256: str
    content: Record | FrequencyResponse
    given: tuple[str, ...]
    findings: tuple[str, ...]


def load(path: Path, columns: Columns | None = None, **facts: Any) -> Loaded:
    """The record or frequency response in a file. `facts` go to `record_check.findings`: pid, sample_time [s], ...

    A file with a column for `frequency` and none for `position` is a frequency response. Signals that the file leaves
    out: the reference is then the target (or it the reference, or both zero) and the feedforward zero.
    Raises RecordError.
    """
    columns = columns or Columns()
    table = read(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    names = {signal: columns.source(signal).name for signal in UNITS}
    try:
        if names["frequency"] in table and names["position"] not in table:
            return Loaded(path.name, digest, _response(table, columns), (), ())
        record, given = _record(table, columns)
        said = findings(_as_it_ran(record, columns, **facts), given, **facts)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    return Loaded(path.name, digest, record, given, said)


def read_record(path: str | Path, columns: Columns | None = None) -> Record:
    """The signals (n,) [m], [N] of a record file: .csv, .csv.gz, .mat or .parquet.

    columns: how the file calls its signals, such as `machine.record`; by default time_s, command_N, position_m, ...
    Raises RecordError, a sentence that says what is wrong and what to do, for a file that holds no such record.

    >>> record = pos.read_record(folder / "moves.csv")
    >>> record.sample_time, record.position.shape == record.command.shape
    (0.0005, True)
    """
    content = load(Path(path), columns).content
    if not isinstance(content, Record):
        raise RecordError(f"{path}: holds a frequency response; give a record of time, command and position")
    return content


def _as_it_ran(
    record: Record, columns: Columns, *, pid: PID | None = None, reference_delay: int = 0, **_: Any
) -> Record:
    """The record for a replay of the PID, whatever its derivative was taken of."""
    return record if pid is None or columns.derivative == "error" else derivative_of_error(record, pid, reference_delay)


def read(path: Path) -> dict[str, Array]:
    """Every numeric column (n,) of a file, under its own name and in its own unit [as the file has it].

    Raises RecordError for what can't be read.
    """
    readers = {".csv": _csv, ".gz": _csv, ".mat": _mat, ".parquet": _parquet}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RecordError(f"{path}: ends in {path.suffix or 'nothing'}; give a .csv, .csv.gz, .mat or .parquet file")
    try:
        found = reader(path)
    except OSError as error:
        raise RecordError(f"{path}: can't be read ({error.strerror or error}); give an existing record") from error
    except RecordError:
        raise
    except Exception as error:  # the readers of three formats raise what they like
        text = " ".join(str(error).split())[:200]
        raise RecordError(f"{path}: can't be read as a {path.suffix} file ({text}); export it again") from error
    return {name: column for name, column in found.items() if column.ndim == 1 and column.size > 1}


def _csv(path: Path) -> dict[str, Array]:
    raw = path.read_bytes()
    text = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8-sig").replace("\r\n", "\n")
    first, _, body = text.partition("\n")
    delimiter = next((mark for mark in (";", "\t", ",") if mark in first), ",")
    names = [name.strip() for name in next(csv.reader([first], delimiter=delimiter), [])]
    if delimiter == ";":
        body = body.replace(",", ".")  # where columns end in semicolons, decimals may have commas
    if len(set(names)) != len(names):
        raise RecordError(f"{path}: two columns have one name; name each column once in the first line")
    if not body.strip():
        raise RecordError(f"{path}: has no rows below its first line; export the samples too")
    try:
        rows = np.loadtxt(io.StringIO(body), delimiter=delimiter, ndmin=2)
    except ValueError:
        rows = _rows(path, body, delimiter, len(names))
    if rows.shape[1] != len(names):
        raise RecordError(
            f"{path}: {rows.shape[1]} columns but {len(names)} names in the first line; name every column"
        )
    return {name: np.ascontiguousarray(rows[:, i]) for i, name in enumerate(names)}


def _rows(path: Path, body: str, delimiter: str, count: int) -> Array:
    """The rows of a CSV that has empty cells (they become NaN); what is no number is said with its line."""
    rows = []
    for number, row in enumerate(csv.reader(io.StringIO(body), delimiter=delimiter), start=2):
        if not row:
            continue
        if len(row) != count:
            raise RecordError(
                f"{path}: line {number} has {len(row)} cells and the first line {count}; correct that line"
            )
        try:
            rows.append([float(cell) if cell.strip() else np.nan for cell in row])
        except ValueError as error:
            raise RecordError(f"{path}: line {number}: {error}; write numbers only below the first line") from error
    if not rows:
        raise RecordError(f"{path}: has no rows below its first line; export the samples too")
    return np.array(rows)


def _mat(path: Path) -> dict[str, Array]:
    from scipy.io import loadmat  # noqa: PLC0415

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # v7.3 is HDF5
        return _mat73(path)
    return _flat({name: item for name, item in content.items() if not name.startswith("__")}, "")


def _flat(content: Mapping[str, Any], where: str) -> dict[str, Array]:
    """Structures as dotted names: data.t, data.x."""
    found: dict[str, Array] = {}
    for name, item in content.items():
        if isinstance(item, Mapping):
            found |= _flat(item, f"{where}{name}.")
        elif isinstance(item, np.ndarray) and item.dtype.kind in "fiub":
            found[f"{where}{name}"] = np.squeeze(item).astype(float)
    return found


def _mat73(path: Path) -> dict[str, Array]:
    try:
        import h5py  # noqa: PLC0415
    except ImportError as error:
        raise RecordError(f"{path}: MAT v7.3 needs the package h5py; install it, or save with -v7") from error
    found: dict[str, Array] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and not name.startswith("#"):
            if item.external or item.is_virtual:
                raise RecordError(f"{path}: {name} keeps its samples in another file; save them in this one")
            found[name.replace("/", ".")] = np.squeeze(np.asarray(item, float))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


def _parquet(path: Path) -> dict[str, Array]:
    try:
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise RecordError(f"{path}: Parquet needs the package pyarrow; install it, or save as CSV") from error
    table = parquet.ParquetFile(path).read()
    columns = zip(table.column_names, table.columns, strict=True)
    return {name: np.asarray(column.to_numpy(), float) for name, column in columns if "string" not in str(column.type)}


def _record(table: Mapping[str, Array], columns: Columns) -> tuple[Record, tuple[str, ...]]:
    """The record in SI units and the signals that the file has. Raises RecordError."""
    signals = {signal: _signal(table, columns, signal) for signal in NEEDED}
    for signal in OPTIONAL:
        own = getattr(columns, signal) != getattr(Columns(), signal)  # what was mapped must be there
        if own or columns.source(signal).name in table:
            signals[signal] = _signal(table, columns, signal)
    lengths = {signal: column.size for signal, column in signals.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{signal} {length}" for signal, length in lengths.items())
        raise RecordError(f"columns of different lengths ({said}); export them over the same samples")
    sample_time = check_samples(signals, {signal: columns.source(signal).name for signal in signals})
    zero = np.zeros(lengths["time"])
    target, reference = signals.get("target"), signals.get("reference")
    target = target if target is not None else reference if reference is not None else zero
    reference = reference if reference is not None else target
    record = Record(
        sample_time, target, reference, signals.get("feedforward", zero), signals["command"], signals["position"]
    )
    return record, tuple(signals)


def _response(table: Mapping[str, Array], columns: Columns) -> FrequencyResponse:
    """A measured frequency response, sorted; phase in degrees or radians, magnitude plain or in decibels."""
    frequency, magnitude = _signal(table, columns, "frequency"), _signal(table, columns, "magnitude")
    phase = np.deg2rad(_signal(table, columns, "phase"))
    if not all(np.all(np.isfinite(column)) for column in (frequency, magnitude, phase)):
        raise RecordError("values that are not finite in the frequency response; leave those lines out")
    if np.any(frequency <= 0) or np.any(magnitude <= 0):
        raise RecordError(
            "frequencies and magnitudes must be above 0; leave the other lines out, or mark decibels [dB]"
        )
    relative = columns.source("deviation").name
    deviation = table[relative] if relative in table else np.full(frequency.size, np.nan)
    order = np.argsort(frequency)
    response = np.asarray(magnitude * np.exp(1j * phase), complex)
    variance = (np.abs(response) * deviation) ** 2
    return FrequencyResponse(frequency[order], response[order], variance[order], np.full(frequency.size, np.nan), 0.0)


def _signal(table: Mapping[str, Array], columns: Columns, signal: str) -> Array:
    source = columns.source(signal)
    if source.name not in table:
        close = difflib.get_close_matches(source.name, list(table), n=1, cutoff=0.0)
        nearest = f"the nearest that the file has is {close[0]!r}" if close else "the file has no columns"
        raise RecordError(
            f"column {source.name!r} for the {signal} is missing; {nearest}; rename it, or map it by "
            f'{signal} = "NAME [unit] * factor" in the machine file\'s [record] or by --column'
        )
    column = table[source.name] * source.factor
    return source.factor * 10.0 ** (table[source.name] / 20) if source.decibels else column
