"""Figures of merit of a trial on many machines: what its targets ask of the bounds, of the worst machines, of kinds.

A target is reached where the bound of the 95 % interval (Clopper and Pearson) reaches it. A crash or a refusal is a
wrong answer of whatever kind.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import scipy

from models.effects.catalogue import every
from studies.blind_trial import figures_of_merit as merit
from studies.blind_trial.figures_of_merit import Rate, counted, of_kind, rate
from studies.blind_trial.scoring import CASE_KINDS, NAMING, WITHOUT_EFFECT, Label, Score, score
from studies.study import Check

SOURCE: Final = "what a trial on drawn machines is to reach"
WORST: Final = 0.1  # the share of the machines that are named as the worst
SIMULATED_TRIALS: Final = 2000  # simulated trials of equally good machines
CASES, MACHINES, INNOCENTS = 1000, 150, 200  # from which on a trial supports its claims
A_CASE: Final = 9.0  # s on two cores: 1000 cases in two and a half hours

TOLD_FEATURES: Final = 6  # features of the worst machines that are told

TARGETS: Final[tuple[tuple[str, str, str, float], ...]] = (
    ("right_name", "right name, single effects above the detection limit: lower bound", ">=", 0.90),
    ("both_named", "both of two effects named: lower bound", ">=", 0.80),
    ("false_accusation", "false accusation or no answer, nothing wrong or parameters only: upper bound", "<=", 0.02),
    ("abstention", "abstention on effects outside the catalogue: lower bound", ">=", 0.90),
    ("right_coordinate", "such an abstention with the right coordinate: lower bound", ">=", 0.85),
    ("abstention_disabled", "abstention on effects whose entry is disabled: lower bound", ">=", 0.90),
)


def figures(
    bodies: Mapping[str, str], labels: Mapping[str, Label], answers: Mapping[str, Any]
) -> dict[str, Any] | None:
    """All figures of a trial on many machines; None for labels that state no machine."""
    features = _features(bodies)
    if not features:
        return None
    scores = [score(label, answers[case]) for case, label in labels.items()]
    return {
        "count": len(features),
        "innocents": len(of_kind(scores, *WITHOUT_EFFECT)),
        "rates": {name: one.plain() for name, one in rates(scores).items()},
        "worst": worst(scores, features),
        "kinds": confusion_of_kinds(scores),
        "forms": _forms(bodies, scores),
        "learned": learned_closure(answers),
        "rejected": _rejected(bodies),
        "errors": _errors(answers),
        "features": {str(number): row for number, row in sorted(features.items())},
    }


def rates(scores: Sequence[Score]) -> dict[str, Rate]:
    """The rates that have targets, and that of crashes and refusals."""
    outsiders = of_kind(scores, "outsider")
    return {
        **merit.rates(scores),
        "false_accusation": rate(
            of_kind(scores, *WITHOUT_EFFECT), lambda one: one.false_positive or one.outcome == "failed"
        ),
        "right_coordinate": rate(outsiders, lambda one: one.right and one.coordinate in one.label.coordinates),
        "right_kind": rate(of_kind(scores, "single"), _right_kind),
        "right_name_low": rate(
            [one for one in of_kind(scores, "single", counting=False) if not one.counts], lambda one: one.right
        ),
    }


def _features(bodies: Mapping[str, str]) -> dict[int, dict[str, Any]]:
    """What is known of each machine, by its number."""
    found: dict[int, dict[str, Any]] = {}
    for body in bodies.values():
        row = json.loads(body).get("machine")
        if isinstance(row, dict) and "number" in row:
            found.setdefault(int(row["number"]), {name: one for name, one in row.items() if name != "number"})
    return found


def worst(scores: Sequence[Score], features: Mapping[int, Mapping[str, Any]]) -> dict[str, Any] | None:
    """The tenth of the machines with the smallest share of right names, what that tenth would reach by chance if all
    machines were equally good, and the features by which it differs most from the others; None without a single."""
    flags: dict[int, list[bool]] = {}
    for one in of_kind(scores, "single"):
        if one.label.machine is not None:
            flags.setdefault(one.label.machine, []).append(one.right)
    if not flags:
        return None
    tries = {number: len(row) for number, row in flags.items()}
    hits = {number: sum(row) for number, row in flags.items()}
    order = sorted(flags, key=lambda number: (hits[number] / tries[number], -tries[number], number))
    chosen = order[: _tenth(len(order))]
    share = sum(hits[number] for number in chosen) / sum(tries[number] for number in chosen)
    return {
        "machines": [number + 1 for number in chosen],
        "share": share,
        "tries": sum(tries[number] for number in chosen),
        "by_chance": _by_chance(list(tries.values()), sum(hits.values()) / sum(tries.values())),
        "common": common([features[n] for n in chosen], [features[n] for n in order[len(chosen) :]]),
    }


def _tenth(count: int) -> int:
    return max(1, round(WORST * count))


def _by_chance(tries: Sequence[int], share: float) -> float:
    """The mean share of right names in the worst tenth if every case is right with this probability."""
    rng, sizes = np.random.default_rng(0), np.array(tries)
    hits = rng.binomial(sizes, share, size=(SIMULATED_TRIALS, sizes.size))
    order = np.lexsort((np.broadcast_to(-sizes, hits.shape), hits / sizes), axis=1)[:, : _tenth(sizes.size)]
    return float(np.mean(np.take_along_axis(hits, order, axis=1).sum(axis=1) / sizes[order].sum(axis=1)))


def common(chosen: Sequence[Mapping[str, Any]], others: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The features by which some machines differ most from others, by the rank-sum test of Mann and Whitney: medians of
    both and the p-value, the smallest first. A feature in words is taken as whether it is what most of them have."""
    found: list[dict[str, Any]] = []
    for name in chosen[0] if chosen and others else ():
        mine, theirs = (_numbers([row.get(name) for row in rows], chosen, name) for rows in (chosen, others))
        if not mine or not theirs or len({*mine, *theirs}) == 1:
            continue
        p = float(scipy.stats.mannwhitneyu(mine, theirs).pvalue)
        usual = _usual(chosen, name)
        label = f"{name} is {usual}" if usual is not None else name
        found.append({"feature": label, "worst": _middle(mine, usual), "others": _middle(theirs, usual), "p": p})
    return sorted(found, key=lambda row: float(row["p"]))[:TOLD_FEATURES]


def _usual(rows: Sequence[Mapping[str, Any]], name: str) -> str | None:
    words = [row[name] for row in rows if isinstance(row.get(name), str)]
    return max(sorted(set(words)), key=words.count) if words else None


def _numbers(values: Iterable[Any], rows: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    usual = _usual(rows, name)
    return [float(one == usual) if usual is not None else float(one) for one in values if one is not None]


def _middle(numbers: Sequence[float], usual: str | None) -> float:
    return float(np.mean(numbers) if usual is not None else np.median(numbers))


def confusion_of_kinds(scores: Sequence[Score]) -> dict[str, Any]:
    """Counts of the cases that count by the kind of the true effect (rows) and of what is answered (columns)."""
    ordered = sorted((one for one in scores if one.counts), key=lambda one: CASE_KINDS.index(one.label.kind))
    true = (kind_of(one.label.names[0]) if one.label.kind == "single" else one.label.kind for one in ordered)
    return counted(zip(true, map(_answered, ordered), strict=True), merit.LAST)


def kind_of(name: str) -> str:
    """What kind of law an effect has, whatever its form: side, coordinate, parity, memory."""
    if name not in every():
        return "unknown"
    kind = every()[name].kind()
    return f"{kind.side}, {kind.coordinate}, {kind.parity}{', memory' if kind.memory else ''}"


def _right_kind(one: Score) -> bool:
    """Whether the answer has one group, and in it an effect of the true one's kind."""
    return len(one.groups) == 1 and kind_of(one.label.names[0]) in map(kind_of, one.groups[0])


def _answered(one: Score) -> str:
    if one.outcome not in NAMING or not one.groups:
        return one.outcome
    kinds = {kind_of(group[0]) for group in one.groups}
    return kinds.pop() if len(kinds) == 1 else "several"


def _forms(bodies: Mapping[str, str], scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Of each effect and form among the singles that count: how often it is named, and what is answered instead."""
    found: dict[tuple[str, str], list[Score]] = {}
    for one in of_kind(scores, "single"):
        effect = json.loads(bodies[one.label.case])["effects"][0]
        found.setdefault((one.label.names[0], str(effect["form"])), []).append(one)
    return [
        {
            "name": name,
            "form": form,
            "right": rate(those, lambda one: one.right).plain(),
            "instead": sorted({_instead(one) for one in those if not one.right}),
        }
        for (name, form), those in sorted(found.items())
    ]


def _instead(one: Score) -> str:
    if one.outcome not in NAMING:
        return f"{one.outcome} (in part: {', '.join(one.alike)})" if one.alike else one.outcome
    return " + ".join(" or ".join(group) for group in one.groups)


def learned_closure(answers: Mapping[str, Any]) -> dict[str, Any]:
    """Closure, on types of motion that were not used, of the laws that answers have learned, whether or not they were
    adopted: those that were close 0.7 at least, by the threshold."""
    laws = [one.get("learned") or {} for one in answers.values()]
    closures = [float(law["closure"]) for law in laws if law.get("closure") is not None]
    return {"count": len(closures), "median": float(np.median(closures)) if closures else None}


def _rejected(bodies: Mapping[str, str]) -> dict[str, int]:
    """How many draws of a machine or its experiment were rejected, by reason; each machine counted once."""
    seen: dict[int, Mapping[str, int]] = {}
    for body in bodies.values():
        raw = json.loads(body)
        seen[int((raw.get("machine") or {}).get("number", -1))] = raw.get("rejected") or {}
    total: dict[str, int] = {}
    for row in seen.values():
        for why, count in row.items():
            total[why] = total.get(why, 0) + int(count)
    return dict(sorted(total.items(), key=lambda item: -item[1]))


def _errors(answers: Mapping[str, Any]) -> dict[str, int]:
    """How often each error took the place of an answer."""
    total: dict[str, int] = {}
    for one in answers.values():
        if one.get("error"):
            text = str(one["error"])[:160]
            total[text] = total.get(text, 0) + 1
    return dict(sorted(total.items(), key=lambda item: -item[1]))


def checks(results: Mapping[str, Any], quick: bool) -> list[Check]:
    """Every target of a trial on many machines, for the bound of each rate; those without cases are left out."""
    found, many = list[Check](), results["machines"]
    for key, name, sense, limit in TARGETS:
        one = many["rates"][key]
        if one["tries"]:
            found.append(Check(name, one["low"] if sense == ">=" else one["high"], "1", limit, SOURCE, sense))
    if many["worst"] is not None:
        found.append(
            Check("right name on the worst tenth of the machines", many["worst"]["share"], "1", 0.75, SOURCE, ">=")
        )
    if results["closure"]["count"]:
        found.append(Check("median closure of right answers", results["closure"]["median"], "1", 0.9, SOURCE, ">="))
    if many["learned"]["count"]:
        closure = many["learned"]["median"]
        found.append(Check("median closure of learned laws on motions not used", closure, "1", 0.7, SOURCE, ">="))
    if quick:  # A quick run is compared with a stored one, so it must not contain times, and is too small for claims.
        return found
    first = results["calibration"]["first"]
    if first["count"]:
        found.append(Check("calibration error of the probabilities", first["error"], "1", 0.05, SOURCE))
    if results["seconds"]["median"] is not None:
        found.append(Check("median time of one diagnosis", results["seconds"]["median"], "s", 20.0, SOURCE))
    if results["seconds"]["trial"] is not None and results["cases"] >= CASES:
        most = A_CASE * results["cases"]
        found.append(Check("time of the whole trial, on two cores", results["seconds"]["trial"], "s", most, SOURCE))
    for name, count, least in (
        ("cases", results["cases"], CASES),
        ("machines", many["count"], MACHINES),
        ("cases with nothing wrong or parameters only", many["innocents"], INNOCENTS),
    ):
        found.append(Check(f"{name}, enough for the claim", float(count), "1", float(least), SOURCE, ">="))
    return found
