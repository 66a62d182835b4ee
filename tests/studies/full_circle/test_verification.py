"""The verification is by the specification, and against records of the design in place alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from design.redesign.designs import in_place
from design.redesign.outcome import PERIODS, Outcome, judged_target, outcome, tolerance_reached
from design.validation import sequence
from models.controller import References
from models.records.files import Loaded
from models.records.record import Record
from models.simulation.simulator import simulate
from studies.full_circle.folder_of_records import Given
from studies.full_circle.redesigning import old_design, references_of, table
from studies.full_circle.report import headline, in_its_interval
from studies.full_circle.verification import (
    Tried,
    checks,
    closing,
    contradicting,
    expected_to_settle,
    sentence,
    settles,
    slowest,
    tried,
    verified,
)
from tests.design.redesign.axes import KNOWN, TRUE

SPECIFIED = KNOWN.specification.settling_time
GOOD = Outcome(0.9 * SPECIFIED, 1e-7, 10, 0)
LATE = Outcome(1.2 * SPECIFIED, 1e-7, 10, 0)
SLOW = Outcome(2.0 * SPECIFIED, 5e-7, 10, 0)
NEVER = Outcome(KNOWN.specification.interval, 5e-7, 10, 4)


@cache
def run(feedforward: float = 1.0, periods: int = PERIODS) -> Record:
    """A run of what the design in place makes of its target, with so many times its feedforward."""
    target = judged_target(KNOWN) if periods == PERIODS else sequence(KNOWN, None, periods, 400)
    known = in_place(old_design(KNOWN), KNOWN, target)
    given = References(known.position, feedforward * (known.feedforward + known.compensation), 0 * target)
    return simulate(TRUE, KNOWN.feedback_only(), target, given=given, seed=3).record


def shown(*, kept: bool = False) -> dict[str, Any]:
    row = {"taken": True, "settling": {"low": 0.0, "high": SPECIFIED}, "dispersion": {"low": 0.0, "high": 1e-6}}
    return {"kept": kept, "designs": [row]}


def judged(before: Outcome | None, after: Outcome | None, *, kept: bool = False) -> dict[str, Any]:
    pairs = (("current", before), ("redesign", after))
    found = [Tried(f"{design}.csv", design, run(), one) for design, one in pairs if one is not None]
    return verified(KNOWN, found, shown(kept=kept))


@pytest.mark.parametrize(
    ("before", "after", "state", "met", "missed"),
    [
        (SLOW, GOOD, "holds", True, 0),
        (None, GOOD, "holds", True, 0),
        (SLOW, LATE, "missed", False, 1),
        (None, LATE, "missed", False, 1),
        (NEVER, SLOW, "missed", False, 1),
        (NEVER, NEVER, "missed", False, 1),
        (NEVER, replace(NEVER, never=10), "rolled back", False, 2),
        (NEVER, replace(NEVER, settling=2 * NEVER.settling), "missed", False, 1),  # watched for longer
        (GOOD, LATE, "rolled back", True, 1),
        (LATE, SLOW, "rolled back", False, 2),
        (SLOW, None, "asked", None, 0),
    ],
)
def test_a_redesign_holds_only_where_the_specification_is_met(
    before: Outcome | None, after: Outcome | None, state: str, met: bool | None, missed: int
) -> None:
    found = judged(before, after)
    assert (found["state"], found["met"]) == (state, met)
    assert sum(not one.holds for one in checks(found, SPECIFIED)) == missed
    assert sentence(found, SPECIFIED).startswith(state)


@pytest.mark.parametrize(("before", "met"), [(GOOD, True), (SLOW, False), (None, None)])
def test_a_design_in_place_that_stays_is_held_to_the_specification(before: Outcome | None, met: bool | None) -> None:
    found = judged(before, None, kept=True)
    assert (found["state"], found["met"]) == ("kept", met)
    assert [one.holds for one in checks(found, SPECIFIED)] == ([] if met is None else [met])


def test_all_records_of_a_design_count_whatever_their_order() -> None:
    """By the slowest of all motions and the largest 3 sigma: one record of two is late, and the other spreads."""
    late, spread = LATE, replace(GOOD, dispersion=4e-7)
    found = [Tried(f"{k}.csv", "redesign", run(), one) for k, one in enumerate((late, spread))]
    for before, state, met, worse in ((SLOW, "missed", False, 0), (GOOD, "rolled back", True, 2)):
        place = Tried("old.csv", "current", run(), before)
        told = [verified(KNOWN, records, shown()) for records in ([place, *found], [*reversed(found), place])]
        assert [(one["state"], one["met"], len(one["worse"])) for one in told] == [(state, met, worse)] * 2
        assert {one["after"]["settling_s"] for one in told} == {late.settling}
        assert {one["after"]["dispersion_m"] for one in told} == {spread.dispersion}
        assert {one["after"]["motions"] for one in told} == {20}
    assert slowest(found, "redesign") is found[0]
    assert slowest(found, "current") is None


def test_a_motion_that_never_settles_has_no_time() -> None:
    found = judged(NEVER, NEVER)
    interval = KNOWN.specification.interval
    assert settles(found["after"]) == "never settles in 4 of 10 motions"
    assert expected_to_settle(interval, interval, interval) == "has motions that never settle"
    assert expected_to_settle(0.011, interval, interval) == "settles in 11 ms or never"
    assert expected_to_settle(0.011, 0.02, interval) == "settles in 11 ms to 20 ms"
    lost = judged(SLOW, replace(NEVER, never=2))
    assert lost["worse"] == ["settling of the slowest motion: never in 2 of 10 motions instead of 50 ms"]
    told = [sentence(found, SPECIFIED), closing(found, ()), headline(told_of("b"), found)]
    assert not any("150 ms" in text for text in told)
    (missed,) = (one for one in checks(found, SPECIFIED) if not one.holds)
    assert (missed.name, missed.value) == ("motions of the redesign that never settle", 4)


def told_of(chosen: str) -> dict[str, Any]:
    """What a headline needs of a redesign."""
    rows = [{"name": name, "settling": {"median": SPECIFIED}, "dispersion": {"median": 1e-7}} for name in ("a", "b")]
    return {"kept": False, "designs": rows, "chosen": chosen, "specified": {"settling_s": SPECIFIED}}


def test_what_is_missed_is_said_with_what_would_be_met() -> None:
    found = judged(SLOW, LATE)
    text = closing(found, ("it is the dead time",))
    assert text.startswith("the specification is missed")
    assert "outside the interval that its model expects; it is the dead time" in text
    assert "a settling time of 30 ms, or a tolerance of" in text
    assert "better than the design in place, which settles in 50 ms, but 25 ms are specified" in sentence(
        found, SPECIFIED
    )
    assert "no better than the design in place" in sentence(judged(NEVER, NEVER), SPECIFIED)
    assert "misses the specification" in headline(told_of("b"), found)
    assert "closed" in closing(judged(SLOW, GOOD), ())


def given(record: Record) -> Given:
    loaded = Loaded("strokes", "", record, (), ())
    return Given(Path("strokes.csv"), "motion", "diagnose", loaded)


@pytest.mark.parametrize(
    ("record", "design"),
    [
        (run(), "current"),
        (run(periods=3), "current"),  # no table of the program's, but what the design makes of this target
        (replace(run(), feedforward=0 * run().feedforward), "current"),  # a log without a feedforward
        (run(0.8), "other"),
        (replace(run(), reference=run().target, feedforward=0 * run().target), "other"),
    ],
)
def test_only_what_the_design_in_place_makes_counts_as_in_place(record: Record, design: str) -> None:
    known = references_of(KNOWN, old_design(KNOWN), own_loop=True)
    text = table(judged_target(KNOWN), known, KNOWN.sample_time)
    other = replace(known, feedforward=1.1 * known.feedforward)
    tables = {"current": text, "redesign": table(judged_target(KNOWN), other, KNOWN.sample_time)}
    (found,) = tried(KNOWN, [given(record)], tables)
    assert found.design == design
    result = verified(KNOWN, [found], shown())
    assert (result["before"] is not None) == (design == "current")


def test_both_intervals_are_told_in_one_sentence() -> None:
    told = {
        (settling, spread): in_its_interval({"settling": settling, "dispersion": spread})
        for settling in (True, False)
        for spread in (True, False)
    }
    assert told == {
        (True, True): "Settling and 3σ were both in their expected intervals",
        (True, False): "Settling was in its expected interval, 3σ was not",
        (False, True): "3σ was in its expected interval, settling was not",
        (False, False): "Neither settling nor 3σ was in its expected interval",
    }


def test_the_tolerance_that_would_have_been_met_is_met() -> None:
    reached = tolerance_reached(run(), KNOWN)
    assert reached > KNOWN.specification.tolerance
    wider = replace(KNOWN, specification=replace(KNOWN.specification, tolerance=reached))
    found = outcome(run(), wider)
    assert found is not None
    assert found.settling <= SPECIFIED * (1 + 1e-9)


@pytest.mark.parametrize(
    ("low", "high", "found", "told"),
    [
        (SPECIFIED, 1.2 * SPECIFIED, GOOD, "predicted: settles in 25 ms to 30 ms; measured: settles in 22.5 ms"),
        (0.5 * SPECIFIED, SPECIFIED, LATE, "predicted: settles in 12.5 ms to 25 ms; measured: settles in 30 ms"),
        (0.15, 0.15, SLOW, "predicted: has motions that never settle; measured: settles in 50 ms"),
        (0.5 * SPECIFIED, SPECIFIED, NEVER, "measured: never settles in 4 of 10 motions"),
        (0.15, 0.15, NEVER, ""),
        (0.5 * SPECIFIED, SPECIFIED, GOOD, ""),
        (0.91 * SPECIFIED, SPECIFIED, GOOD, ""),  # by less than two records of one design may differ
    ],
)
def test_a_record_that_contradicts_what_is_expected_of_the_design_in_place_is_told(
    low: float, high: float, found: Outcome, told: str
) -> None:
    expected = {"settling": {"low": low, "high": high}, "dispersion": {"low": 0.0, "high": 1e-6}}
    said = contradicting(found, expected, KNOWN)
    assert len(said) == bool(told)
    assert told in "".join(said)


def test_a_spread_that_contradicts_is_told_too_and_only_of_the_design_in_place() -> None:
    expected = {"settling": {"low": 0.0, "high": SPECIFIED}, "dispersion": {"low": 3e-6, "high": 8e-6}}
    assert contradicting(GOOD, expected, KNOWN) == ["predicted: 3 sigma 3 µm to 8 µm; measured: 100 nm"]
    assert judged(None, SLOW)["contradicts"] == []
    assert len(judged(SLOW, None)["contradicts"]) == 1
