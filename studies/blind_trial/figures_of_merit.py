"""Figures of merit of scored cases: every rate with its binomial interval, calibration, confusion matrix."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np

from studies.binomial import interval
from studies.blind_trial.scoring import CASE_KINDS, NAMING, OUT_OF_CATALOGUE, WITHOUT_EFFECT, Score

T = TypeVar("T")
CALIBRATION_BINS: Final = 10


@dataclass(frozen=True)
class Rate:
    """`hits` of `tries`, and the interval (Clopper and Pearson 1934) that holds the true share in 95 % of trials."""

    hits: int
    tries: int

    @property
    def share(self) -> float:
        """NaN where nothing was tried."""
        return self.hits / self.tries if self.tries else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """0 .. 1 where nothing was tried."""
        return interval(self.hits, self.tries)

    def plain(self) -> dict[str, Any]:
        """For results.json."""
        low, high = self.interval
        return {"hits": self.hits, "tries": self.tries, "share": self.share, "low": low, "high": high}


def rate(scores: Iterable[T], hit: Callable[[T], bool]) -> Rate:
    """How many of these are hits."""
    return rate_of([hit(one) for one in scores])


def of_kind(scores: Iterable[Score], *kinds: str, counting: bool = True) -> list[Score]:
    """The scores of cases of these kinds; `counting` leaves out cases whose effect is not identifiable."""
    return [one for one in scores if one.label.kind in kinds and (one.counts or not counting)]


def rates(scores: Sequence[Score]) -> dict[str, Rate]:
    """The rates of the trial's table."""
    return {
        "right_name": rate(of_kind(scores, "single"), lambda one: one.right),
        "both_named": rate(of_kind(scores, "pair"), lambda one: one.right),
        "false_accusation": rate(of_kind(scores, *WITHOUT_EFFECT), lambda one: one.false_positive),
        "abstention": rate(of_kind(scores, "outsider"), lambda one: one.right),
        "abstention_disabled": rate(of_kind(scores, "disabled"), lambda one: one.right),
        "innocent_named": rate(scores, lambda one: one.false_positive),
        "wrong_name": rate(of_kind(scores, "single", "pair"), lambda one: one.false_positive),
        "failed": rate(scores, lambda one: one.outcome == "failed"),
    }


def likeness(scores: Sequence[Score]) -> Rate:
    """How often the effect that the gap partly resembles, according to an abstention, is in the table. All kinds of
    tables count, also those with an out-of-catalogue effect, as the reader of such an answer cannot know the kind."""
    return rate([one for one in scores if one.alike], lambda one: bool({*one.alike} & {*one.label.names}))


def by_severity(scores: Sequence[Score]) -> dict[str, dict[str, Any]]:
    """Single effects of each severity, also those not identifiable: right name, no name, wrong name."""
    found: dict[str, dict[str, Any]] = {}
    for severity in ("low", "middle", "high"):
        those = [one for one in of_kind(scores, "single", counting=False) if one.label.severity == severity]
        distances = [one.label.distance for one in those if one.label.distance is not None]
        found[severity] = {
            "right": rate(those, lambda one: one.right).plain(),
            "silent": rate(those, lambda one: one.outcome not in NAMING).plain(),
            "accused": rate(those, lambda one: one.false_positive).plain(),
            "median_distance": float(np.median(distances)) if distances else None,
        }
    return found


def closures(scores: Sequence[Score]) -> dict[str, Any]:
    """Closure of the gap where the answer is right: its median and quartiles."""
    right = [one for one in of_kind(scores, "single", "pair") if one.right and one.closure is not None]
    numbers = [one.closure for one in right if one.closure is not None]
    if not numbers:
        return {"count": 0, "median": None, "quartiles": None}
    return {
        "count": len(numbers),
        "median": float(np.median(numbers)),
        "quartiles": np.quantile(numbers, [0.25, 0.75]).tolist(),
    }


@dataclass(frozen=True)
class Statement:
    """A probability that an answer states for an effect, and whether the effect is in the case."""

    probability: float
    true: bool


def statements(answers: Mapping[str, Any], scores: Sequence[Score], first: bool) -> list[Statement]:
    """The probabilities that the answers state: for each case's first candidate only, or for all."""
    found = []
    for one in scores:
        which = answers[one.label.case].get("which") or ()
        stated = [entry for entry in which if entry.get("probability") is not None]
        for entry in stated[: 1 if first else None]:
            inside = entry["effect"] in one.label.names and one.label.kind not in OUT_OF_CATALOGUE
            found.append(Statement(float(entry["probability"]), inside))
    return found


def calibration(found: Sequence[Statement]) -> dict[str, Any]:
    """Expected calibration error over ten bins of equal width (Naeini, Cooper, Hauskrecht 2015), and the bins."""
    bins, error = [], 0.0
    for k in range(CALIBRATION_BINS):
        low, high = k / CALIBRATION_BINS, (k + 1) / CALIBRATION_BINS
        those = [
            one
            for one in found
            if low <= one.probability < high or (k == CALIBRATION_BINS - 1 and one.probability == 1.0)
        ]
        if not those:
            continue
        stated = float(np.mean([one.probability for one in those]))
        true = rate_of([one.true for one in those])
        bins.append({"low": low, "high": high, "stated": stated, "true": true.plain()})
        error += len(those) / len(found) * abs(stated - true.share)
    return {"count": len(found), "error": error if found else None, "bins": bins}


def rate_of(flags: Sequence[bool]) -> Rate:
    """How many are true."""
    return Rate(sum(flags), len(flags))


def confusion(scores: Sequence[Score]) -> dict[str, Any]:
    """The confusion matrix: counts of cases by their true content (rows) and the answer (columns)."""
    ordered = sorted(scores, key=lambda one: (CASE_KINDS.index(one.label.kind), one.label.names))
    return counted(
        [(one.label.names[0] if one.label.kind == "single" else one.label.kind, _said(one)) for one in ordered], LAST
    )


def counted(pairs: Iterable[tuple[str, str]], last: Collection[str]) -> dict[str, Any]:
    """Counts of cases by pairs of what is true (rows, in the order of their first pair) and what is answered (columns,
    in the alphabet's order, with those named in `last` behind them)."""
    rows: dict[str, dict[str, int]] = {}
    for row, said in pairs:
        counts = rows.setdefault(row, {})
        counts[said] = counts.get(said, 0) + 1
    columns = sorted({said for row in rows.values() for said in row}, key=lambda said: (said in last, said))
    return {
        "rows": list(rows),
        "columns": columns,
        "counts": [[row.get(said, 0) for said in columns] for row in rows.values()],
    }


LAST: Final = ("several", "none_of_these", "parameters", "nothing_to_explain", "failed")


def _said(one: Score) -> str:
    """The confusion matrix's column of an answer: the true name if the answer is right, else the first name given."""
    if one.outcome not in NAMING or not one.groups:
        return one.outcome
    if one.label.kind in ("single", "pair") and one.right:
        return one.label.names[0] if one.label.kind == "single" else "both"
    return one.groups[0][0] if len(one.groups) == 1 else "several"
