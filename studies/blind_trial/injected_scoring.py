"""The rules by which answers to injected records are scored, fixed before any key is opened.

A measured record holds effects of its own, which nobody knows. So the same diagnosis answers the uninjected record too,
after all answers are committed, and a name counts as new where that answer does not have it: a group of effects none of
which was named before, or a member of a periodic effect whose period is in no ratio of small integers to one that was
named before. A new name that was not injected is a wrong name, whatever was injected. An injected effect of the
catalogue is named right if it is named and no wrong name is; a periodic one with its period to PERIOD; one that the
uninjected record has too, only where its period is new or what it does along the record another by CHANGED deviations.
Of an effect outside the catalogue, and of wrong nominal values, no new name is right.

Closure of the injected part: 1 - sqrt(max(a^2 - b^2, 0)) / f, with a and b the unknown force [N] that the final model
leaves of the injected and of the uninjected record, and f what mass, drag, friction and offset cannot explain of the
injected force.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from studies.blind_trial.figures_of_merit import Rate, rate_of
from studies.blind_trial.scoring import LARGEST_SET, groups_of

Answer = Mapping[str, Any]

PERIOD: Final = 0.05  # of an injected period, to which it has to be found
RATIO: Final = 0.02  # of a ratio of integers up to HIGHEST, within which a period is a harmonic of another
HIGHEST: Final = 4
CHANGED: Final = 5.0  # deviations by which what an effect does has to be another than in the uninjected record


@dataclass(frozen=True)
class Verdict:
    """One case scored: the names that are new, those that the uninjected record has too, whether the injected effect is
    named and nothing wrong is, whether something wrong is named, whether an abstention names it in part; the closure of
    the injected part [1]. counts: whether it is above the detection limit; apart: also beside any friction over speed.
    """

    case: str
    kind: str
    name: str
    severity: str
    counts: bool
    apart: bool
    record: int
    distance: float
    outcome: str
    new: tuple[str, ...]
    before: tuple[str, ...]
    right: bool
    wrong: bool
    in_part: bool
    closure: float | None

    @property
    def failed(self) -> bool:
        """Whether there is no answer."""
        return self.outcome == "failed"


def score(case: str, body: Mapping[str, Any], answer: Answer, uninjected: Answer) -> Verdict:
    """One answer, by the label's body and the answer to the record before the injection."""
    name, kind, (effect,) = str(body["name"][0]), str(body["kind"]), body["effects"]
    verdict = answer.get("verdict") or {}
    groups, had = groups_of(verdict), {one for group in groups_of(uninjected.get("verdict") or {}) for one in group}
    fresh = [group for group in groups if not set(group) & had]
    joined = [one for group in groups for one in group if one in had and _new_periods(one, answer, uninjected)]
    known = kind == "single"
    named = known and any(name in group and len(group) <= LARGEST_SET for group in groups)
    if named:
        named = _has_period(name, effect["period"], answer)
        if name in had and not effect["period"]:
            named = named and _changed(name, answer, uninjected)
        elif name in had:
            named = named and any(_near(new, effect["period"]) for new in _new_periods(name, answer, uninjected))
    wrong = any(not (known and name in group) for group in fresh) or any(one != name or not known for one in joined)
    new = [*(" or ".join(group) for group in fresh), *(f"{one} (another period)" for one in joined)]
    answered = verdict.get("outcome") not in (None, "failed")
    return Verdict(
        case,
        kind,
        name,
        str(body["severity"]),
        bool(body["identifiable"]),
        bool(body["identifiable_beside_speed"]),
        int(body["record"]),
        float(effect["distance"]),
        str(verdict.get("outcome") or "failed"),
        tuple(new),
        tuple(sorted(had & {one for group in groups for one in group})),
        answered and not wrong and (named if known else True),
        wrong,
        name in (verdict.get("partly") or ()),
        _closure(body, answer, uninjected),
    )


def _closure(body: Mapping[str, Any], answer: Answer, uninjected: Answer) -> float | None:
    now, before = (((one.get("how_far") or {}).get("gap_after") or {}).get("force_N") for one in (answer, uninjected))
    seen = float(body["unexplained_force_N"])
    if now is None or before is None or body["kind"] == "parameters" or seen == 0:
        return None  # a wrong nominal value is what mass, drag, friction and offset explain
    return 1 - math.sqrt(max(float(now) ** 2 - float(before) ** 2, 0.0)) / seen


def _members(effect: str, answer: Answer) -> Iterator[Mapping[str, Any]]:
    for row in answer.get("which") or ():
        if row["effect"] == effect and row.get("parameters"):
            yield row["parameters"]
            yield from row.get("further_members") or ()


def _periods(effect: str, answer: Answer) -> list[float]:
    return [
        float(item["value"])
        for member in _members(effect, answer)
        for item in member.values()
        if item.get("role") == "period"
    ]


def _new_periods(effect: str, answer: Answer, uninjected: Answer) -> list[float]:
    before = _periods(effect, uninjected)
    return [one for one in _periods(effect, answer) if not any(_harmonic(one, other) for other in before)]


def _harmonic(one: float, other: float) -> bool:
    whole = range(1, HIGHEST + 1)
    ratios = {m / n for m in whole for n in whole if 1 in (m, n)}
    return any(abs(one / other / ratio - 1) < RATIO for ratio in ratios)


def _near(period: float, wanted: Mapping[str, float]) -> bool:
    return any(abs(period / value - 1) < PERIOD for value in wanted.values())


def _has_period(effect: str, wanted: Mapping[str, float], answer: Answer) -> bool:
    periods = _periods(effect, answer)
    return not wanted or not periods or any(_near(one, wanted) for one in periods)


def _changed(effect: str, answer: Answer, uninjected: Answer) -> bool:
    """Whether what it does along the records, with its sign, is another than before by CHANGED of both deviations; not
    where that can't be compared. Amplitudes themselves may be shares of a friction that was fitted anew."""
    (now, own), (before, other) = (_size(effect, one) for one in (answer, uninjected))
    if now is None or before is None:
        return False
    return abs(now - before) > CHANGED * math.hypot(own, other)


def _size(effect: str, answer: Answer) -> tuple[float | None, float]:
    """What an effect does along the records [N], or [m] of the reading, with the sign of its surest amplitude, and the
    deviation of that; None where it is not told."""
    for row in answer.get("which") or ():
        acts = row.get("acts") if row["effect"] == effect else None
        if not acts:
            continue
        does = acts["force_N"] if acts["force_N"] is not None else acts["position_m"]
        sure = [
            (float(item["value"]), float(item["std"]))
            for member in _members(effect, answer)
            for item in member.values()
            if item.get("role") in {"amplitude", "width"} and item.get("std") and item["value"]
        ]
        if does is not None and sure:
            value, std = max(sure, key=lambda one: abs(one[0]) / one[1])
            return math.copysign(float(does), value), abs(float(does) * std / value)
    return None, 0.0


def rates(scores: Sequence[Verdict]) -> dict[str, Rate]:
    """The rates of the table; those of right names and abstentions over what is above the detection limit, and of right
    names also over what is above it beside any friction over speed: a law that is none of that alone."""
    singles = [one for one in scores if one.kind == "single"]
    seen = [one for one in singles if one.counts]
    return {
        "right_name": rate_of([one.right for one in seen]),
        "right_name_apart": rate_of([one.right for one in seen if one.apart]),
        "right_or_in_part": rate_of([one.right or (one.in_part and not one.wrong) for one in seen]),
        "below_the_limit": rate_of([one.right for one in singles if not one.counts]),
        "abstention": rate_of([one.right for one in scores if one.kind == "outsider" and one.counts]),
        "wrong_name": rate_of([one.wrong for one in scores]),
        "wrong_name_parameters": rate_of([one.wrong for one in scores if one.kind == "parameters"]),
    }


def closure_of(scores: Sequence[Verdict]) -> dict[str, Any]:
    """The closure of the injected part where the name is right, above the detection limit: median and quartiles [1]."""
    found = [one.closure for one in scores if one.kind == "single" and one.counts and one.right]
    numbers = [one for one in found if one is not None]
    if not numbers:
        return {"count": 0, "median": None, "quartiles": None}
    return {
        "count": len(numbers),
        "median": float(np.median(numbers)),
        "quartiles": np.quantile(numbers, [0.25, 0.75]).tolist(),
    }
