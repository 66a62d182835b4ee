"""Policies at equal budget: which is right after how much machine time, on sealed machines.

Every policy begins with the same record, the design in place over the specified strokes, has the same limits, time,
records and rules to stop, and a sealed machine of its own; they differ in what they run next.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from diagnosis.experiments import policy
from diagnosis.experiments.policy import Choose
from models.effects.catalogue import every
from studies.blind_trial.figures_of_merit import Rate, rate
from studies.blind_trial.scoring import WITHOUT_EFFECT, Label, Score, label_of, score
from studies.gap_diagnosis.course import confirmed

POLICIES: Final[Mapping[str, Callable[[int], Choose]]] = {
    "active": lambda _seed: policy.active,
    "fixed suite": lambda _seed: policy.in_turn,
    "random": policy.at_random,
    "D-optimal": lambda _seed: policy.d_optimal,
}
"""By name, the policy for a seed."""


@dataclass(frozen=True)
class Result:
    """One policy on one machine, scored. looks: machine time so far [s] and the names that were sure, look by look;
    seconds of machine time; refused: requests that were beyond the limits."""

    case: str
    policy: str
    kind: str
    severity: str
    effects: tuple[str, ...]
    counts: bool
    right: bool
    false_name: bool
    named: tuple[str, ...]
    seconds: float
    looks: tuple[tuple[float, tuple[str, ...]], ...]
    refused: int
    failed: str = ""


def scored(case: str, name: str, answer: Mapping[str, Any], label: Mapping[str, Any]) -> Result:
    """A policy's answer by the trial's rules: names count where they are sure; times in [s]."""
    true: Label = label_of(str(label["case"]), json.dumps(label), list(every()))
    failed, looks = str(answer.get("failed", "")), tuple[tuple[float, tuple[str, ...]], ...]()
    verdict: dict[str, Any] = {"outcome": "failed", "effects": [], "equivalent": []}
    if not failed:
        verdict, looks = confirmed(answer["verdict"], answer["course"]), tuple(_looks(answer))
    rule: Score = score(true, {"verdict": verdict, "which": [], "how_far": None, "seconds": 0.0})
    return Result(
        case,
        name,
        true.kind,
        true.severity,
        true.names,
        rule.counts,
        rule.right,
        rule.false_positive,
        () if failed else tuple(answer["course"]["effects"]),
        looks[-1][0] if looks else 0.0,
        looks,
        int(answer.get("beyond", 0)),
        failed,
    )


def _looks(answer: Mapping[str, Any]) -> Iterator[tuple[float, tuple[str, ...]]]:
    """After each look, the machine time [s], that of the first record included, and the names that were sure."""
    course, seconds = answer["course"], float(answer["begun_s"])
    needed = math.log10(course["needed"])  # an e-value itself may be too large for a number
    for look in course["looks"]:
        seconds += look["seconds"]
        names: tuple[str, ...] = ()
        if look["after"] is not None and look["log10_e_value"] >= needed:
            sure = {name for name, log in look["log10_e_values"].items() if log >= needed}
            names = tuple(name for name in look["after"]["names"] if name in sure)
        yield seconds, names


def rates(results: Sequence[Result]) -> dict[str, dict[str, Rate]]:
    """By policy: right names of single effects by severity and of all; false names where nothing is wrong or parameters
    only; abstentions on outsiders; requests beyond limits [1]."""
    found: dict[str, dict[str, Rate]] = {}
    for name in dict.fromkeys(one.policy for one in results):
        own = [one for one in results if one.policy == name]
        singles = [one for one in own if one.kind == "single" and one.counts]
        innocent = [one for one in own if one.kind in WITHOUT_EFFECT]
        outside = [one for one in own if one.kind in {"outsider", "disabled"}]
        found[name] = {
            "right name": rate(singles, lambda one: one.right),
            **{
                f"right name, {severity}": rate(
                    [one for one in own if one.kind == "single" and one.severity == severity], lambda one: one.right
                )
                for severity in ("low", "middle", "high")
            },
            "false name": rate(innocent, lambda one: one.false_name or bool(one.failed)),
            "no name for an outsider": rate(outside, lambda one: one.right),
            "beyond the limits": rate(own, lambda one: one.refused > 0),
        }
    return found


def right_over_time(results: Sequence[Result], times: Sequence[float]) -> dict[str, list[Rate]]:
    """By policy, how many single effects were rightly and surely named after so much machine time [s]."""
    found: dict[str, list[Rate]] = {}
    for name in dict.fromkeys(one.policy for one in results):
        singles = [one for one in results if one.policy == name and one.kind == "single"]
        found[name] = [rate(singles, lambda one, at=at: _right_at(one, at)) for at in times]  # type: ignore[misc]
    return found


def _right_at(one: Result, seconds: float) -> bool:
    before = [names for at, names in one.looks if at <= seconds]
    return bool(before) and set(before[-1]) == set(one.effects)
