"""The records in a folder: read, and sorted by what each is for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from models.identification.recognise import read, recognised
from models.machine import Machine
from models.records.files import Loaded
from models.records.record import Record
from models.records.tables.formats import FORMATS, LISTED
from models.records.tables.sizes import RecordError
from studies.full_circle import redesigning
from studies.full_circle.asked import Asked, asked, ran, unclear
from studies.full_circle.options import CircleOptions
from studies.gap_diagnosis.records import filled
from studies.options import BadInputError
from studies.record_columns import mapped
from studies.study import Progress

IDENTIFIED: Final = ("response", "excitation", "hysteresis")
"""Kinds of records that the machine is identified from; all others are diagnosed."""
JUDGED: Final = ("current", "redesign")  # kinds of tables whose runs are judged, and not diagnosed
UNCLEAR: Final = (
    "It has no feedforward, and its reference is that of several designs: which of them it is a run of can't be told, "
    "so it is not judged; map its feedforward (--column)."
)
MAX_RECORDS: Final = 100  # records in a folder


@dataclass(frozen=True)
class Given:
    """A record of the folder; role: "identify", "diagnose", or of the table that it is a run of, "current" or
    "redesign"; run: that run's part of the record. table: also of an experiment that was asked for. unclear: whether
    its log, which lacks the feedforward, follows the references of several tables."""

    path: Path
    kind: str
    role: str
    loaded: Loaded
    table: Asked | None = None
    run: Record | None = None
    unclear: bool = False


def files_in(folder: Path) -> tuple[Path, ...]:
    """The files of a folder that may be records, by name. Raises BadInputError for a folder without any."""
    if not folder.is_dir():
        raise BadInputError(f"--records {folder}: is not a folder; give the folder with the records of this axis")
    try:
        found = sorted(one for one in folder.iterdir() if _may_be(one))
    except OSError as error:
        raise BadInputError(f"--records {folder}: can't be read ({error.strerror}); give another folder") from error
    if not found:
        raise BadInputError(
            f"--records {folder}: holds no record ({LISTED}); what to run on the axis to get some, identify_machine "
            "--write-references FOLDER writes"
        )
    if len(found) > MAX_RECORDS:
        raise BadInputError(
            f"--records {folder}: holds {len(found)} files; give a folder with {MAX_RECORDS} records at most"
        )
    return tuple(found)


def _may_be(file: Path) -> bool:
    return file.is_file() and not file.name.startswith(".") and file.name.lower().endswith(FORMATS)


def loaded(machine: Machine, options: CircleOptions, tables: Sequence[Asked], progress: Progress) -> tuple[Given, ...]:
    """The records of --records, and what each is for; tables: what was asked for in earlier runs.

    Raises BadInputError for one that can't be read, and for two with the same content.
    """
    assert options.records is not None
    files = files_in(options.records)
    mapping = mapped(machine, options, files)
    in_place = asked("current", redesigning.current_table(machine))
    found, seen = list[Given](), dict[str, Path]()
    for number, file in enumerate(files):
        progress(0.02 * number / len(files), f"reading {file.name}")
        try:
            one = read(machine, file, mapping.columns(file), trusted=options.trust_records)
        except RecordError as error:
            raise BadInputError(f"{error}; or move {file.name} out of --records") from error
        if one.sha256 in seen:
            raise BadInputError(f"{file}: has the same content as {seen[one.sha256].name}; remove one of them")
        seen[one.sha256] = file
        found.append(_sorted(machine, file, one, tables, in_place))
    return tuple(found)


def _sorted(machine: Machine, file: Path, one: Loaded, tables: Sequence[Asked], in_place: Asked) -> Given:
    kind = recognised(machine, one)
    identified = kind in IDENTIFIED
    try:
        whole = filled(machine, one) if isinstance(one.content, Record) else one
    except RecordError as error:
        if not identified:
            raise BadInputError(f"{file}: {error}; or move {file.name} out of --records") from error
        whole = one
    if isinstance(whole.content, Record) and tables and unclear(whole.content, (*tables, in_place)):
        said = replace(whole, findings=(*whole.findings, UNCLEAR))
        return Given(file, kind, "diagnose", said, unclear=True)
    known = ran(whole.content, tables) if isinstance(whole.content, Record) else None
    if known is not None and known[0].kind in JUDGED:
        return Given(file, kind, known[0].kind, whole, *known)
    if known is not None:  # an experiment that a diagnosis asked for, whatever its kind
        return Given(file, kind, "diagnose", whole, known[0])
    return Given(file, kind, "identify", one) if identified else Given(file, kind, "diagnose", whole)


def hashes(given: Sequence[Given], *roles: str) -> Mapping[str, str]:
    """The hash of every record with one of these roles, by its file's name."""
    return {one.path.name: one.loaded.sha256 for one in given if one.role in roles}
