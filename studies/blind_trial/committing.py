"""Commits to answers before their key is opened, so that none can be changed after it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.command import plain
from studies.folder import write_at_once
from studies.options import BadInputError


def commit(file: Path, answers: Mapping[str, Any]) -> None:
    """Adds the SHA-256 of each answer, under the case and what it was answered from."""
    digests = _digests(file) | {_of(name, one): _digest(one) for name, one in answers.items()}
    write_at_once(file, json.dumps(digests, indent=1, sort_keys=True) + "\n")


def require_committed(file: Path, answers: Mapping[str, Any], where: Path) -> None:
    """Raises BadInputError if one of the answers in `where` is not what it was when it was committed."""
    digests = _digests(file)
    for name, one in answers.items():
        if digests.get(_of(name, one), _digest(one)) != _digest(one):
            raise BadInputError(
                f"{where}: the answer to {name} is not the one that was committed before the key was opened; "
                "restore the file, or delete it to have all cases answered again"
            )


def _digests(file: Path) -> dict[str, str]:
    """The commitments in a file; none if there is no file. Raises BadInputError."""
    try:
        digests = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    except ValueError:
        digests = None
    if not isinstance(digests, dict):
        raise BadInputError(
            f"{file}: does not hold the commitments of answers; delete it and the answers to answer again"
        )
    return digests


def _of(name: str, answer: Mapping[str, Any]) -> str:
    return f"{name} {answer.get('of')}"


def _digest(answer: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(plain(answer), sort_keys=True).encode()).hexdigest()
