"""How a text file is laid out: separator, decimal mark, title lines, names, units, and where the numbers begin.

Decided by what holds of most of the last lines of its first chunk, which are rows of numbers in any log: the separator
is the one by which most of them fall into as many cells, and the numbers begin in the first line that is as they are.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from models.quantity import cut, listed
from models.records.tables.sizes import RecordError
from models.records.tables.text.headers import are_units, bare_unit, is_clock, told_apart, unit_in

SEPARATORS: Final = (";", "\t", ",", None)  # None: any number of blanks
_SPOKEN: Final = {";": "semicolons", "\t": "tabs", ",": "commas", None: "blanks", "|": "bars"}
MISSING: Final = frozenset({"", "nan", "na", "n/a", "#n/a", "#nv", "null", "none", "-", "--", "---"})
LOOKED_AT: Final = 50  # of the last lines
COMMENTS: Final = ("#", "%", "//")
NO_ROWS: Final = "has no rows below its first line; export the samples too"
# Rows in which TwinCAT Scope states what its channels are; each repeats its key where a channel group begins, which is
# over the column of the group's times (Beckhoff, TE13xx Scope View, CSV export).
SCOPE: Final = frozenset(
    {"SymbolName", "SymbolComment", "Data-Type", "SampleTime[ms]", "NetID", "NetId", "ScaleFactor"}
)


@dataclass(frozen=True)
class Layout:
    """Of a text file.

    separator: None for blanks. comma: whether numbers may have decimal commas. first: lines before the numbers. cells:
    of each row. headers: of the columns, "" for one without. units: of those for which they are stated. text: columns
    that hold no numbers, with an example. clocks: column -> the column of its times. lines: of the names and of the
    units, counted from 1. remarks: what else is to be said.
    """

    separator: str | None
    comma: bool
    decimal_comma: bool
    first: int
    cells: int
    headers: tuple[str, ...] = ()
    units: Mapping[int, str] = field(default_factory=dict)
    text: Mapping[int, str] = field(default_factory=dict)
    clocks: Mapping[int, int] = field(default_factory=dict)
    lines: tuple[int, int] = (0, 0)
    remarks: tuple[str, ...] = ()

    def recognised(self) -> tuple[str, ...]:
        """The layout in phrases."""
        names, units = self.lines
        return (
            f"columns separated by {_SPOKEN.get(self.separator, repr(self.separator))}",
            *(["decimal comma"] if self.decimal_comma else []),
            f"names in line {names}" if names else "no names",
            *([f"units in line {units}"] if units else []),
            f"numbers from line {self.first + 1}",
            *self.remarks,
        )


def split(line: str, separator: str | None) -> list[str]:
    """The cells of a line, without quotation marks."""
    if separator is None:
        return line.replace('"', "").split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    return [cell.strip() for cell in line.split(separator)]


def number(cell: str, *, comma: bool) -> float | None:
    """The number in a cell [as the file has it], NaN for an empty or missing one, None for text."""
    if cell.lower() in MISSING:
        return float("nan")
    try:
        return None if "_" in cell else float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        return None


def is_left_out(cells: Sequence[str]) -> bool:
    """Whether a line is to be passed over: empty, a comment, or a mark of the end."""
    return not any(cells) or cells[0].startswith("#") or (len(cells) == 1 and cells[0].upper() in {"EOF", "END"})


def layout_of(lines: Sequence[str]) -> Layout:
    """The layout of a file that begins with these whole lines. Raises RecordError where there are no numbers."""
    stated = lines[0][4:5] if lines and lines[0].lower().startswith("sep=") else ""
    used = [line for line in lines[bool(stated) :] if line.strip()][-LOOKED_AT:]
    tried = [_by_separator(used, separator) for separator in ((stated,) if stated else SEPARATORS)]
    candidates = [(found[0] * (1 - len(found[1].text) / found[1].cells), found[1]) for found in tried if found]
    if not candidates:
        raise RecordError(_why_no_rows(used))
    rows = max(candidates, key=lambda one: one[0])[1]  # the first of those that explain as many lines
    rows = replace(rows, first=_first(lines, rows, bool(stated)))
    return _named(lines, rows, bool(stated))


def _why_no_rows(lines: Sequence[str]) -> str:
    alone = [number(line.strip(" ;,\t"), comma=True) for line in lines[1:]]
    if alone and alone[-1] is not None:
        return "has one column of numbers; export time, command and position in one file"
    return NO_ROWS


def _by_separator(lines: Sequence[str], separator: str | None) -> tuple[int, Layout] | None:
    """How many of the lines are rows of numbers where this separates the cells, and the layout of such rows."""
    rows = [split(line, separator) for line in lines if not line.startswith(COMMENTS)]
    rows = [row for row in rows if sum(_counts(cell) for cell in row) > 1]
    if not rows:
        return None
    cells = max(Counter(map(len, rows)).items(), key=lambda one: one[1])[0]
    rows = [row for row in rows if len(row) == cells]
    text = {}
    for j in range(cells):
        wrong = [row[j] for row in rows if number(row[j], comma=True) is None]
        if 2 * len(wrong) > sum(bool(row[j]) for row in rows):
            text[j] = wrong[0]
    numeric = "".join(f"{cell} " for row in rows for j, cell in enumerate(row) if j not in text)
    if "," in numeric and "." in numeric:
        if separator == ",":
            raise RecordError("numbers have decimal points and commas; export them without a thousands separator")
        if _both(rows, text):
            return None
    comma = separator != "," or "," in numeric
    return len(rows), Layout(
        separator, comma and not ("." in numeric and "," not in numeric), "," in numeric, 0, cells, text=text
    )


def _both(rows: Sequence[Sequence[str]], text: Mapping[int, str]) -> bool:
    """Raises RecordError for numbers such as 1.234,5; whether cells with points are beside such with commas."""
    for row in rows:
        for j, cell in enumerate(row):
            if j not in text and "," in cell and "." in cell:
                raise RecordError(
                    f"numbers such as {cut(cell, 40)} have decimal points and commas; export them without a thousands "
                    "separator"
                )
    return True


def _counts(cell: str) -> bool:
    """Whether a cell shows that its line is a row of numbers."""
    found = number(cell, comma=True)
    return found is not None and cell != ""


def _first(lines: Sequence[str], rows: Layout, stated: bool) -> int:
    """The index of the first line that is as the rows are, as is the next: a line above the names may number them."""
    alone = None
    used = (i for i, line in enumerate(lines) if line.strip() and not line.startswith(COMMENTS))
    for i in used:
        if (stated and i == 0) or not _is_row(lines[i], rows):
            continue
        following = next((line for line in lines[i + 1 :] if line.strip() and not line.startswith(COMMENTS)), None)
        if following is None or _is_row(following, rows):
            return i
        alone = i if alone is None else alone
    if alone is None:
        raise RecordError(NO_ROWS)
    return alone


def _is_row(line: str, rows: Layout) -> bool:
    """Whether a line is as the rows are."""
    cells = split(line, rows.separator)
    kinds = [number(cell, comma=rows.comma) for j, cell in enumerate(cells) if j not in rows.text]
    return len(cells) == rows.cells and None not in kinds and sum(bool(cell) for cell in cells) > 1


def _named(lines: Sequence[str], rows: Layout, stated: bool) -> Layout:
    """The layout with what the lines above the numbers say."""
    above = [(i + 1, line) for i, line in enumerate(lines[: rows.first]) if line.strip() and not (stated and i == 0)]
    while len(above) > 1 and above[-1][1].startswith(COMMENTS) and len(_header(above[-1][1], rows)) != rows.cells:
        above.pop()  # a remark between the names and the numbers
    if not above:
        headers = tuple(f"column {j + 1}" for j in range(rows.cells))
        return replace(rows, headers=headers, remarks=('called "column 1", "column 2", ...',))
    if (scope := _scope(above, rows)) is not None:
        return scope
    at, names = above[-1][0], _header(above[-1][1], rows)
    units: dict[int, str] = {}
    line_of_units = 0
    before = _header(above[-2][1], rows) if len(above) > 1 else []
    if names == before:  # written twice
        above, before = above[:-1], _header(above[-3][1], rows) if len(above) > 2 else []
    if len(before) == len(names) > 0 and _are_names(before) and are_units(names):
        units = {j: bare_unit(cell) for j, cell in enumerate(names) if cell}
        line_of_units, at, names = at, above[-2][0], before
        above = above[:-1]
        before = _header(above[-2][1], rows) if len(above) > 1 else []
    _check_names(names, rows, at)
    names += [""] * (rows.cells - len(names))
    named = replace(rows, headers=tuple(names), units=units, lines=(at, line_of_units))
    repeated = len(set(filter(None, names))) < sum(map(bool, names))
    if repeated and len(before) > 1 and _are_names(before):
        named = _by_channel(named, [*before, *[""] * (rows.cells - len(before))])
    return _with_units(named)


def _header(line: str, rows: Layout) -> list[str]:
    """The names in a line, without a comment's mark before them and empty cells behind them."""
    bare = line
    for mark in COMMENTS:
        bare = bare.removeprefix(mark)
    if rows.separator is not None:
        cells = split(bare.strip() if bare != line else bare, rows.separator)
    else:
        cells = _blank_separated(bare, rows.cells)
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _blank_separated(line: str, count: int) -> list[str]:
    """The names in a line of which some may hold blanks, as "Zeit [ms]" does, where there ought to be so many."""
    words, joined = split(line, None), list[str]()
    for word in words:
        if joined and word[0] in "[(":
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    apart = [cell.strip() for cell in line.replace("\t", "  ").split("  ") if cell.strip()]
    return next((found for found in (joined, words, apart) if len(found) == count), joined)


def _are_names(cells: Sequence[str]) -> bool:
    return sum(_counts(cell) for cell in cells) == 0


def _check_names(headers: Sequence[str], rows: Layout, at: int) -> None:
    """Raises RecordError for a line that can't hold the names of the columns."""
    numbers = [cell for cell in headers if _counts(cell)]
    if len(numbers) > 1 and len(headers) == rows.cells:
        wrong = next((cell for cell in headers if not _counts(cell)), "")
        raise RecordError(
            f"line {at}: could not convert string to float: {cut(wrong, 40)}; write numbers only below the names"
        )
    if len(headers) > rows.cells or len(headers) < rows.cells - 1:
        comma = rows.separator == "," and rows.cells > len(headers)
        hint = "; if its numbers have decimal commas, export them with points, or separated by semicolons" * comma
        raise RecordError(f"{rows.cells} columns but {len(headers)} names in line {at}; name every column{hint}")


def _by_channel(named: Layout, channels: Sequence[str]) -> Layout:
    """Columns of several channels whose fields have the same names below them: "Time", "Value", "Time", "Value"."""
    filled, last = [], ""
    for channel in channels:
        last = channel or last
        filled.append(last)
    fields = named.headers
    clocks = {j: filled[j] for j in range(named.cells) if is_clock(fields[j])}
    values = Counter(filled[j] for j in range(named.cells) if j not in clocks and fields[j])
    headers, times = list[str](), dict[int, int]()
    for j, (channel, own) in enumerate(zip(filled, fields, strict=True)):
        name, unit = unit_in(own)
        alone = j not in clocks and values[channel] == 1
        shown = channel if alone else f"{channel} {name}".strip()
        headers.append(f"{shown} [{unit}]" if unit else shown)
        if j not in clocks:
            times.update((j, clock) for clock, of in clocks.items() if of == channel)
    below = named.lines[0]
    return replace(named, headers=tuple(headers), clocks=times, remarks=(f"channels above line {below}",))


def _with_units(named: Layout) -> Layout:
    """The layout with the units that stand behind the names, where no line of its own states them."""
    units = {j: unit for j, header in enumerate(named.headers) if (unit := unit_in(header)[1])}
    stripped = [unit_in(header)[0] for header in named.headers]
    repeated = {name for name, count in Counter(stripped).items() if name and count > 1}
    numbered = told_apart(stripped)
    headers = [
        new if name in repeated else header for header, name, new in zip(named.headers, stripped, numbered, strict=True)
    ]
    said = [f"columns of one name are numbered: {cut(listed(sorted(repeated)))}"] if repeated else []
    return replace(named, headers=tuple(headers), units={**units, **named.units}, remarks=(*named.remarks, *said))


def _scope(above: Sequence[tuple[int, str]], rows: Layout) -> Layout | None:
    """The layout of an export of TwinCAT Scope; None for any other file."""
    table = [(at, split(line, rows.separator)) for at, line in above]
    keyed = {cells[0]: (at, cells) for at, cells in table if cells and len(cells) + 1 >= rows.cells}
    if "Name" not in keyed or not (SCOPE & {cells[0] for _, cells in table} or table[0][1][0] == "Name"):
        return None
    at, names = keyed["Name"]
    if at == table[0][0] and len(table) > 1 and not SCOPE & set(keyed):
        return None
    names = [*names, ""][: rows.cells]
    starts = [j for j, name in enumerate(names) if name == "Name"]
    clocks = {j: max(start for start in starts if start < j) for j in range(rows.cells) if j not in starts}
    headers = [f"time of {names[j + 1]}" if j in starts and j + 1 < len(names) else names[j] for j in range(rows.cells)]
    if len(starts) == 1:
        headers[0] = "time"
    stated = keyed.get("Unit", (0, []))[1]
    units = dict.fromkeys(starts, "ms")
    units |= {j: unit for j, unit in enumerate(stated) if j in clocks and unit and unit.lower() != "none"}
    scaled = [headers[j] for j in clocks if _of(keyed, "ScaleFactor", j) not in {"", "1", "1.0"}]
    said = ["TwinCAT Scope, times in ms"]
    if scaled:
        said.append(f"the scale factors that it states for {cut(listed(scaled))} are not applied")
    found = replace(rows, headers=tuple(headers), units=units, clocks=clocks, lines=(at, 0), remarks=tuple(said))
    return replace(found, headers=tuple(told_apart(found.headers)))


def _of(keyed: Mapping[str, tuple[int, list[str]]], key: str, column: int) -> str:
    cells = keyed.get(key, (0, []))[1]
    return cells[column].replace(",", ".") if column < len(cells) else ""
