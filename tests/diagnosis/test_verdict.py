"""The rules by which an answer is given, on plain numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.criteria import Criteria
from diagnosis.verdict import Explanation, Outcome, verdict

CRITERIA = Criteria()


@pytest.mark.parametrize(
    ("closure", "interval", "excess", "outcome"),
    [
        (0.2, (0.05, 0.7), 0.0, Outcome.ATTRIBUTED),  # noise hides how much it is
        (0.05, (-0.6, 0.7), 0.0, Outcome.NONE),  # perhaps it is nothing
        (0.1, (0.05, 0.2), 0.0, Outcome.NONE),  # surely little
        (0.2, (0.05, 0.4), 0.0, Outcome.ATTRIBUTED),  # little, and nothing else is left
        (0.2, (0.05, 0.4), 5.0, Outcome.NONE),  # little, and something else is left
        (0.6, (0.5, 0.7), 5.0, Outcome.ATTRIBUTED),
        (0.6, (-0.05, 0.7), 5.0, Outcome.NONE),  # much in one place, and perhaps nothing elsewhere
    ],
)
def test_a_name_needs_a_gap_that_surely_shrinks(
    closure: float, interval: tuple[float, float], excess: float, outcome: Outcome
) -> None:
    assert verdict(Explanation(("play",), closure, interval, excess)) is outcome


@pytest.mark.parametrize(
    ("closure", "interval", "outcome"),
    [
        (0.6, (0.1, 0.7), Outcome.ATTRIBUTED),
        (0.4, (0.1, 0.7), Outcome.NONE),  # innovations at their floor say nothing, as they never were above it
    ],
)
def test_a_closure_of_the_unknown_force_has_to_be_half_of_the_gap(
    closure: float, interval: tuple[float, float], outcome: Outcome
) -> None:
    given = Explanation(("spring",), closure, interval, 0.0, by_force=True)
    assert verdict(given) is outcome
    assert verdict(replace(given, by_force=False)) is Outcome.ATTRIBUTED


@pytest.mark.parametrize(
    ("closure", "interval", "names", "outcome"),
    [
        (0.69, (0.63, 0.76), ("play", "cogging"), Outcome.ATTRIBUTED),
        (0.96, (0.49, 1.0), ("play", "cogging"), Outcome.NONE),  # much, and not surely half
        (0.52, (0.51, 0.53), ("play", "cogging"), Outcome.ATTRIBUTED),
        (0.72, (0.44, 1.0), ("play", "late"), Outcome.ATTRIBUTED),  # a simulation is late elsewhere
        (0.45, (0.44, 1.0), ("play", "late"), Outcome.NONE),
        (0.45, (0.44, 1.0), ("late",), Outcome.ATTRIBUTED),
    ],
)
def test_several_names_need_half_of_the_gap_for_sure(
    closure: float, interval: tuple[float, float], names: tuple[str, ...], outcome: Outcome
) -> None:
    assert verdict(Explanation(names, closure, interval, 5.0, random=["late"])) is outcome


@pytest.mark.parametrize(("low", "outcome"), [(0.51, Outcome.ATTRIBUTED), (0.49, Outcome.NONE)])
def test_on_a_rough_drive_one_name_needs_half_of_the_gap_for_sure(low: float, outcome: Outcome) -> None:
    given = Explanation(("play",), 0.6, (low, 0.8), 0.0, rough=True)
    assert verdict(given) is outcome
    assert verdict(replace(given, rough=False)) is Outcome.ATTRIBUTED


GOOD = Explanation(("play",), 0.9, (0.8, 1.0), 0.0)


@pytest.mark.parametrize(
    ("given", "outcome"),
    [
        (GOOD, Outcome.ATTRIBUTED),
        (replace(GOOD, at_bound=True, excess=2.1), Outcome.NONE),  # another law than the effect's
        (replace(GOOD, at_bound=True), Outcome.ATTRIBUTED),  # its own, in another form: it leaves nothing
        (replace(GOOD, at_bound=True, interval=(0.4, 1.0)), Outcome.NONE),  # not surely
        (replace(GOOD, at_bound=True, repeats=True), Outcome.NONE),  # a long sine draws any curve
        (replace(GOOD, at_bound=True, rough=True), Outcome.NONE),  # the floor does not say that
        (replace(GOOD, at_bound=True, names=("play", "cogging")), Outcome.NONE),
        (replace(GOOD, series={"play"}), Outcome.NONE),  # a series expansion of another law
        (replace(GOOD, series={"cogging"}), Outcome.ATTRIBUTED),  # of an effect that is not among the names
        (replace(GOOD, closure=0.3, interval=(0.2, 0.4)), Outcome.ATTRIBUTED),  # nothing else is left
        (replace(GOOD, closure=0.3, interval=(0.2, 0.4), rough=True), Outcome.NONE),  # the floor says nothing of that
        (replace(GOOD, closure=0.3, interval=(0.2, 0.4), by_force=True), Outcome.NONE),  # a force is surely left
        (replace(GOOD, closure=0.3, interval=(0.2, 0.4), by_force=True, force_excess=1.9), Outcome.ATTRIBUTED),
    ],
)
def test_a_name_needs_a_law_that_holds(given: Explanation, outcome: Outcome) -> None:
    assert verdict(given) is outcome


EMPTY = Explanation((), 0.0, (0.0, 0.0), 0.0)


@pytest.mark.parametrize(
    ("given", "outcome"),
    [
        (EMPTY, Outcome.NOTHING),
        (replace(EMPTY, parameter_shift=1.01 * CRITERIA.parameter_shift), Outcome.PARAMETERS),
        (replace(EMPTY, excess=1.01 * CRITERIA.missing_excess), Outcome.NONE),
        (replace(EMPTY, largest_innovation=8.1, spike=8.0), Outcome.NONE),  # a single sample that no noise makes
        (replace(EMPTY, largest_innovation=7.9, spike=8.0), Outcome.NOTHING),
        (replace(EMPTY, rough=True), Outcome.NONE),  # a force without a law is not nothing
    ],
)
def test_without_a_name_something_is_missing_or_the_parameters_were_wrong_or_nothing_was(
    given: Explanation, outcome: Outcome
) -> None:
    assert verdict(given) is outcome


@given(
    closure=st.floats(-1, 1),
    below=st.floats(0, 1),
    above=st.floats(0, 1),
    excess=st.floats(-5, 10),
    names=st.integers(1, 3),
)
def test_nothing_is_attributed_that_may_close_nothing_nor_where_half_is_out_of_reach(
    closure: float, below: float, above: float, excess: float, names: int
) -> None:
    interval = (closure - below, closure + above)
    given = Explanation(("play", "cogging", "stribeck")[:names], closure, interval, excess)
    if verdict(given) is Outcome.ATTRIBUTED:
        assert interval[0] > 0
        assert interval[1] >= CRITERIA.min_closure or (names == 1 and excess < CRITERIA.max_excess_at_floor)


def test_the_criteria_decide() -> None:
    strict = Criteria(min_closure=0.95, min_closure_at_floor=0.95)
    given = replace(GOOD, interval=(0.8, 0.93))
    assert [verdict(given), verdict(given, strict)] == [Outcome.ATTRIBUTED, Outcome.NONE]
