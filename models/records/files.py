"""Records and frequency responses from the files that drives, oscilloscopes and spreadsheets write, in SI units.

`read` gives whatever the file holds under its own names; `load` maps the names by `Columns`, checks, and returns a
Record or a measured FrequencyResponse, whichever the file is. Every fault is one sentence in a RecordError.
"""

from __future__ import annotations

import difflib
import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.effects.base import Effect, Place
from models.feedback.law import Law
from models.identification.response import FrequencyResponse
from models.machine import Machine
from models.quantity import cut
from models.records import response_columns
from models.records.checks import DoubtfulError, Facts, derivative_of_error, findings
from models.records.columns import UNITS, Columns, drive_unit
from models.records.grids import on_one_grid
from models.records.plausible import doubts
from models.records.recognised import recognised
from models.records.record import Column, Record
from models.records.sampling import ROW, sampling
from models.records.tables.reader import read_table
from models.records.tables.sizes import LIMITS, Limits, RecordError
from models.records.tables.table import Table

Array = NDArray[np.float64]
NEEDED: Final = ("time", "command", "position")
OPTIONAL: Final = ("target", "reference", "error", "feedforward")
NEXT_TO_A_TURN: Final = 0.05  # of a turn, by which an angle may move on in a sample in which it jumps by a turn
PATH_ROUNDING: Final = 8 * float(np.finfo(float).eps)  # of a path: differences up to which are arithmetic's


@dataclass(frozen=True)
class Loaded:
    """One file: its name, its SHA-256, what it holds, which signals were in it, and what is to be said about it.

    recognised: how it was read, a table in lines of text.
    """

    name: str
    sha256: str
    content: Record | FrequencyResponse
    given: tuple[str, ...]
    findings: tuple[str, ...]
    recognised: tuple[str, ...] = ()


def load(
    path: Path, columns: Columns | None = None, *, trusted: bool = False, limits: Limits = LIMITS, **known: Any
) -> Loaded:
    """The record or frequency response in a file. `known`: the fields of `checks.Facts`, as far as they are known [SI].

    A file with a column for `frequency` and none for `position` is a frequency response. Signals that the file leaves
    out: the reference is then the position and the following error, or the target (or it the reference, or both zero),
    and the feedforward zero. trusted: what
    makes a record implausible is said among the findings, instead of refusing it. Raises RecordError.
    """
    columns, facts = columns or Columns(), Facts(**known)
    names = {signal: columns.source(signal).name for signal in UNITS}
    table = read_table(path, {*_columns_of(columns, UNITS), *response_columns.ALSO}, limits)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    try:
        if names["frequency"] in table.names and names["position"] not in table.names:
            response, used = _response(table, columns), {s: names[s] for s in ("frequency", "magnitude", "phase")}
            _check_units(table, columns, used, facts)
            return Loaded(
                path.name, digest, response, (), (), recognised(table, columns, used, response, turns=facts.rotary)
            )
        record, given, placed = _record(table, columns, facts.sample_time)
        facts = facts.seen_in(record)
        by_error = "reference" in given and given["reference"] == names["error"]
        as_read = {"error" if by_error and signal == "reference" else signal: name for signal, name in given.items()}
        _check_units(table, columns, as_read, facts)
        ran = _as_it_ran(record, columns, facts)
        said = (*placed, *findings(ran, given, facts))
        doubted = doubts(record, set(given), facts, ran)
        if trusted:
            said = (*(f"{one[0].upper()}{one[1:]}." for one in doubted), *said)
        elif (one := next(doubted, None)) is not None:
            raise DoubtfulError(one)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    return Loaded(
        path.name, digest, record, tuple(given), said, recognised(table, columns, as_read, record, turns=facts.rotary)
    )


def read_record(
    path: str | Path, columns: Columns | None = None, *, machine: Machine | None = None, trusted: bool = False
) -> Record:
    """The signals (n,) [m], [N] of a record file of any format in `models.records.tables.formats`.

    columns: how the file calls its signals; by default as the machine maps them, or time_s, command_N, position_m, ...
    machine: that the record is said to be of, to see a wrong unit or sign; `diagnose` looks for the same.
    trusted: a record that looks wrong is read nevertheless.
    Raises RecordError, a sentence that says what is wrong and what to do, for a file that holds no such record.

    >>> record = pos.read_record(folder / "moves.csv")
    >>> record.sample_time, record.position.shape == record.command.shape
    (0.0005, True)
    """
    if columns is not None and not isinstance(columns, Columns):
        raise ValueError('columns: must be Columns, such as Columns(time="t / ms", command="u", position="x / mm")')
    known = {} if machine is None else known_of(machine)
    columns = columns or (machine.record if machine else None)
    content = load(Path(path), columns, trusted=trusted, **known).content
    if not isinstance(content, Record):
        raise RecordError(f"{path}: holds a frequency response; give a record of time, command and position")
    return content


def known_of(machine: Machine) -> dict[str, Any]:
    """The fields of `checks.Facts` [SI] that a machine states, to see more in its records."""
    return {
        "pid": machine.control.feedback,
        "reference_delay": machine.control.reference_delay,
        "sample_time": machine.sample_time,
        "mass": machine.plant.mass,
        "limit": machine.drive.rated_thrust,
        "resolution": machine.scale.resolution,
        "scatter": machine.scale.noisy().reading_deviation,
        "stiffness": float(sum(machine.friction.stiffness)) + sum(one.spring_to_ground() for one in machine.effects),
        "friction": machine.friction.coulomb_force,
        "rotary": machine.axis == "rotary",
        "offset": machine.drive.offset,
        "spring": sum(one.spring_to_ground() for one in machine.effects),
        "by_place": sum(map(_by_place, machine.effects)),
    }


def _by_place(effect: Effect) -> float:
    """The most [N] that an effect other than a spring to ground holds an axis by where it is; infinite if unknown."""
    if Place.FORCE not in effect.hooks or effect.coordinate not in {"", "position"} or effect.spring_to_ground():
        return 0.0
    return float(getattr(effect, "amplitude", math.inf))


def _as_it_ran(record: Record, columns: Columns, facts: Facts) -> Record:
    """The record for a replay of the PID, whatever its derivative was taken of. Raises RecordError for another law."""
    if facts.pid is None or columns.derivative == "error":
        return record
    if isinstance(facts.pid, Law):
        raise RecordError(
            "derivative: is of a plain PID, and the machine file states another feedback; leave it out of the columns, "
            "and for a PID with set-point weights state derivative_weight = 0 in [control.pid]"
        )
    return derivative_of_error(record, facts.pid, facts.reference_delay)


def read(path: Path, limits: Limits = LIMITS) -> dict[str, Array]:
    """Every numeric column (n,) of a file, under its own name and in its own unit [as the file has it].

    Raises RecordError for what can't be read, or holds more than `limits` says.
    """
    return dict(read_table(path, None, limits).columns)


def _record(table: Table, columns: Columns, expected: float | None) -> tuple[Record, dict[str, str], tuple[str, ...]]:
    """The record in SI units, the column of each signal that the file has, and sentences on what was made of its times.

    expected: the machine's sample time [s], if it is known. Raises RecordError.
    """
    signals, names, said = _signals(table, columns)
    lengths = {signal: column.size for signal, column in signals.items()}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{signal} {length}" for signal, length in lengths.items())
        raise RecordError(f"columns of different lengths ({shown}); export them over the same samples")
    if columns.source("position", table.units.get(names["position"], "")).rotary:
        signals, wrapped = _unwrapped(signals)
        said = (*said, *wrapped)
    sampled = sampling(signals, names, expected)
    if (error := signals.pop("error", None)) is not None and "reference" not in signals:
        signals["reference"], names["reference"] = signals["position"] + error, names["error"]
    zero = np.zeros(lengths["time"])
    target, reference = signals.get("target"), signals.get("reference")
    target = target if target is not None else reference if reference is not None else zero
    reference = reference if reference is not None else target
    record = Record(
        sampled.sample_time,
        _standing(target),
        _standing(reference),
        signals.get("feedforward", zero),
        signals["command"],
        signals["position"],
        columns=(Column(names["feedforward"], signals["feedforward"], mapped=True),)
        if "feedforward" in signals
        else (),
    )
    return record, {signal: names[signal] for signal in signals}, (*said, *sampled.said)


def _unwrapped(signals: Mapping[str, Array]) -> tuple[dict[str, Array], tuple[str, ...]]:
    """The signals (n,) [SI] of an axis whose angle jumps by a turn where its drive counts on from 0, without these
    jumps, and a sentence on it. Reference and target, where they stay within a turn, are taken at the turn at which the
    position is."""
    steps = np.diff(signals["position"], prepend=signals["position"][:1])
    turns = np.round(steps / math.tau)
    if not np.any(turns) or np.any(np.abs(steps - math.tau * turns) > NEXT_TO_A_TURN * math.tau):
        return dict(signals), ()
    position = signals["position"] - math.tau * np.cumsum(turns)
    whole = {"position": position}
    for name in {"reference", "target"} & signals.keys():
        whole[name] = _at_turn_of(position, signals[name])
    if "error" in signals:  # of which position or reference had begun again by itself
        whole["error"] = signals["error"] - math.tau * np.round(signals["error"] / math.tau)
    count = int(np.count_nonzero(turns))
    times = "once" if count == 1 else f"{count} times"
    return {**signals, **whole}, (f"The position jumps by a turn {times}, as an angle that begins again; it goes on.",)


def _at_turn_of(position: Array, path: Array) -> Array:
    """A reference or a target (n,) [rad] that stays within a turn at the turn at which the position (n,) [rad] is, or,
    where it stands, as a target does, will be in the end."""
    if np.ptp(path) > math.tau:
        return np.asarray(path + math.tau * np.round((position[0] - path[0]) / math.tau))
    ends = np.append(np.flatnonzero(np.diff(path)), path.size - 1)
    last = ends[np.searchsorted(ends, np.arange(path.size))]
    return np.asarray(path + math.tau * np.round((position[last] - path) / math.tau))


def _standing(path: Array) -> Array:
    """A target or a reference (n,) [m] that stands still from the end of a motion on, up to the last halt before the
    next, where rounding alone moves it: a profile that is summed up in floating point had a motion of a
    hundred-millionth of a nanometre."""
    size = np.abs(np.diff(path, prepend=path[:1]))
    slight = size <= PATH_ROUNDING * float(np.max(np.abs(path), initial=0.0))
    begins = np.flatnonzero(slight & ~np.concatenate([[False], slight[:-1]]))
    ends = np.flatnonzero(slight & ~np.concatenate([slight[1:], [False]])) + 1
    still = path.copy()
    for i in np.flatnonzero(np.add.reduceat(slight & (size > 0), begins)) if begins.size else ():
        halts = np.flatnonzero(size[begins[i] : ends[i]] == 0)
        if halts.size:
            still[begins[i] : begins[i] + halts[-1] + 1] = path[max(begins[i] - 1, 0)]
    return still


def with_columns(loaded: Loaded, path: Path, columns: Columns, limits: Limits = LIMITS) -> Loaded:
    """A record with every other column of its file, as far as these are as long as it and not more than `limits`."""
    record = loaded.content
    if not isinstance(record, Record):
        return loaded
    try:
        found = read(path, limits)
    except RecordError:
        return loaded
    used = _columns_of(columns, (*NEEDED, *OPTIONAL))
    others = tuple(
        Column(name, values)
        for name, values in found.items()
        if name not in used and values.shape == record.command.shape
    )
    return replace(loaded, content=replace(record, columns=(*record.columns, *others)))


def _signals(table: Table, columns: Columns) -> tuple[dict[str, Array], dict[str, str], tuple[str, ...]]:
    """The signals (n,) [SI] of a record, the column of each, and what was done to bring them onto one grid of times.

    The time is the column that is mapped to it, or the clock that the file states for the other signals.
    """
    mapped = [s for s in (*NEEDED, *OPTIONAL) if getattr(columns, s) != getattr(Columns(), s)]  # these must be there
    names = {signal: columns.source(signal).name for signal in (*NEEDED, *OPTIONAL)}
    clocks = {signal: table.clocks[name] for signal, name in names.items() if name in table.clocks}
    if names["time"] in clocks.values():
        clocks["time"] = names["time"]
    wanted = [s for s in NEEDED if s != "time" or s in mapped or names[s] in table.columns or not clocks]
    wanted += [s for s in OPTIONAL if s in mapped or names[s] in table.columns]
    if names["time"] == ROW and ROW not in table.names:
        return _counted(table, columns, wanted), names, ()
    signals = {signal: _signal(table, columns, signal) for signal in wanted}
    if not clocks or not set(clocks) >= set(wanted) or ("time" in wanted and len(set(clocks.values())) == 1):
        return signals, names, ()
    used = sorted({clocks[signal] for signal in wanted})
    times = {clock: _in_si(table, columns, "time", clock) for clock in used}
    placed, grid, said = on_one_grid(signals, clocks, times)
    if "time" not in placed:
        placed, names["time"] = {"time": grid, **placed}, used[0]
    return placed, names, said


def _counted(table: Table, columns: Columns, wanted: Sequence[str]) -> dict[str, Array]:
    """The signals (n,) [SI] with a time that is the count of the rows, from 0. Raises RecordError."""
    signals = {signal: _signal(table, columns, signal) for signal in wanted if signal != "time"}
    rows = np.arange(signals["position"].size, dtype=np.float64)
    return {"time": rows * columns.source("time").factor, **signals}


def _response(table: Table, columns: Columns) -> FrequencyResponse:
    """A measured frequency response, sorted; phase in degrees or radians, magnitude plain or in decibels."""
    frequency, magnitude = _signal(table, columns, "frequency"), _signal(table, columns, "magnitude")
    phase = np.deg2rad(_signal(table, columns, "phase"))
    if not all(np.all(np.isfinite(column)) for column in (frequency, magnitude, phase)):
        raise RecordError("values that are not finite in the frequency response; leave those lines out")
    if np.any(frequency <= 0) or np.any(magnitude <= 0):
        raise RecordError(
            "frequencies and magnitudes must be above 0; leave the other lines out, or mark decibels [dB]"
        )
    deviation = response_columns.deviation(table.columns, table.names, columns, magnitude)
    rolled = response_columns.rolled(table.columns)
    order = np.argsort(frequency)
    response = np.asarray(magnitude * np.exp(1j * phase), complex)
    unknown = np.full(frequency.size, np.nan)
    return FrequencyResponse(frequency[order], response[order], deviation[order] ** 2, unknown, 0.0, rolled)


def _columns_of(columns: Columns, signals: Iterable[str]) -> set[str]:
    """The names of all columns that are mapped to signals."""
    return {one.source(signal).name for signal in signals for one in columns.terms(signal)}


def _signal(table: Table, columns: Columns, signal: str) -> Array:
    """A signal (n,) [SI]: its column, or the sum of its columns. Raises RecordError."""
    terms = columns.terms(signal)
    if len(terms) > 1:
        parts = [_signal(table, one, signal) for one in terms]
        if len({part.size for part in parts}) > 1:
            raise RecordError(f"the columns of the {signal} differ in length; export them over the same samples")
        return np.asarray(sum(parts[1:], parts[0]))
    source = columns.source(signal)
    if source.name not in table.columns:
        close = _nearest(table, columns, signal)
        told = f"the nearest that the file has is {cut(close)}; rename" if close else "the file has no other; log"
        raise RecordError(
            f"column {source.name!r} for the {signal} is missing; {told} it, or map it by "
            f'{signal} = "NAME [unit] * factor" in the machine file\'s [record] or by --column'
        )
    return _in_si(table, columns, signal, source.name)


def _nearest(table: Table, columns: Columns, signal: str) -> str:
    """The column that a missing one may be: of those that are no other signal's, and where their units are stated, of
    those in one of this signal's, the most similar by its name; empty where there is none."""
    others = _columns_of(columns, (other for other in UNITS if other != signal))
    free = [name for name in table.names if name not in others]
    fitting = [name for name in free if table.units.get(name) and _fits(columns, signal, table.units[name])]
    close = difflib.get_close_matches(columns.source(signal).name, fitting or free, n=1, cutoff=0.0)
    return close[0] if close else ""


def _fits(columns: Columns, signal: str, unit: str) -> bool:
    """Whether a unit that a file states is one of the signal's, whatever unit a mapping states; but for a force, which
    a mapping may make of a current."""
    try:
        (columns if signal in {"command", "feedforward"} else Columns()).source(signal, unit)
    except ValueError:
        return False
    return True


def _check_units(table: Table, columns: Columns, names: Mapping[str, str], facts: Facts) -> None:
    """Raises RecordError for a column in the units of an axis of the other kind; names: of each signal's column."""
    for signal, name in names.items():
        rotary = columns.source(signal, table.units.get(name, "")).rotary
        if facts.rotary is not None and rotary is not None and rotary != facts.rotary:
            kind, given = ("rotary", "units of a linear axis") if facts.rotary else ("linear", "angles or N m")
            raise RecordError(
                f"column {cut(name)} for the {signal} is in {given}, and the machine's axis is {kind}; correct the "
                'unit, or axis = "linear" or "rotary" above the tables of the machine file'
            )


def _in_si(table: Table, columns: Columns, signal: str, name: str) -> Array:
    """A column (n,) as this signal [SI]: by the unit of the mapping, else by that of the file. Raises RecordError."""
    column, stated = table.columns[name], table.units.get(name, "")
    try:
        source = columns.source(signal, stated)
    except ValueError as error:
        force = f"35 N/{drive}" if (drive := drive_unit(stated)) else "35 N"
        one = {"m": "5 nm", "s": "250 us", "N": force}.get(UNITS[signal], f"2 {UNITS[signal]}")
        raise RecordError(
            f"column {cut(name)} is in {cut(stated, 30)}, as the file states, which is not a unit of the {signal}; "
            f'write what one of it is, as in {signal} = "{name} * {one}", or its right unit, as in [{UNITS[signal]}]'
        ) from error
    return source.factor * 10.0 ** (column / 20) if source.decibels else column * source.factor
