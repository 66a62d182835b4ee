"""A pack as the answering process sees it: records, nominal machine, disabled entries; commitments for the scorer."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from studies.blind_trial.scoring import KeyFileError
from studies.options import BadInputError

NOMINAL: Final = ("nominal.json", "nominal.toml")  # the nominal machine of a pack: SI numbers, or a machine file


@dataclass(frozen=True)
class Case:
    """One case: its records, the nominal machine's file, and the catalogue entries that are disabled for it."""

    name: str
    records: tuple[Path, ...]
    nominal: Path
    disabled: tuple[str, ...]

    def fingerprint(self) -> str:
        """SHA-256 over everything that determines an answer, file names included."""
        digest = hashlib.sha256(" ".join(self.disabled).encode())
        for file in (self.nominal, *self.records):
            digest.update(file.name.encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
        return digest.hexdigest()


@dataclass(frozen=True)
class Pack:
    """The cases of a folder, sorted by name, and the commitments of their labels."""

    folder: Path
    cases: tuple[Case, ...]
    commitments: Mapping[str, str]


def read_pack(folder: Path) -> Pack:
    """The pack in a folder. Raises BadInputError."""
    if not folder.is_dir():
        raise BadInputError(f"--pack {folder}: is not a folder; give one with case-*/, nominal.json, commitments.json")
    common = _nominal(folder)
    cases = []
    for place in sorted(one for one in folder.glob("case-*") if one.is_dir()):
        records = tuple(sorted(place.glob("*.csv.gz")))
        if not records:
            raise BadInputError(f"--pack {folder}: {place.name} has no records (*.csv.gz); make the pack again")
        nominal = _nominal(place) or common  # a pack of many machines has one in each case
        if nominal is None:
            raise BadInputError(
                f"--pack {folder}: has no nominal.json, and {place.name} has none of its own; give a folder with "
                "case-*/ and nominal.json"
            )
        cases.append(Case(place.name, records, nominal, _disabled(place / "disabled.json")))
    if not cases:
        raise BadInputError(f"--pack {folder}: has no case-* folder; give a folder with case-*/ and nominal.json")
    return Pack(folder, tuple(cases), _json(folder / "commitments.json", "--pack") if _has(folder) else {})


def _nominal(folder: Path) -> Path | None:
    """The nominal machine's file in a folder; None where there is none."""
    return next((one for one in (folder / name for name in NOMINAL) if one.is_file()), None)


def _has(folder: Path) -> bool:
    return (folder / "commitments.json").is_file()


def _disabled(file: Path) -> tuple[str, ...]:
    if not file.is_file():
        return ()
    names = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadInputError(f"--pack: {file} must be a list of names; make the pack again")
    return tuple(names)


def _json(file: Path, option: str) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"{option} {file}: can't be read ({error.strerror}); give an existing file") from error
    except ValueError as error:
        raise BadInputError(
            f"{option} {file}: is not valid JSON ({error}); give the one that the sealer wrote"
        ) from error
    if not isinstance(content, dict):
        raise BadInputError(f"{option} {file}: must be a JSON object; give the file that the sealer wrote")
    return content


def open_key(file: Path, pack: Pack) -> dict[str, str]:
    """The bodies of a pack's labels, each verified against its commitment. Raises BadInputError."""
    try:
        return bodies_of(read_key(file), pack)
    except KeyFileError as error:
        raise BadInputError(f"--key {file}: {error}") from error


def read_key(file: Path) -> dict[str, Any]:
    """What a key file holds, before it is compared with commitments. Raises BadInputError."""
    return _json(file, "--key")


def bodies_of(key: Mapping[str, Any], pack: Pack) -> dict[str, str]:
    """The bodies of a pack's labels, each verified against its commitment. Raises KeyFileError."""
    return {case.name: opened(case.name, key, pack.commitments) for case in pack.cases}


def opened(case: str, key: Mapping[str, Any], commitments: Mapping[str, str]) -> str:
    """The body of one label. Raises KeyFileError where it is missing or is not what was committed."""
    if case not in commitments:
        raise KeyFileError(f"{case}: the pack has no commitment of its label; seal the pack again")
    try:
        nonce, body = key[case]["nonce"], key[case]["body"]
        digest = hashlib.sha256((nonce + body).encode()).hexdigest()
    except (KeyError, TypeError) as error:
        raise KeyFileError(f"{case}: the key has no nonce and body for it; give the key of this pack") from error
    if digest != commitments[case]:
        raise KeyFileError(f"{case}: its label is not the one that was committed; one of the two has been changed")
    return str(body)
