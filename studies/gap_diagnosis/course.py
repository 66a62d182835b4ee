"""The course of a diagnosis that asked for its records: read from its file, told, and what it means for the verdict."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeGuard

from models.quantity import listed, show
from studies.options import BadInputError
from studies.wording import effect

Course = Mapping[str, Any]
"""What active.to_json writes; `by_hand`: looks that were taken one after another at what was given."""
LOOKS: Final = "looks.json"
ASKED: Final = "asked"  # the folder of the records among the results
COURSE: Final = MappingProxyType(
    {"outcome": str, "effects": list, "needed": int | float, "seconds": int | float, "reason": str, "looks": list}
)
LOOK_TYPES: Final = MappingProxyType({"seconds": int | float, "why": str, "asked": str, "log10_e_value": int | float})
MAX_TOLD_DECADES: Final = 6.0  # powers of ten of an e-value that are not told any more


def course(file: Path | None) -> Course | None:
    """The course of the looks in a file that `--machine-process` wrote. Raises BadInputError."""
    if file is None:
        return None
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInputError(f"--looks {file}: can't be read; give the {LOOKS} that --machine-process wrote") from error
    if not _is_course(content):
        raise BadInputError(f"--looks {file}: is not the course of a diagnosis; give the {LOOKS} beside the records")
    return content


def _is_course(content: Any) -> TypeGuard[Course]:
    """Whether it has all that is told of a course and of each of its looks."""
    whole = isinstance(content, dict) and _are(content, COURSE)
    return whole and all(
        isinstance(one, dict) and one.keys() >= {"failed", "after"} and _are(one, LOOK_TYPES)
        for one in content["looks"]
    )


def _are(content: Mapping[str, Any], kinds: Mapping[str, Any]) -> bool:
    return all(isinstance(content.get(name), kind) for name, kind in kinds.items())


def copies(records: Sequence[Path], looks: Path) -> dict[str, bytes]:
    """The records and the course as files among the results."""
    named = [(f"{i + 1}-{file.name}", file) for i, file in enumerate(records)]
    return {f"{ASKED}/{name}": file.read_bytes() for name, file in [*named, (LOOKS, looks)]}


def confirmed(verdict: Mapping[str, Any], looks: Course | None) -> dict[str, Any]:
    """The verdict without the names that the looks did not make sure; as it is where there were none.

    A diagnosis of the last records alone has the chance of a false name that one look has; over several looks only
    names count that a record confirmed which had not chosen them. Of looks that were taken by hand, whose first one
    had that chance already, the others are kept and listed as `unconfirmed`.
    """
    if looks is None or verdict["outcome"] not in {"attributed", "ambiguous"}:
        return dict(verdict)
    if looks.get("by_hand"):
        unsure = [name for name in verdict["effects"] if name not in looks["effects"]]
        return {**verdict, "confirmed": not unsure, "unconfirmed": unsure}
    sure = [name for name in verdict["effects"] if name in looks["effects"]]
    reached = max((look["log10_e_value"] for look in looks["looks"][-1:]), default=-math.inf)
    there = verdict["outcome"] == "ambiguous" and reached >= math.log10(looks["needed"])
    if sure or there:
        return {**verdict, "confirmed": len(sure) == len(verdict["effects"])}
    return {**verdict, "outcome": "none_of_these", "effects": [], "partly": verdict["effects"], "confirmed": False}


def is_unsure(verdict: Mapping[str, Any]) -> bool:
    """Whether the records alone would give names, which no record confirmed that had not chosen them."""
    return verdict.get("confirmed") is False and verdict["outcome"] == "none_of_these"


def marked(verdict: Mapping[str, Any]) -> str:
    """Which of the names are unconfirmed, in brackets; empty where none is."""
    names = verdict.get("unconfirmed", [])
    alone = names == verdict["effects"]
    return f" ({'' if alone else listed([effect(name) for name in names]) + ' '}unconfirmed)" if names else ""


def unconfirmed(results: Mapping[str, Any]) -> list[str]:
    """What is said of names that came up after the first look, and that no record has confirmed; none without any."""
    verdict = results["verdict"]
    names = verdict.get("unconfirmed", [])
    if not names:
        return []
    last = results["asked"]["looks"][-1]
    values = [e_value({"log10_e_value": last["log10_e_values"].get(name, 0.0)}) for name in names]
    some = len(names) > 1
    come = f"{listed([effect(name) for name in names])} {'come' if some else 'comes'} up after the first look, and no "
    come += f"record that did not choose {'them' if some else 'it'} has confirmed {'them' if some else 'it'} yet"
    run = "run next_experiment.csv" if verdict["next_experiment"] else "make another record"
    needed = f"e-value{'s' if some else ''} {listed(values)}, {results['asked']['needed']:.0f} needed"
    return [f"{come[0].upper()}{come[1:]} ({needed}): {run} and go on with it (--continue)."]


def told(content: Course) -> str:
    """The course in lines of text: what was asked, what was open before and after, and how it ended."""
    lines = [
        f"{i + 1}. {show(look['seconds'], 's', 3)} ({look['why']}): {look['asked']} -> {_found(look)}"
        for i, look in enumerate(content["looks"])
    ]
    return "\n".join([*lines, ended(content)])


def ended(content: Course) -> str:
    """How it ended, after how much of the machine's time, and why."""
    names = f" {listed([name.replace('_', ' ') for name in content['effects']])}" if content["effects"] else ""
    after = show(content["seconds"], "s", 3)
    told = f"{content['outcome'].replace('_', ' ')}{names} after {after} of machine time: {content['reason']}."
    return f"{told[0].upper()}{told[1:]}"


def e_value(look: Mapping[str, Any]) -> str:
    """The e-value over all looks so far; only that it is large where it is."""
    logarithm = look["log10_e_value"]
    return "over a million" if logarithm > MAX_TOLD_DECADES else f"{10**logarithm:.2g}"


def found(after: Mapping[str, Any] | None) -> str:
    """What a look found, in a few words."""
    if after is None:
        return "–"
    names = f": {listed([name.replace('_', ' ') for name in after['names']])}" if after["names"] else ""
    return f"{after['outcome'].replace('_', ' ')}{names}"


def _found(look: Mapping[str, Any]) -> str:
    return f"not run: {look['failed']}" if look["failed"] else f"{found(look['after'])}, e-value {e_value(look)}"
