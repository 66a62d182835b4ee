"""What the records show of the design in place and of the redesign: against the specification, and against each other.

states: "kept" where there was no better design, "asked" where the redesign's record is missing, "holds" where it meets
the specification, "missed" where it does not, "rolled back" where it was worse than the design in place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from design.redesign.choice import MEASURE_UNITS, WORSE, least, worse
from design.redesign.designs import in_place
from design.redesign.outcome import Outcome, judged_motions, outcome, together, tolerance_reached
from models.machine import Machine
from models.quantity import ROUNDING, keeps_to, show, span
from models.records.record import Record
from studies.full_circle import asked, redesigning
from studies.full_circle.folder_of_records import Given
from studies.study import Check

NAMES: Final = {
    "current": "in place",
    "redesign": "the redesign",
    "earlier": "an earlier redesign",
    "other": "not the design in place",
    "unclear": "unclear, as its feedforward is not mapped",
}


@dataclass(frozen=True)
class Tried:
    """A record of motions over the specified stroke, by its file's name: the run, what it achieved, and the design that
    made it: "current", "redesign", "earlier" (a redesign), "other" or "unclear"."""

    name: str
    design: str
    run: Record
    outcome: Outcome


def tried(machine: Machine, given: Sequence[Given], tables: Mapping[str, str]) -> tuple[Tried, ...]:
    """The records that motions can be judged in; tables: of the design in place ("current") and of the redesign."""
    known = {kind: asked.asked(kind, text) for kind, text in tables.items()}
    found = []
    for one in given:
        run = one.run if one.run is not None else one.loaded.content
        if not isinstance(run, Record) or (one.run is None and one.role != "diagnose"):
            continue
        achieved = outcome(run, machine)
        if achieved is not None:
            found.append(Tried(one.path.name, _design(machine, one, run, known), run, achieved))
    return tuple(found)


def _design(machine: Machine, one: Given, run: Record, known: Mapping[str, asked.Asked]) -> str:
    if one.table is not None and one.table.kind == "redesign":
        return "redesign" if asked.same(one.table, known["redesign"]) else "earlier"
    if one.unclear:
        return "unclear"
    followed = asked.ran(run, (known["current"],)) is not None
    return "current" if followed or _made_in_place(machine, run) else "other"


def _made_in_place(machine: Machine, run: Record) -> bool:
    """Whether the reference and the feedforward of the judged motions are what the design in place makes of their
    target. What the compensator remembers of earlier motions is not in the record, so that those do not count."""
    own = run.target - run.target[0]
    known = in_place(redesigning.old_design(machine), machine, own)
    begin = judged_motions(run, machine)[0].start
    pushed = known.feedforward + known.compensation
    made = asked.Asked("current", "", own[begin:], known.position[begin:], pushed[begin:])
    return asked.alike(run.part(begin, run.position.size), made)


def of_design(found: Sequence[Tried], design: str) -> list[Tried]:
    """The records that this design made."""
    return [one for one in found if one.design == design]


def slowest(found: Sequence[Tried], design: str) -> Tried | None:
    """Of the records that this design made, the one with the slowest motion; None where there is none."""
    key = lambda one: (one.outcome.never_share, one.outcome.settling)  # noqa: E731
    return max(of_design(found, design), key=key, default=None)


def verified(machine: Machine, found: Sequence[Tried], shown: Mapping[str, Any]) -> dict[str, Any]:
    """What the records show of both designs, and which of the two is to be kept: each is judged by all motions of all
    its records. shown: what is expected of them."""
    kept = shown["kept"]
    made = {"current": of_design(found, "current"), "redesign": [] if kept else of_design(found, "redesign")}
    before, after = (together([one.outcome for one in records]) for records in made.values())
    lost = worse(before, after, machine) if before is not None and after is not None else ()
    stays = after if after is not None and not lost else before if kept or lost else None
    runs = made["current" if kept or lost else "redesign"]
    met = None if stays is None else _met(stays, machine)
    tested = "rolled back" if lost else "holds" if met else "missed"
    return {
        "rows": [
            {"record": one.name, "design": NAMES[one.design], **(redesigning.outcome_to_json(one.outcome) or {})}
            for one in found
        ],
        "before": redesigning.outcome_to_json(before),
        "after": redesigning.outcome_to_json(after),
        "worse": list(lost),
        "state": "kept" if kept else "asked" if after is None else tested,
        "met": met,
        "reached_tolerance_m": max((tolerance_reached(one.run, machine) for one in runs), default=None),
        "interval_s": machine.specification.interval,
        "inside": None if after is None else _inside(after, shown, machine),
        "contradicts": [] if before is None else contradicting(before, shown["designs"][0], machine),
    }


def _met(found: Outcome, machine: Machine) -> bool:
    """Whether all motions settled within the specified time; no 3 sigma is specified in a machine file."""
    return not found.never and keeps_to(found.settling, machine.specification.settling_time)


def _inside(after: Outcome, shown: Mapping[str, Any], machine: Machine) -> dict[str, bool]:
    """Whether the redesign achieved what was expected of it, to a sample."""
    (row,) = (row for row in shown["designs"] if row["taken"])
    slack = {"settling": machine.sample_time, "dispersion": 0.0}
    return {
        name: bool(row[name]["low"] - slack[name] <= getattr(after, name) <= row[name]["high"] + slack[name])
        for name in MEASURE_UNITS
    }


def contradicting(before: Outcome, expected: Mapping[str, Any], machine: Machine) -> list[str]:
    """In which quantity the record of the design in place is outside the interval in which it was expected, in words;
    expected: that design's row. What is off by no more than two records may be from each other (see `worse`) counts
    as inside."""
    found = []
    for name, unit in MEASURE_UNITS.items():
        low, high, value = expected[name]["low"], expected[name]["high"], float(getattr(before, name))
        slack = least(machine)[name]
        if low / (1 + WORSE) - slack <= value <= high * (1 + WORSE) + slack:
            continue
        if name == "settling":
            told = [
                expected_to_settle(low, high, machine.specification.interval),
                settles({"never": before.never, "settling_s": value, "motions": before.motions}),
            ]
        else:
            told = [f"3 sigma {span(show(low, unit, 2), show(high, unit, 2))}", show(value, unit, 2)]
        found.append(f"predicted: {told[0]}; measured: {told[1]}")
    return found


def settles(found: Mapping[str, Any]) -> str:
    """When the motions of a record settled, in words; a motion that never did has no time."""
    if found["never"]:
        return f"never settles in {found['never']} of {found['motions']} motions"
    return f"settles in {show(found['settling_s'], 's', 3)}"


def time_to_settle(time: float, interval: float) -> str:
    """An expected settling time [s], in words: a motion that lasts the whole interval [s] to the next never settled."""
    return "never" if keeps_to(interval, time) else show(time, "s", 3)


def expected_to_settle(low: float, high: float, interval: float) -> str:
    """Between which times [s] a design is expected to settle, in words; interval: from one motion to the next [s]."""
    first, final = time_to_settle(low, interval), time_to_settle(high, interval)
    if first == "never":
        return "has motions that never settle"
    return f"settles in {first} or never" if final == "never" else f"settles in {span(first, final)}"


def sentence(one: Mapping[str, Any], specified: float) -> str:
    """What came of the verification, in words; specified: by when motions are to settle [s]."""
    before, after, within = one["before"], one["after"], show(specified, "s")
    if one["state"] == "kept":
        told = "the design in place stays"
        return told if before is None else f"{told}: it {settles(before)}, against the specified {within}"
    if one["state"] == "asked":
        return "asked: there is no record of the redesign yet"
    if one["state"] == "rolled back":
        return f"rolled back: {'; '.join(one['worse'])}"
    found = f"{one['state']}: the redesign {settles(after)}"
    link = "and" if one["met"] else "but"
    if before is None:
        return f"{found}, {link} {within} are specified; what the design in place achieves is not in the records"
    compared = "better" if _sooner(after, before) else "no better"
    return f"{found}, {compared} than the design in place, which {settles(before)}, {link} {within} are specified"


def _sooner(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether a smaller share of a record's motions never settles, or the same and the slowest settles sooner."""
    shares = [row["never"] / row["motions"] for row in (one, other)]
    return bool((shares[0], one["settling_s"]) < (shares[1], other["settling_s"]))


def checks(one: Mapping[str, Any], specified: float) -> list[Check]:
    """That the design that stays meets the specification [s], and that the redesign is not worse than the one in place;
    each as soon as there are records of it."""
    found, both = list[Check](), one["before"] is not None and one["after"] is not None
    stays = one["after"] if one["state"] in {"holds", "missed"} else one["before"]
    if one["met"] is not None:
        design = "redesign" if one["state"] in {"holds", "missed"} else "design in place"
        if stays["never"]:
            found.append(Check(f"motions of the {design} that never settle", stays["never"], "1", 0.0, "its record"))
        else:
            name = f"settling of the slowest motion of the {design}"
            found.append(Check(name, stays["settling_s"], "s", specified * (1 + ROUNDING), "the specification"))
    if both:
        name = "in how much the redesign is worse than the design in place, of settling and 3 sigma"
        found.append(Check(name, float(len(one["worse"])), "1", 0.0, "the records of both"))
    return found


def closing(one: Mapping[str, Any], unmet: Sequence[str]) -> str:
    """Why nothing is left to be run; where the specification is missed, why, and which one would be met."""
    if one["met"]:
        return "the specification is met in the record, and the circle is closed"
    found = one["after"] if one["state"] == "missed" else one["before"]
    reached = f"a tolerance of {show(one['reached_tolerance_m'], 'm', 2)}"
    if not found["never"]:
        reached = f"a settling time of {show(found['settling_s'], 's', 3)}, or {reached}"
    off = one["state"] == "missed" and not one["inside"]["settling"]
    why = "; ".join([*["the axis settles outside the interval that its model expects"] * off, *unmet])
    head = "the specification is missed, and no record that is known to help is missing"
    return f"{head}: {why}. Achieved was {reached}" if why else f"{head}. Achieved was {reached}"
