"""Which records earlier runs looked at, so that the next diagnosis says what the records since have confirmed."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final

from studies.folder import write_at_once

FILE: Final = "looked.json"
"""In the folder of the steps: the hashes of the records of each look, in the order of the looks."""


def order(folder: Path, hashes: Sequence[str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """The hashes with those of earlier looks first, and how many of them each of these looks had; a look at records of
    which one is gone is not counted."""
    inside: list[str] = []
    counts = []
    for look in sorted(_kept(folder), key=len):
        if len(inside) < len(look) < len(hashes) and set(inside) <= look <= set(hashes):
            inside += [one for one in hashes if one in look and one not in inside]
            counts.append(len(inside))
    return (*inside, *(one for one in hashes if one not in inside)), tuple(counts)


def keep(folder: Path, hashes: Collection[str]) -> None:
    """Keeps that these records were looked at."""
    looks = _kept(folder)
    if set(hashes) not in looks:
        text = json.dumps([sorted(one) for one in [*looks, set(hashes)]], indent=1)
        write_at_once(folder / FILE, text + "\n")


def _kept(folder: Path) -> list[set[str]]:
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        return [{str(one) for one in look} for look in content]
    except (OSError, ValueError, TypeError):
        return []
