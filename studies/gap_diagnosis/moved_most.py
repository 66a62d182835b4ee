"""The values of the file whose change takes most of the gap: told first, with what they were, before any name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from diagnosis.criteria import Criteria
from diagnosis.diagnose import NAMED, Diagnosis
from diagnosis.handover.files import Content
from diagnosis.handover.moved_most import moved_most
from models.quantity import listed, show
from studies.gap_diagnosis import unknown_law
from studies.gap_diagnosis.course import is_unsure
from studies.wording import effect, words

Results = Mapping[str, Any]

MIN_GAP_SHARE: Final = 0.8  # of the gap to the noise floor, which the re-fit takes off where values are most of it
DIGITS: Final = range(4, 9)  # with as few of which as tell a number from what it was


def refit_is_most(results: Results) -> bool:
    """Whether re-fitted values alone take off most of the gap to the noise floor, in force."""
    before, after, floor = (
        results["how_far"][name]["force_N"] for name in ("gap_as_delivered", "gap_refitted", "floor")
    )
    return bool(before > floor and before - after >= MIN_GAP_SHARE * (before - floor))


def rows(found: Diagnosis, how_far: Results) -> list[dict[str, Any]]:
    """The values that take most of the gap, as they are beside the effects or the law that count; none where the re-fit
    takes off less than most of it, or where the file leaves hardly more than the floor."""
    before, floor = (how_far[name]["force_N"] for name in ("gap_as_delivered", "floor"))
    if not refit_is_most({"how_far": how_far}) or before**2 <= Criteria().min_force_ratio * floor**2:
        return []
    handover = found.how_far.handover
    file = handover.adopted if handover.adopted.name == Content.MEASURED else handover.named(Content.REFITTED)
    fitted = found.told if found.outcome in NAMED or file is None or file.finished is None else file.fitted
    return [one.to_json() for one in moved_most(fitted, found.baseline.records, floor)]


def leading(results: Results) -> Sequence[Results]:
    """The values that take most of the gap together, the one that takes the most first; none where they take less, or
    where the log departs from what acted, by which everything else is judged."""
    found = results.get("moved_most", ())
    if not found or not refit_is_most(results) or sum(one["share"] for one in found) < MIN_GAP_SHARE:
        return ()
    return () if _of_the_log(results) else found


def _of_the_log(results: Results) -> bool:
    """Whether a name tells why the stated controller does not make the commands of the log."""
    catalogue, names = results["catalogue"], results["verdict"]["effects"]
    of_log = any(catalogue.get(name, {}).get("shown_in") == "log" for name in names)
    return of_log and not all(one["replays"] for one in results["where"]["details"]["controller"])


def covered(results: Results) -> set[str]:
    """The kinds of values, and the effects of the file, that are told among those."""
    return {kind for one in leading(results) for kind in one["kinds"]}


def names(results: Results) -> list[str]:
    """Their names in words."""
    return [effect(one["name"]) for one in leading(results)]


def told(results: Results) -> list[str]:
    """Each of them with what it was and is, and its share of the gap."""
    return [
        f"{effect(one['name'])} ({', '.join(map(_changed, one['numbers']))}; {100 * one['share']:.0f} % of the gap)"
        for one in leading(results)
    ]


def told_alone(results: Results) -> bool:
    """Whether they have a sentence of their own, as an effect or a law follows, and not one with other values."""
    verdict = results["verdict"]
    return verdict["outcome"] in NAMED or is_unsure(verdict) or unknown_law.is_the_answer(results)


def among_others(results: Results) -> list[str]:
    """Each of them, for a sentence with other values; none where they have one of their own."""
    return [] if told_alone(results) else told(results)


def sentence(results: Results) -> list[str]:
    """What is said of them before a name or a law; none where they do not lead, or where none follows."""
    parts = told(results)
    if not parts or not told_alone(results):
        return []
    first, then, floor = (
        show(results["how_far"][name]["force_N"], "N", 3) for name in ("gap_as_delivered", "gap_refitted", "floor")
    )
    return [
        f"Nominal values are off, {listed(parts)}; re-fitted, they reduce the unknown force from {first} to {then}, "
        f"beside a noise floor of {floor}."
    ]


def _changed(number: Results) -> str:
    """A number now and before, with as many digits as tell them apart."""
    for digits in DIGITS:
        now, then = (show(number[when], number["unit"], digits) for when in ("now", "before"))
        if now != then:
            break
    return f"{words(number['name'])} {now} in place of {then}".strip()
