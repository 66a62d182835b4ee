"""--looked: a diagnosis that is not the first look at its records, and what that means for its names."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from diagnosis.baseline import Baseline
from diagnosis.experiments.active import Settings
from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.looked import EarlierLooks, earlier_looks, standing, with_last
from diagnosis.experiments.policy import CHANCE
from models.machine import Machine
from models.quantity import listed
from models.records.record import Record
from studies.gap_diagnosis.course import Course, e_value
from studies.options import BadInputError
from studies.wording import effect


@dataclass(frozen=True)
class Before:
    """The looks before this one; course: of a machine that was asked before them, which they go on from."""

    looks: EarlierLooks
    course: Course | None


def require_growing(counts: Sequence[int], records: int) -> None:
    """Raises BadInputError where these are not numbers of records, growing and fewer than there are."""
    if list(counts) != sorted(set(counts)) or (counts and counts[-1] >= records):
        raise BadInputError(
            f"--looked {' --looked '.join(map(str, counts))}: of {records} records; give growing numbers below that"
        )


def before(
    machine: Machine,
    records: Sequence[Record],
    counts: Sequence[int],
    settings: Settings,
    course: Course | None,
    say: Callable[[str], None],
) -> Before | None:
    """The looks at the first `counts` of the records; None where this one is the first. Raises RecordError."""
    if not counts:
        return None
    begun = EProcess() if course is None else _reached(course)
    return Before(earlier_looks(machine, records, counts, settings, begun=begun, say=say), course)


def _reached(course: Course) -> EProcess:
    """The e-process after the last look that a machine was asked for."""
    last, decade = course["looks"][-1], math.log(10)
    each = {name: decade * value for name, value in last.get("log10_e_values", {}).items()}
    return EProcess(decade * last["log10_e_value"], MappingProxyType(each))


def course_of(
    earlier: Before, baseline: Baseline, verdict: Mapping[str, Any], shown: Sequence[Mapping[str, Any]]
) -> Course:
    """The course of all looks, as one that a machine was asked for has it; shown: name, samples and sample time [s] of
    each record. Its effects are the names that count."""
    looks, asked = earlier.looks, earlier.course
    processes = with_last(looks, baseline)
    first = looks.found[0].names if asked is None else asked["effects"]
    names = verdict["effects"] if verdict["outcome"] in {"attributed", "ambiguous"} else []
    count = standing(names, first, processes)
    if verdict["outcome"] == "ambiguous" and any(one.any >= -math.log(CHANCE) for one in processes):
        count = tuple(names)  # that it is one of these is sure
    now = {"outcome": verdict["outcome"], "names": list(names), "alike": verdict.get("equivalent", [])}
    found = [*(one.to_json() for one in looks.found), now]
    rows = [] if asked is None else list(asked["looks"])
    begin = 0
    for i, (end, process) in enumerate(zip((*looks.counts, len(shown)), processes, strict=True)):
        new = shown[begin:end]
        begin = end
        if asked is not None and i == 0:  # the last look of that course, told already
            continue
        rows.append(
            {
                "asked": listed([str(one["name"]) for one in new]),
                "why": "given" if i else "given first",
                "seconds": sum(one["samples"] * one["sample_time_s"] for one in new),
                "failed": "",
                "before": found[i - 1] if i else None,
                "after": found[i],
                **process.decades(),
            }
        )
    return {
        "by_hand": True,
        "outcome": verdict["outcome"],
        "reason": _reason(names, count, first, processes[-1]),
        "effects": list(count),
        "not_shown": [],
        "chance": CHANCE,
        "needed": 1 / CHANCE,
        "seconds": sum(one["seconds"] for one in rows),
        "looks": rows,
    }


def _reason(names: Sequence[str], count: Sequence[str], first: Sequence[str], last: EProcess) -> str:
    """Why the names count, or don't, in words."""
    decades = last.decades()["log10_e_values"]

    def told(name: str) -> str:
        return f"{effect(name)} {e_value({'log10_e_value': decades.get(name, 0.0)})}"

    groups = {
        "named from the first look on": [name for name in count if name in first],
        "confirmed by a record that did not choose it": [name for name in count if name not in first],
        "not confirmed yet": [name for name in names if name not in count],
    }
    parts = [f"{listed([told(name) for name in group])}, {why}" for why, group in groups.items() if group]
    return f"e-values ({1 / CHANCE:.0f} confirm a name): {'; '.join(parts)}" if parts else "no effect is named"
