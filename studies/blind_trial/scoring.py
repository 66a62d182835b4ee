"""The rules by which an answer is scored, fixed before any key is opened.

An answer names effects if its outcome is `attributed` or `ambiguous`. They form groups: an effect together with those
stated to be equivalent to it; `ambiguous` without stated groups is one group. A group of more than three makes no
answer right. A group that holds none of the table's effects is a false positive, however large it is. The answer to a
single effect is right if it has one group, which holds the effect. The answer to two effects is right if both are
named, each by a group of its own or by name, and nothing else. With an out-of-catalogue effect, or a disabled entry,
only the outcome `none_of_these` is right, and naming any effect is a false positive, as it is in a table without an
effect or with wrong nominal parameters only. Whether an effect is identifiable is decided by the distance that the
sealer computed and sealed with the label.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

LARGEST_SET: Final = 3
NAMING: Final = ("attributed", "ambiguous")
OUTCOMES: Final = (*NAMING, "none_of_these", "nothing_to_explain", "parameters", "failed")
WITHOUT_EFFECT: Final = ("clean", "parameters")
OUT_OF_CATALOGUE: Final = ("outsider", "disabled")
CASE_KINDS: Final = ("single", "pair", *OUT_OF_CATALOGUE, *WITHOUT_EFFECT)
NOTHING: Final = ("nothing", "none", "clean", "nothing_wrong", "nothing_to_explain")
PARAMETERS: Final = (
    "parameters",
    "payload_mass",
    "thrust_constant",
    "dead_time",
    "mode_frequency",
    "mode_damping",
    "friction_level",
    "presliding_stiffness",
    "contact_damping",
    "amplifier_offset",
    "initial_friction_state",
)


@dataclass(frozen=True)
class Label:
    """The sealed label of a case: kind, effects, distance (None: not stated), whether the effects are identifiable; the
    coordinates that an outsider depends on, and the machine by its number (None: not stated)."""

    case: str
    kind: str
    names: tuple[str, ...]
    severity: str
    distance: float | None
    identifiable: bool
    coordinates: tuple[str, ...] = ()
    machine: int | None = None


@dataclass(frozen=True)
class Score:
    """A scored case: whether the answer is right, whether it is a false positive, whether the case counts, the effects
    that an abstention says the gap partly resembles (`alike`), and the coordinate that it says explains most of it."""

    label: Label
    outcome: str
    groups: tuple[tuple[str, ...], ...]
    alike: tuple[str, ...]
    right: bool
    false_positive: bool
    counts: bool
    closure: float | None
    interval: tuple[float, float] | None
    probability: float | None
    seconds: float
    coordinate: str | None = None


class KeyFileError(ValueError):
    """A key that does not open a pack; the message is one sentence."""


def label_of(case: str, body: str, catalogue: Sequence[str]) -> Label:
    """The label in a sealed body; without a stated kind, it is classified by its names. Raises KeyFileError."""
    try:
        raw = json.loads(body)
        named = raw["name"]
        names = [str(name) for name in ([named] if isinstance(named, str) else named)]
    except (ValueError, TypeError, KeyError) as error:
        raise KeyFileError(
            f'{case}: its body must be JSON text with "case" and "name"; give the key of this pack'
        ) from error
    if raw.get("case") != case:
        raise KeyFileError(f"{case}: its body is of {raw.get('case')!r}; give the key of this pack")
    names = [name for name in names if name not in NOTHING]
    kind = raw.get("kind")
    if kind not in CASE_KINDS:
        kind = _kind(names, bool(raw.get("disabled")), catalogue)
    effects = tuple(name for name in names if name not in PARAMETERS) if kind in WITHOUT_EFFECT else tuple(names)
    distances = [one.get("distance") for one in raw.get("effects", []) if isinstance(one, Mapping)]
    known = [float(number) for number in distances if number is not None]
    return Label(
        case,
        kind,
        effects,
        str(raw.get("severity") or ""),
        min(known, default=None),
        bool(raw.get("identifiable", kind not in WITHOUT_EFFECT)),
        tuple(str(name) for name in raw.get("coordinates") or ()),
        int(raw["machine"]["number"]) if isinstance(raw.get("machine"), Mapping) else None,
    )


def _kind(names: Sequence[str], disabled: bool, catalogue: Sequence[str]) -> str:
    if not names:
        return "clean"
    if all(name in PARAMETERS for name in names):
        return "parameters"
    if disabled:
        return "disabled"
    if any(name not in catalogue for name in names):
        return "outsider"
    return "single" if len(names) == 1 else "pair"


def groups_of(verdict: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    """The groups of effects that a verdict names, the strongest first; none if its outcome names no effect."""
    if verdict.get("outcome") not in NAMING:
        return ()
    effects = [str(name) for name in verdict.get("effects") or ()]
    stated = [{str(name) for name in one} for one in verdict.get("equivalent") or ()]
    groups: list[set[str]] = []
    for name in effects:
        group = {name}.union(*(one for one in stated if name in one))
        touching = [one for one in groups if one & group]
        for one in touching[1:]:
            groups.remove(one)
        if touching:
            touching[0].update(group, *touching[1:])
        else:
            groups.append(group)
    if verdict["outcome"] == "ambiguous" and not stated and groups:
        groups = [set(effects)]
    return tuple(tuple(sorted(group, key=lambda name: (_place(name, effects), name))) for group in groups)


def _place(name: str, effects: Sequence[str]) -> int:
    return effects.index(name) if name in effects else len(effects)


def score(label: Label, answer: Mapping[str, Any]) -> Score:
    """Scores one answer against its label."""
    verdict = answer.get("verdict") or {}
    outcome = verdict.get("outcome") if verdict.get("outcome") in OUTCOMES else "failed"
    groups = groups_of(verdict)
    small = [group for group in groups if len(group) <= LARGEST_SET]
    if label.kind in WITHOUT_EFFECT:
        right = outcome not in (*NAMING, "failed")
    elif label.kind in OUT_OF_CATALOGUE:
        right = outcome == "none_of_these"
    elif label.kind == "single":
        right = len(groups) == 1 == len(small) and label.names[0] in small[0]
    else:
        right = _all_named(label.names, groups, verdict.get("effects") or ())
    false_positive = any(not set(group) & set(label.names) for group in groups) or (
        label.kind in OUT_OF_CATALOGUE and bool(groups)
    )
    how_far = answer.get("how_far") or {}
    interval = how_far.get("closure_interval")
    which = answer.get("which") or ()
    stated = [float(one["probability"]) for one in which if groups and one["effect"] == groups[0][0]]
    return Score(
        label,
        str(outcome),
        groups,
        tuple(verdict.get("partly") or ()),
        bool(right),
        bool(false_positive),
        label.kind in WITHOUT_EFFECT or label.identifiable,
        None if how_far.get("closure") is None else float(how_far["closure"]),
        None if not interval or None in interval else (float(interval[0]), float(interval[1])),
        stated[0] if stated else None,
        float(answer.get("seconds") or 0.0),
        _strongest((answer.get("where") or {}).get("by_coordinate") or {}),
    )


def _strongest(shares: Mapping[str, Any]) -> str | None:
    """The coordinate with the largest share of the gap; None where none has any."""
    known = {name: float(share) for name, share in shares.items() if share is not None}
    best = max(known, key=lambda name: known[name], default=None)
    return best if best is not None and known[best] > 0 else None


def _all_named(names: Sequence[str], groups: Sequence[Sequence[str]], effects: Sequence[str]) -> bool:
    """Whether each of several effects is named, by a small group of its own or by name, and nothing else is."""
    if any(len(group) > LARGEST_SET or not set(group) & set(names) for group in groups):
        return False
    for name in names:
        own = [group for group in groups if name in group]
        if not own or (name not in effects and len(set(own[0]) & set(names)) > 1):
            return False
    return True
