"""The rules by which an answer is scored, fixed before any key is opened.

An answer names an effect if its outcome is `attributed` or `ambiguous`. What it names falls into groups: an effect with
those that it is stated to be equivalent to; `ambiguous` without stated groups is one group. A group of more than three
names no one. A case with one effect is right if there is one group and it holds the effect: a further group is an
innocent accused. A case with two is right if both are named, each by a group of its own or by name, and nothing else.
An effect from outside the catalogue, or one whose entry is disabled, is right if the outcome is `none_of_these`. Where
nothing is wrong, or only nominal parameters are, naming any effect is a false accusation. What has to be found at all
is fixed by the distance that the sealer computed and sealed with the label.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

LARGEST_SET: Final = 3
NAMING: Final = ("attributed", "ambiguous")
OUTCOMES: Final = (*NAMING, "none_of_these", "nothing_to_explain", "parameters", "failed")
INNOCENT: Final = ("clean", "parameters")
STRANGE: Final = ("outsider", "disabled")
KINDS: Final = ("single", "pair", *STRANGE, *INNOCENT)
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
    "amplifier_offset",
    "initial_friction_state",
)


@dataclass(frozen=True)
class Label:
    """What was sealed of a case: its kind, the effects in it, how visible (None: not said), whether one must see it."""

    case: str
    kind: str
    names: tuple[str, ...]
    severity: str
    distance: float | None
    identifiable: bool


@dataclass(frozen=True)
class Score:
    """One case scored: right or not, whether an innocent was accused, whether the case counts, and the effects that it
    is said to be like in part, which names none."""

    label: Label
    outcome: str
    groups: tuple[tuple[str, ...], ...]
    alike: tuple[str, ...]
    right: bool
    accused: bool
    counts: bool
    closure: float | None
    interval: tuple[float, float] | None
    probability: float | None
    seconds: float


class KeyFileError(ValueError):
    """A key that does not open a pack; one sentence."""


def label_of(case: str, body: str, catalogue: Sequence[str]) -> Label:
    """The label in a sealed body. A body that does not tell its kind is sorted by its names. Raises KeyFileError."""
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
    if kind not in KINDS:
        kind = _kind(names, bool(raw.get("disabled")), catalogue)
    effects = tuple(name for name in names if name not in PARAMETERS) if kind in INNOCENT else tuple(names)
    distances = [one.get("distance") for one in raw.get("effects", []) if isinstance(one, Mapping)]
    known = [float(number) for number in distances if number is not None]
    return Label(
        case,
        kind,
        effects,
        str(raw.get("severity") or ""),
        min(known, default=None),
        bool(raw.get("identifiable", kind not in INNOCENT)),
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
    """The groups of effects that a verdict names, the strongest first; none if its outcome names nobody."""
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
    """One answer beside its label."""
    verdict = answer.get("verdict") or {}
    outcome = verdict.get("outcome") if verdict.get("outcome") in OUTCOMES else "failed"
    groups = groups_of(verdict)
    small = [group for group in groups if len(group) <= LARGEST_SET]
    if label.kind in INNOCENT:
        right = outcome not in (*NAMING, "failed")
    elif label.kind in STRANGE:
        right = outcome == "none_of_these"
    elif label.kind == "single":
        right = len(groups) == 1 == len(small) and label.names[0] in small[0]
    else:
        right = _all_named(label.names, groups, verdict.get("effects") or ())
    innocent = any(not set(group) & set(label.names) for group in groups) or (label.kind in STRANGE and bool(groups))
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
        bool(innocent),
        label.kind in INNOCENT or label.identifiable,
        None if how_far.get("closure") is None else float(how_far["closure"]),
        None if not interval or None in interval else (float(interval[0]), float(interval[1])),
        stated[0] if stated else None,
        float(answer.get("seconds") or 0.0),
    )


def _all_named(names: Sequence[str], groups: Sequence[Sequence[str]], effects: Sequence[str]) -> bool:
    """Whether each of several effects is named, by a small group of its own or by name, and nobody else is."""
    if any(len(group) > LARGEST_SET or not set(group) & set(names) for group in groups):
        return False
    for name in names:
        own = [group for group in groups if name in group]
        if not own or (name not in effects and len(set(own[0]) & set(names)) > 1):
            return False
    return True
