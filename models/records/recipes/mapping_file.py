"""Mapping files (TOML): rules for columns as tables, and the recipes that come with the project, which are such files.

[[record]]                  # or [record], where one table is enough
files = "sweep*.mf4"        # a pattern, or a list of them; without it the table is for all files
time = "t [ms]"
command = "Iq [A] * 60 N/A"
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from models.records.recipes.rules import ALL, Rule
from models.records.tables.sizes import RecordError

FOLDER: Final = Path(__file__).parent
MAX_FILE_BYTES: Final = 1_000_000  # bytes of a mapping file
EXAMPLE: Final = 'write a table such as [[record]] with files = "sweep*.csv", time = "t [ms]", position = "x [mm]"'


def recipes() -> dict[str, Path]:
    """The recipes that come with the project, by their names."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def describe(name: str) -> str:
    """What a recipe is for, in the words of its file."""
    return str(tomllib.loads(recipes()[name].read_text(encoding="utf-8")).get("description", ""))


def read_rules(path: Path) -> tuple[Rule, ...]:
    """The rules of a mapping file, whose patterns need not all fit a file. Raises RecordError."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise RecordError(f"{path}: is larger than a mapping file can be; give one with a table for each record")
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordError(f"{path}: can't be read ({error.strerror}); give an existing mapping file") from error
    except (ValueError, RecursionError) as error:
        text = " ".join(str(error).split())[:200]
        raise RecordError(f"{path}: can't be read as TOML ({text}); correct it") from error
    unknown = sorted(set(content) - {"record", "description"})
    if unknown:
        raise RecordError(f"{path}: {unknown[0]!r} does not belong in a mapping file; {EXAMPLE}")
    tables = content.get("record")
    if isinstance(tables, dict):
        tables = [tables]
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise RecordError(f"{path}: must have a table for each record; {EXAMPLE}")
    return tuple(rule for at, table in enumerate(tables, 1) for rule in _rules(table, f"{path}: record {at}"))


def _rules(table: dict[str, Any], origin: str) -> Iterator[Rule]:
    """The rules of one table, one for each of its patterns. Raises RecordError."""
    files = table.get("files", ALL)
    entries = {signal: entry for signal, entry in table.items() if signal != "files"}
    patterns = files if isinstance(files, list) else [files]
    for name, item in (*(("files", pattern) for pattern in patterns), *entries.items()):
        if not isinstance(item, str):
            raise RecordError(f"{origin}: {name} must be text in quotes; {EXAMPLE}")
    for pattern in patterns:
        yield Rule(entries, origin, pattern, needed=False)
