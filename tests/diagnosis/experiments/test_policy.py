"""What is run next and when it ends: pure functions of what experiments tell and of what was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.criteria import Criteria
from diagnosis.experiments import policy
from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.information import ExperimentInformation
from diagnosis.experiments.look import Found
from diagnosis.experiments.menu import Experiment
from diagnosis.experiments.policy import Knowledge, Stop
from diagnosis.experiments.schedules import Move, schedule
from diagnosis.verdict import Outcome
from models.machine import load

EFFECTS = ("cogging", "stribeck", "play")
NEEDED = Criteria().distinguishable
SURE = EProcess(10.0, dict.fromkeys(EFFECTS, 10.0))
NOTHING = Found(Outcome.NOTHING, (), (), {})
COGGING = Found(Outcome.ATTRIBUTED, ("cogging",), (), {"cogging": 500.0})
NONE = Found(Outcome.NONE, (), (), {"cogging": 500.0, "play": 100.0})


def one(name: str, seconds: float, distance: np.ndarray, information: float = 1.0) -> ExperimentInformation:
    planned = schedule(name, load(), [Move(1e-5, 0.1, 0.1)])
    return ExperimentInformation(Experiment(name, planned), seconds, distance, information * np.eye(2))


def apart(cogging: float, stribeck: float, play: float, alike: float = 1.0) -> np.ndarray:
    """Squared distances: of each effect alone, and of each pair this part of the row's."""
    rows: np.ndarray = np.array([cogging, stribeck, play])[:, None] * np.full((3, 3), alike)
    np.fill_diagonal(rows, (cogging, stribeck, play))
    return rows


def known(*found: Found, process: EProcess | None = None, seconds: float = 60.0, records: int = 5) -> Knowledge:
    menu = (
        one("own test", 2.0, apart(100.0, 1.0, 1.0, 0.01)),
        one("long strokes", 5.0, apart(1e4, 5.0, 1.0, 0.0)),
        one("speeds", 5.0, apart(400.0, 4000.0, 1.0, 0.5)),
        one("reversals", 5.0, apart(1.0, 1.0, 4000.0, 1.0), 50.0),
    )
    return Knowledge(EFFECTS, menu, (1, 0, 0, 0), found, process or EProcess(), seconds, records)


def chosen(state: Knowledge) -> list[str]:
    choice = policy.active(state)
    assert choice is not None
    return [state.experiments[i].experiment.words for i in choice.places]


def test_without_a_name_it_goes_where_most_becomes_visible_in_a_second() -> None:
    """The experiment that shows what the own test did not; one that shows nothing new comes last."""
    first = chosen(known(NOTHING, seconds=5.0, records=1))
    assert first in (["speeds"], ["reversals"])
    both = chosen(known(NOTHING, seconds=10.0, records=1))
    assert sorted(both) == ["reversals", "speeds"]


def test_time_counts() -> None:
    """Of two that tell the same, the shorter one."""
    state = known(NOTHING)
    slow = replace(state.experiments[3], seconds=12.0)
    state = replace(state, experiments=(*state.experiments[:3], slow, state.experiments[3]), runs=(1, 0, 0, 0, 0))
    choice = policy.active(state)
    assert choice is not None
    assert 4 in choice.places
    assert 3 not in choice.places


def test_a_name_is_confirmed_where_it_is_told_from_the_others() -> None:
    """Long strokes show cogging best, but cannot tell it from the others; the own test cannot either."""
    assert "speeds" in chosen(known(COGGING, seconds=5.0, records=1))


def test_alike_effects_are_told_apart() -> None:
    both = Found(Outcome.AMBIGUOUS, ("cogging", "stribeck"), (("cogging", "stribeck"),), {"cogging": 100.0})
    state = known(both, seconds=5.0, records=1)
    assert chosen(state) == ["speeds"]
    assert "cogging and stribeck apart" in policy.active(state).why  # type: ignore[union-attr]


def test_worth_is_that_of_the_information_and_falls_with_what_is_known() -> None:
    """A closed form: log(1 + D / needed) / 2 of one effect, and its increments."""
    state = known(NOTHING)
    more = np.diag([0.0, 0.0, 7 * NEEDED])
    value = policy.worth(state, more, policy.questions(state))
    have = state.distance[2, 2] / NEEDED
    assert value == pytest.approx(0.5 * np.log((1 + have + 7) / (1 + have)) / 3)
    again = replace(state, runs=(1, 0, 0, 2))
    assert policy.worth(again, more, policy.questions(again)) < value


def test_it_ends_with_a_name_only_if_confirmed_twice_sure_and_alone() -> None:
    done = replace(known(COGGING, COGGING, process=SURE), runs=(1, 0, 1, 0))
    assert policy.ending(done) == (Stop.NAMED, "cogging: confirmed by a record that did not choose it")
    assert policy.ending(replace(done, process=EProcess(3.0, {"cogging": 3.0}))) is None
    assert policy.ending(replace(done, found=(NOTHING, COGGING))) is None
    assert policy.ending(replace(done, found=(COGGING,))) is None
    other = replace(COGGING, names=("cogging", "play"))
    assert policy.ending(replace(done, found=(other, COGGING))) is None


def test_it_goes_on_while_another_effect_is_alike_that_could_be_told_apart() -> None:
    """And no longer where nothing that still fits would tell them apart."""
    early = known(COGGING, COGGING, process=SURE)
    assert set(policy.indistinguishable(early)["cogging"]) == {"stribeck", "play"}
    assert policy.ending(early) is None
    assert policy.ending(replace(early, seconds=1.0)) is not None


def test_what_earlier_records_told_counts_towards_the_size_that_was_found() -> None:
    """A gain of 500 that was found in a record which shows cogging by 2000 is a small one: that it was taken for 25
    times the usual size had ended it, as if what tells a pair by 3 at the usual size told them apart."""
    menu = (one("own test", 1.0, apart(20.0, 20.0, 20.0, 3 / 20)), one("speeds", 1.0, apart(200.0, 200.0, 200.0)))
    state = Knowledge(EFFECTS, menu, (1, 0), (COGGING, COGGING), SURE, 10.0, 5)
    assert policy.questions(state)[1][0] == pytest.approx(500 / 20)
    assert policy.ending(state) is not None
    state = replace(state, had=apart(2000.0, 2000.0, 2000.0, 3 / 2000))
    assert policy.questions(state)[1][0] == pytest.approx(500 / 2020)
    assert set(policy.indistinguishable(state)["cogging"]) == {"stribeck", "play"}
    assert policy.ending(state) is None
    assert policy.hidden(state) == ()


def test_nothing_of_these_is_said_after_three_looks() -> None:
    assert policy.ending(known(NONE, NONE)) is None
    assert policy.ending(known(NONE, NONE, NONE))[0] is Stop.NONE  # type: ignore[index]
    assert policy.ending(known(NONE, NOTHING, NONE)) is None


@pytest.mark.parametrize(
    ("found", "process", "stop", "said"),
    [
        (NOTHING, EProcess(), Stop.NOTHING, "spent"),
        (Found(Outcome.PARAMETERS, (), (), {}), EProcess(), Stop.PARAMETERS, "spent"),
        (NONE, EProcess(), Stop.NONE, "spent"),
        (COGGING, SURE, Stop.NAMED, "spent"),
        (COGGING, EProcess(1.0, {"cogging": 1.0}), Stop.CANNOT_TELL, "cogging has an e-value of 2.7, 50 needed"),
        (COGGING, EProcess(10.0, {}), Stop.CANNOT_TELL, "e-value of 1, 50 needed"),
    ],
)
def test_when_time_is_spent_only_sure_names_are_given(found: Found, process: EProcess, stop: Stop, said: str) -> None:
    ended, why = policy.ending_when_spent(known(found, process=process))
    assert ended is stop
    assert said in why


def test_a_record_takes_its_share_of_the_time_and_no_more() -> None:
    for choose in (policy.active, policy.in_turn, policy.at_random(3), policy.d_optimal):
        for seconds, records in ((60.0, 5), (12.0, 1), (5.5, 2), (2.5, 2)):
            state = known(NOTHING, seconds=seconds, records=records)
            choice = choose(state)
            if choice is not None:
                taken = sum(state.experiments[i].seconds for i in choice.places)
                assert taken <= max(seconds / records, 2.0) + 1e-9
                assert taken <= seconds


def test_the_other_policies_do_as_they_say() -> None:
    state = known(NOTHING, seconds=12.0, records=1)
    turn = policy.in_turn(state)
    assert turn is not None
    assert turn.places[:2] == (1, 2)  # the own test was run already
    best = policy.d_optimal(state)
    assert best is not None
    assert best.places[0] == 3
    drawn = {(policy.at_random(seed)(state) or policy.Choice((), "")).places for seed in range(20)}
    assert len(drawn) > 3


def test_what_no_record_could_show_is_listed() -> None:
    assert policy.hidden(known(NOTHING)) == ("stribeck", "play")


def test_where_limits_leave_no_experiment_nothing_is_shown_and_nothing_asked() -> None:
    left = replace(known(COGGING), experiments=(), runs=())
    assert policy.hidden(left) == EFFECTS
    weight, _ = policy.questions(left)
    assert weight.shape == (3, 3)


def test_what_the_machine_did_not_run_is_asked_no_more_and_what_was_seen_of_it_stays_known() -> None:
    state = replace(known(NOTHING), barred=frozenset({0, 2}))
    assert policy.hidden(state) == policy.hidden(known(NOTHING))
    assert set(chosen(state)) == {"long strokes", "reversals"}
    for choose in (policy.in_turn, policy.at_random(1), policy.d_optimal):
        choice = choose(state)
        assert choice is not None
        assert not state.barred.intersection(choice.places)
    assert policy.active(replace(state, barred=frozenset(range(4)))) is None


def test_the_callers_criteria_decide_what_counts_as_shown() -> None:
    state = known(NOTHING)
    strict = replace(state, criteria=replace(Criteria(), distinguishable=2 * float(state.distance[0, 0])))
    assert policy.hidden(strict) == EFFECTS
