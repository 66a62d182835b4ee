"""--continue: a diagnosis goes on from an earlier one, with the records of that one and the new ones.

What is run then is an ordinary diagnosis of all records: its manifest and its report are those of one that was given
them all at once, and was told which of them had been looked at before (by_hand.py).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from models.machine import DEFAULT
from models.quantity import show, turned
from studies.manifest import ROOT, sha256
from studies.options import BadInputError
from studies.review.claims import Claim, GivenFile, read_claim, read_manifest

STUDY_NAME: Final = "gap_diagnosis"
LISTS: Final = ("column", "disable")
"""Options that add up with those of the earlier run."""
TAKEN: Final = ("recipe", "trust_records", "quick", "seed", "most_samples")
"""Options that are as in the earlier run where this one is given none."""


@dataclass(frozen=True)
class Earlier:
    """The folder of an earlier run, what its manifest says, and its results.json."""

    folder: Path
    claim: Claim
    results: Mapping[str, Any]


def read(folder: Path) -> Earlier:
    """What an earlier diagnosis wrote. Raises BadInputError for a folder of something else."""
    claim = read_claim(read_manifest(folder, str(folder)), str(folder))
    if claim.study.name != STUDY_NAME:
        raise BadInputError(
            f"--continue {folder}: was not written by {STUDY_NAME}; give the --output folder of such a run"
        )
    if not any(one.option == "record" for one in claim.files):
        raise BadInputError(
            f"--continue {folder}: diagnosed simulated records, which nothing can be added to; give records alone"
        )
    return Earlier(folder, claim, results_in(folder))


def results_in(folder: Path) -> Mapping[str, Any]:
    """The results.json of a run. Raises BadInputError."""
    try:
        content: Mapping[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInputError(f"{folder}: results.json in it can't be read; run the diagnosis again") from error
    return content


def continued(given: argparse.Namespace, earlier: Earlier, usual: argparse.Namespace) -> argparse.Namespace:
    """The options of a run over the earlier records and the new ones; what is given now goes before what was given then
    (usual: the options where none are given), and lists add up. Without --output it goes into the earlier folder.

    Raises BadInputError where no new record is given, and for files that have changed or are missing.
    """
    if not given.record:
        raise BadInputError("--continue: needs the record that was made since; give it as well")
    known = {one.sha256: one.path for one in earlier.claim.files if one.option == "record"}
    for file in given.record:
        if file.is_file() and sha256(file) in known:
            raise BadInputError(f"{file}: is {known[sha256(file)]} of the earlier run; give the records made since")
    whole, options = argparse.Namespace(**vars(given)), earlier.claim.options
    for name in TAKEN:
        if getattr(given, name) == getattr(usual, name):
            setattr(whole, name, options.get(name, getattr(usual, name)))
    for name in LISTS:
        setattr(whole, name, [*options.get(name, ()), *getattr(given, name)])
    for name in ("record", "hold_out"):
        setattr(whole, name, [*_files(earlier, name), *getattr(given, name)])
    for name in ("mapping", "controller"):
        if getattr(given, name) is None:
            setattr(whole, name, next(iter(_files(earlier, name)), None))
    whole.looks = given.looks or next(iter(_files(earlier, "looks")), None)
    whole.looked = given.looked or [*options.get("looked", ()), len(_files(earlier, "record"))]
    whole.machine = given.machine or _machine(earlier)
    whole.output = given.output or earlier.folder
    return whole


def _files(earlier: Earlier, option: str) -> list[Path]:
    """The files of an option of the earlier run, as they were then."""
    return [_unchanged(earlier, one) for one in earlier.claim.files if one.option == option]


def _unchanged(earlier: Earlier, file: GivenFile) -> Path:
    """A file of the earlier run, whose name counts from where that ran, or from the project. Raises BadInputError."""
    there = [place for place in (Path(file.path), ROOT / file.path) if place.is_file()]
    for place in there:
        if sha256(place) == file.sha256:
            return place
    if there:
        raise BadInputError(f"{file.path}: has changed since the run in {earlier.folder}; give all records anew")
    raise BadInputError(
        f"{file.path}: of the run in {earlier.folder} is not there; work where that ran, or put it back"
    )


def _machine(earlier: Earlier) -> Path | None:
    """The machine file as it was; None for the default one, unless that has changed."""
    if earlier.claim.default_machine and sha256(DEFAULT) == earlier.claim.machine:
        return None
    copy = earlier.folder / "machine.toml"
    if not copy.is_file() or sha256(copy) != earlier.claim.machine:
        raise BadInputError(f"--continue {earlier.folder}: machine.toml in it has changed since; give --machine")
    return copy


def since(earlier: Earlier, now: Mapping[str, Any]) -> str:
    """What the answer was, and what it is with the new records."""
    before, after = (_answered(one["results"]) for one in (earlier.results, now))
    count = len(now["results"]["records"]) - len(earlier.results["results"]["records"])
    said = f"before the {'new record' if count == 1 else f'{count} new records'}: {before}\nand with: {after}"
    if looks := now["results"].get("asked"):
        said += f"\n{looks['reason']}"
    return turned(said) if now["machine"].get("axis") == "rotary" else said


def _answered(results: Mapping[str, Any]) -> str:
    verdict, far = results["verdict"], results["how_far"]
    likely = {row["effect"]: row["probability"] for row in results["which"]}
    named = ", ".join(
        f"{name} ({100 * likely[name]:.0f} %)" if likely.get(name) is not None else str(name)
        for name in verdict["effects"]
    )
    told = f"{verdict['outcome'].replace('_', ' ')}{f': {named}' if named else ''}"
    return (
        f"{told}; the unknown force is {show(far['gap_as_delivered']['force_N'], 'N', 3)} as delivered and "
        f"{show(far['gap_improved']['force_N'], 'N', 3)} with the file handed over"
    )
