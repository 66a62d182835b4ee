"""What a stranger's manifest.json claims, checked for its form before anything is done with it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from studies.catalogue import find
from studies.folder import HASH, MAX_MANIFEST_BYTES, is_inside
from studies.options import BadInputError, Option
from studies.review.copying import visible
from studies.study import Study

TEXT: Final = 500  # characters of an option's value
MAX_CLAIMED_ENTRIES: Final = 200  # options, files, versions


@dataclass(frozen=True)
class GivenFile:
    """A file that the run was given: the option's name, the file's path as the manifest has it, its SHA-256."""

    option: str
    path: str
    sha256: str

    @property
    def name(self) -> str:
        """Without its folders."""
        return PurePosixPath(self.path).name

    def __str__(self) -> str:
        return f"--{self.option.replace('_', '-')} {visible(self.path)}"


@dataclass(frozen=True)
class Claim:
    """What a manifest says of a run, in its own words, `content`, and in those that a review goes by.

    options: values by name, paths left out; machine: the SHA-256 of the machine file, and whether it was the default.
    """

    content: Mapping[str, Any]
    study: Study
    options: Mapping[str, Any]
    files: tuple[GivenFile, ...]
    machine: str
    default_machine: bool
    outputs: Mapping[str, str]

    def command(self) -> str:
        """The command that a review runs, for people to read."""
        words = [f"studies.{self.study.name}", *(visible(file.name) for file in self.files if file.option == "record")]
        words += [f"--{file.option} {visible(file.name)}" for file in self.files if file.option != "record"]
        words += [] if self.default_machine else ["--machine machine.toml"]
        for name, value in sorted(self.options.items()):
            if value not in (None, False, [], ()):
                said = [] if value is True else [visible(one, 40) for one in _items(value)]
                words.append(" ".join([f"--{name.replace('_', '-')}", *said]))
        return " ".join(words)


def study_of(content: Mapping[str, Any], where: str) -> Study:
    """The study that a manifest names. Raises BadInputError."""
    study = find(str(content.get("study")))
    if study is None:
        raise BadInputError(
            f"{where}: {visible(content.get('study'))!r} is not a study of this version; "
            "check out the commit that the manifest names"
        )
    return study


def read_manifest(folder: Path, where: str) -> dict[str, Any]:
    """The content of a manifest.json that says which study wrote what. Raises BadInputError."""
    file = folder / "manifest.json"
    if not file.is_file():
        raise BadInputError(f"{where}: has no manifest.json; give a folder that a study wrote")
    try:
        content = json.loads(file.read_text(encoding="utf-8")) if file.stat().st_size <= MAX_MANIFEST_BYTES else None
    except (OSError, ValueError, RecursionError) as error:
        raise _no_manifest(where) from error
    if not isinstance(content, dict) or not all(
        isinstance(content.get(key), kind) for key, kind in (("study", str), ("outputs", dict))
    ):
        raise _no_manifest(where)
    return content


def read_claim(content: Mapping[str, Any], where: str) -> Claim:
    """What the manifest claims. Raises BadInputError for one that no run writes or that a review can't run again."""
    study = study_of(content, where)
    try:
        inputs, versions = content["inputs"], content["versions"]
        machine, source, lock = inputs["machine"], inputs["source"], inputs["lock"]
        files = tuple(GivenFile(one["option"], one["file"], one["sha256"]) for one in inputs["files"])
        plain = (content["options"], versions, machine, source, lock, content["outputs"])
        if (
            not all(isinstance(one, dict) and len(one) <= 10 * MAX_CLAIMED_ENTRIES for one in plain)
            or len(files) > MAX_CLAIMED_ENTRIES
        ):
            raise _no_manifest(where)
        names = [machine["copy"], source["sha256"], machine["sha256"], *versions.values()]
        names += [part for file in files for part in (file.option, file.path, file.sha256)]
        names += [lock["sha256"] or "", source["commit"] or ""]
        claim = Claim(
            content, study, content["options"], files, machine["sha256"], machine["default"] is True, content["outputs"]
        )
    except (KeyError, TypeError) as error:
        raise _no_manifest(where) from error
    if not all(isinstance(name, str) for name in names):
        raise _no_manifest(where)
    _check_outputs(claim, where)
    _check_options(claim, where)
    return claim


def _no_manifest(where: str) -> BadInputError:
    return BadInputError(f"{where}/manifest.json: is not the manifest of a study; run the study again")


def _check_outputs(claim: Claim, where: str) -> None:
    for name, expected in claim.outputs.items():
        if not is_inside(name):
            raise BadInputError(f"{where}: the manifest lists {visible(name)!r}, which is not a file in the folder")
        if not HASH.fullmatch(str(expected)):
            raise BadInputError(f"{where}: the manifest gives no SHA-256 of {visible(name)}; run the study again")
    if claim.content["inputs"]["machine"]["copy"] != "machine.toml":
        raise BadInputError(f"{where}: the manifest keeps the machine elsewhere than in machine.toml")


def _check_options(claim: Claim, where: str) -> None:
    """Only options that can't reach anything outside, by the flags of their declarations."""
    known: dict[str, Option] = {
        field.name: field.metadata["option"] for field in dataclasses.fields(claim.study.options)
    }
    initial = {field.name: field.default for field in dataclasses.fields(claim.study.options)}
    for name, value in claim.options.items():
        if name not in known or name in {"machine", "output", "overwrite"}:
            raise BadInputError(
                f"{where}: the manifest has {visible(name)!r}, not an option that {claim.study.name} keeps"
            )
        left_out = value in (None, False, []) or value == initial[name]
        if not left_out and (known[name].file or not known[name].reviewable):
            raise BadInputError(
                f"{where}: was made with {_typed(name)} {visible(value, 40)}, which reaches outside the folder; "
                "a review does not run that"
            )
        if not _is_plain(value):
            raise BadInputError(
                f"{where}: the manifest has {_typed(name)} {visible(value, 40)}, not a value of an option"
            )
    for file in claim.files:
        option = known.get(file.option)
        if option is None or not option.file or not option.reviewable:
            raise BadInputError(
                f"{where}: was made with {visible(file)}, which reaches outside the folder; a review does not run that"
            )
        if not is_inside(file.name) or not HASH.fullmatch(file.sha256):
            raise BadInputError(f"{where}: the manifest gives no name and SHA-256 of {visible(file)}")


def _typed(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _items(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _is_plain(value: Any) -> bool:
    """Whether a value is one that a command line can give: a word, a number, a flag, or a list of words."""
    if isinstance(value, list):
        return len(value) <= MAX_CLAIMED_ENTRIES and all(isinstance(one, str) and len(one) <= TEXT for one in value)
    return value is None or isinstance(value, bool | int | float) or (isinstance(value, str) and len(value) <= TEXT)
