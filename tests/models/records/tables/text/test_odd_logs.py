"""Logs as drives, oscilloscopes and spreadsheets write them: each is read as it comes, or refused in one line."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from models.records.columns import Columns
from models.records.files import load
from models.records.record import Record
from models.records.tables.reader import read_table
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]

COUNT = 120
TIME = 0.25 * np.arange(COUNT)  # ms
FORCE = np.round(12 * np.sin(np.arange(COUNT) / 9.0), 3)  # N
POSITION = np.round(0.02 * np.cos(np.arange(COUNT) / 11.0), 6)  # mm
MAPPED = Columns(time="Zeit", command="Kraft", position="Position")
NAMES = ("Zeit [ms]", "Kraft [N]", "Position [mm]")


def rows(separator: str = ";", *, comma: bool = False, quote: str = "", end: str = "\n") -> str:
    """The samples as text."""
    lines = []
    for row in zip(TIME, FORCE, POSITION, strict=True):
        cells = [f"{quote}{value:.6f}{quote}" for value in row]
        lines.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells) + end)
    return "".join(lines)


def log(*heading: str, names: Sequence[str] = NAMES, separator: str = ";", body: str | None = None) -> str:
    """A log with lines above its names."""
    return "\n".join([*heading, separator.join(names)]) + "\n" + (rows(separator) if body is None else body)


def loaded(path: Path, text: str, columns: Columns = MAPPED, encoding: str = "utf-8") -> Record:
    path.write_bytes(text.encode(encoding))
    content = load(path, columns).content
    assert isinstance(content, Record)
    return content


def same(record: Record) -> None:
    assert record.sample_time == pytest.approx(250e-6, rel=1e-9)
    np.testing.assert_allclose(record.command, FORCE, atol=1e-9)
    np.testing.assert_allclose(record.position, 1e-3 * POSITION, atol=1e-15)


UNITS_BELOW = "Zeit;Kraft;Position\n{};{};{}\n"
TWINCAT = (
    ("Name", "YT Scope Project"),
    ("File", "C:\\log.svdx"),
    ("Starttime of export", "133000000000000000", "Monday"),
    ("",),
    ("Name", "MAIN.fForce", "Name", "MAIN.fPos"),
    ("SymbolComment", "", "SymbolComment", ""),
    ("Data-Type", "REAL64", "Data-Type", "REAL64"),
    ("SampleTime[ms]", "0,25", "SampleTime[ms]", "0,25"),
    ("ScaleFactor", "1", "ScaleFactor", "1"),
    ("Unit", "N", "Unit", "mm"),
    ("",),
)

READ: dict[str, str] = {
    "units behind the names": log(),
    "title lines": log("Logger 4.2", "Date;12.05.2024", "", "Channels;3;Rate;4000"),
    "title of as many cells": log("Trace;of;axis X"),
    "the columns' numbers above their names": log("1;2;3"),
    "units in a line of their own": UNITS_BELOW.format("ms", "N", "mm") + rows(),
    "units in brackets below": "Title\n" + UNITS_BELOW.format("[ms]", "[N]", "[mm]") + rows(),
    "units in round brackets": log(names=("Zeit (ms)", "Kraft (N)", "Position (mm)")),
    "units behind a slash": log(names=("Zeit/ms", "Kraft / N", "Position/mm")),
    "units behind in": log(names=("Zeit in ms", "Kraft in N", "Position in mm")),
    "units behind an underscore": log(names=("Zeit_ms", "Kraft_N", "Position_mm")),
    "semicolons, decimal comma": log(body=rows(";", comma=True)),
    "tabs": log(separator="\t"),
    "tabs, decimal comma": log(separator="\t", body=rows("\t", comma=True)),
    "commas": log(separator=","),
    "commas, decimal comma in quotes": log(separator=",", body=rows(",", comma=True, quote='"')),
    "blanks": log(separator="  ", body=rows("   ")),
    "blanks, decimal comma": log(separator=" ", body=rows(" ", comma=True)),
    "blanks before each line": log(separator=" ", body="".join(f"  {line}\n" for line in rows(" ").splitlines())),
    "bars as Excel states them": "sep=|\n" + log(separator="|"),
    "Excel's first line": "sep=;\n" + log(),
    "a comment before the names": "# Zeit [ms] Kraft [N] Position [mm]\n" + rows(" "),
    "comments between": log("% made by a script", body="# begin\n" + rows()),
    "the names twice": log(";".join(NAMES)),
    "a separator at the end of each line": log(body=rows(end=";\n")),
    "a separator at the end of all lines": log(names=(*NAMES, ""), body=rows(end=";\n")),
    "quoted cells": log(names=[f'"{name}"' for name in NAMES], body=rows(quote='"')),
    "a column of text": log(names=("State", *NAMES), body="".join(f"RUN;{line}\n" for line in rows().splitlines())),
    "an unused column of one name twice": log(names=("x", *NAMES, "x"),
                                              body="".join(f"1;{line};2\n" for line in rows().splitlines())),
    "empty cells in a column that is not used": log(names=(*NAMES, "v"), body=rows(end=";\n")),
    "missing values in a column that is not used": log(names=(*NAMES, "v"), body=rows(end=";n/a\n")),
    "an end mark": log(body=rows() + "EOF\n"),
    "empty rows of a spreadsheet": log(body=rows() + ";;\n;;\n"),
    "Windows' ends of lines": log().replace("\n", "\r\n"),
    "old ends of lines": log().replace("\n", "\r"),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(READ))
def test_an_odd_log_is_read_as_it_comes(kind: str, tmp_path: Path) -> None:
    same(loaded(tmp_path / "log.csv", READ[kind]))


@pytest.mark.parametrize(
    ("encoding", "mark", "said"),
    [
        ("utf-8", b"", "UTF-8"),
        ("utf-8", codecs.BOM_UTF8, "UTF-8 with a byte order mark"),
        ("utf-16-le", codecs.BOM_UTF16_LE, "UTF-16"),
        ("utf-16-be", codecs.BOM_UTF16_BE, "UTF-16"),
        ("utf-16-le", b"", "UTF-16, little-endian"),
        ("utf-16-be", b"", "UTF-16, big-endian"),
        ("cp1252", b"", "Windows-1252"),
    ],
)
def test_any_usual_encoding_is_recognised(encoding: str, mark: bytes, said: str, tmp_path: Path) -> None:
    text = log("Prüfstand 3", names=("Zeit [ms]", "Kraft [N]", "Größe [µm]"))
    path = tmp_path / "log.csv"
    path.write_bytes(mark + text.encode(encoding))
    content = load(path, Columns(time="Zeit", command="Kraft", position="Größe")).content
    assert isinstance(content, Record)
    np.testing.assert_allclose(content.position, 1e-6 * POSITION, atol=1e-18)
    assert read_table(path).recognised[0] == said


@pytest.mark.parametrize("separator", ["\t", ";"])
def test_an_export_of_twincat_scope_is_read_with_a_clock_for_each_channel(separator: str, tmp_path: Path) -> None:
    heading = "".join(separator.join(cells) + "\n" for cells in TWINCAT)
    body = "".join(
        separator.join(f"{value:.6f}".replace(".", ",") for value in (t, u, t, x)) + "\n"
        for t, u, x in zip(TIME, FORCE, POSITION, strict=True)
    )
    columns = Columns(command="MAIN.fForce", position="MAIN.fPos")
    same(loaded(tmp_path / "scope.csv", f"{heading}{body}EOF\n", columns))
    table = read_table(tmp_path / "scope.csv")
    assert table.units["MAIN.fPos"] == "mm"
    assert table.clocks["MAIN.fPos"] == "time of MAIN.fPos"
    assert "TwinCAT Scope, times in ms" in table.recognised


def test_a_scope_export_with_the_names_alone_has_one_clock_for_a_group(tmp_path: Path) -> None:
    heading = "Name,YT Scope Project\nName,MAIN.fForce,MAIN.fPos\n"
    columns = Columns(command="MAIN.fForce [N]", position="MAIN.fPos [mm]")
    same(loaded(tmp_path / "scope.csv", heading + rows(","), columns))


def test_channels_above_fields_of_the_same_names(tmp_path: Path) -> None:
    heading = "Kraft;;Position;\nTime [ms];Value [N];Time [ms];Value [mm]\n"
    body = "".join(f"{t:.2f};{u:.3f};{t:.2f};{x:.6f}\n" for t, u, x in zip(TIME, FORCE, POSITION, strict=True))
    same(loaded(tmp_path / "log.csv", heading + body, Columns(command="Kraft", position="Position")))


def test_a_log_without_names_is_mapped_by_the_columns_numbers(tmp_path: Path) -> None:
    columns = Columns(time="column 1 [ms]", command="column 2", position="column 3 [mm]")
    same(loaded(tmp_path / "log.csv", rows(), columns))


@pytest.mark.parametrize("entry", ["Position", "Position [mm]", "Position (mm)", "Position_mm", "Position/mm"])
def test_a_column_is_mapped_with_or_without_its_unit(entry: str, tmp_path: Path) -> None:
    written = "Position (mm)" if entry.startswith("Position [") or entry == "Position" else entry
    names = ("Zeit [ms]", "Kraft [N]", written)
    same(loaded(tmp_path / "log.csv", log(names=names), Columns(time="Zeit [ms]", command="Kraft", position=entry)))


def test_counts_sample_counters_and_currents_are_mapped_by_their_factors(tmp_path: Path) -> None:
    text = "sample;current [A];xist [Inc]\n" + "".join(
        f"{k};{u / 31.5:.9f};{round(x / 5e-6)}\n" for k, (u, x) in enumerate(zip(FORCE, POSITION, strict=True))
    )
    columns = Columns(time="sample * 250 us", command="current * 31.5 N/A", position="xist * 5 nm")
    record = loaded(tmp_path / "log.csv", text, columns)
    assert record.sample_time == pytest.approx(250e-6)
    np.testing.assert_allclose(record.command, FORCE, atol=1e-6)
    np.testing.assert_allclose(record.position, 1e-3 * POSITION, atol=2.6e-9)


def test_times_rounded_to_milliseconds_are_made_again_and_a_count_of_rows_needs_none(tmp_path: Path) -> None:
    body = "".join(f"{t:.0f};{u:.3f};{x:.6f}\n" for t, u, x in zip(TIME, FORCE, POSITION, strict=True))
    same(loaded(tmp_path / "log.csv", log(body=body), MAPPED))
    assert (
        load(tmp_path / "log.csv", MAPPED).findings[0].startswith("The times in 'Zeit' are rounded to 1 ms and are th")
    )
    same(loaded(tmp_path / "log.csv", log(body=body), replace(MAPPED, time="row * 250 us")))


def replaced(line: int, change: Callable[[str], str]) -> str:
    lines = log().splitlines()
    lines[line - 1] = change(lines[line - 1])
    return "\n".join(lines) + "\n"


REFUSED: dict[str, tuple[str, str]] = {
    "an unknown unit": (log(names=("Zeit [ms]", "Kraft [N]", "Position [Inc]")),
                        "column 'Position' is in 'Inc', as the file states"),
    "a current without its factor": (log(names=("Zeit [ms]", "Kraft [A]", "Position [mm]")), "command = .Kraft . 35 N"),
    "a current behind an underscore": (log(names=("Zeit [ms]", "Kraft_A", "Position [mm]")), "'Kraft' is in 'A', as"),
    "two columns of one name": (log(names=("Zeit [ms]", "Kraft [N]", "Position [mm]", "Position [um]"),
                                    body=rows(end=";1\n")), r"several columns are called 'Position'; map one of them"),
    "decimal commas between commas": (log(separator=",", body=rows(",", comma=True)),
                                      "6 columns but 3 names in line 1; .* export them with points"),
    "thousands separators": (replaced(100, lambda _: "1.234,5;0;0"), "have decimal points and commas"),
    "an empty cell": (replaced(50, lambda line: line.rpartition(";")[0] + ";"), "'Position' has 1 values that are not"),
    "NaN": (replaced(50, lambda line: line.rpartition(";")[0] + ";NaN"), "'Position' has 1 values that are not numb"),
    "text among numbers": (replaced(50, lambda _: "0;zero;0"), "line 50: could not convert string to float: 'zero'"),
    "another number of cells": (replaced(50, lambda _: "0;1"), "line 50 has 2 cells"),
    "a second log behind the first": (log() + log(), "line 122: is text as above the numbers; give two logs as two"),
    "a column of text as a signal": ("Zeit;Kraft;Position\n" + "".join(f"10:11:12.{k:03};1;{k}\n" for k in range(50)),
                                     "column 'Zeit' holds text such as '10:11:12.0.*; map one of numbers"),
    "one column": ("Zeit\n" + "1.0\n" * 50, "has one column of numbers"),
    "names alone": (";".join(NAMES) + "\n", "has no rows below its first line"),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(REFUSED))
def test_what_cannot_be_read_is_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    text, says = REFUSED[kind]
    with pytest.raises(RecordError, match=says) as error:
        loaded(tmp_path / "log.csv", text)
    assert "\n" not in str(error.value)


def test_what_was_recognised_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("Logger\n" + UNITS_BELOW.format("ms", "N", "mm") + rows(comma=True), encoding="utf-8")
    assert read_table(path).recognised == (
        "ASCII",
        "columns separated by semicolons",
        "decimal comma",
        "names in line 2",
        "units in line 3",
        "numbers from line 4",
    )


def test_what_was_recognised_is_a_table_for_the_user(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    text = "sample;current [A];xist [Inc]\n" + "".join(f"{k};{k % 7};{k % 11}\n" for k in range(COUNT))
    path.write_text(text, encoding="utf-8")
    columns = Columns(time="sample * 250 us", command="current * 31.5 N/A", position="xist * 5 nm")
    assert load(path, columns).recognised == (
        "ASCII, columns separated by semicolons, names in line 1, numbers from line 2",
        "  quantity  column   unit  one is",
        "  time      sample         0.00025 s",
        "  command   current  A     31.5 N",
        "  position  xist     Inc   5e-09 m",
        "  120 samples every 250 µs, 30 ms in all",
    )
