"""What is said first: the values that take most of the gap, whatever their tolerances, and then what has a name."""

from __future__ import annotations

from typing import Any

import pytest

from studies.gap_diagnosis.answer import front, sentences

MASS = {
    "name": "payload_mass",
    "share": 0.9912,
    "kinds": ["payload_mass"],
    "numbers": [{"name": "", "unit": "kg", "before": 22.0, "now": 22.44}],
}


def given(results: dict[str, Any], **verdict: Any) -> dict[str, Any]:
    """A vertical axis with 2 % more mass, whose names take the rest of 1 % off."""
    forces = {"gap_as_delivered": 0.067, "gap_refitted": 0.0144, "gap_after": 0.0135, "floor": 0.0126}
    far = {**results["how_far"], **{name: {**results["how_far"][name], "force_N": n} for name, n in forces.items()}}
    rows = {row["name"]: {**row, "moved": 0.1, "beside": 0.1, "in_all": None} for row in results["shifts"]}
    shifts = list(rows.values())
    return {
        **results,
        "how_far": far,
        "shifts": shifts,
        "moved_most": [MASS],
        "verdict": {**results["verdict"], "outcome": "attributed", "effects": ["cogging"], **verdict},
    }


def test_the_value_that_takes_the_gap_comes_before_the_name_that_takes_the_rest(results: dict[str, Any]) -> None:
    """The headline had named what closes 1 % of the gap, and nothing had said that the mass had changed."""
    told = sentences(given(results))
    assert told["which"].startswith(
        "Nominal values are off, payload mass (22.44 kg in place of 22 kg; 99 % of the gap); re-fitted, they reduce "
        "the unknown force from 0.067 N to 0.0144 N, beside a noise floor of 0.0126 N. Besides these, it is cogging"
    )
    assert told["outcome"] == "Nominal values are off: payload mass; besides, attributed to cogging"
    first = front(given(results))["which"]
    assert isinstance(first, str)
    assert told["which"].startswith(first)
    assert "Besides these, it is cogging" in first
    either = sentences(given(results, outcome="ambiguous", equivalent=[["cogging", "cable_spring"]]))
    assert "Besides these, it is cogging" in either["which"]
    assert either["outcome"] == "Nominal values are off: payload mass; besides, either cogging or cable spring"


@pytest.mark.parametrize("outcome", ["none_of_these", "parameters"])
def test_it_comes_first_where_nothing_has_a_name(outcome: str, results: dict[str, Any]) -> None:
    verdict = {"outcome": outcome, "effects": ["dead_time"] if outcome == "parameters" else [], "partly": []}
    told = sentences(given(results, **verdict))
    assert told["which"].startswith("Nominal values are off, payload mass (22.44 kg in place of 22 kg; 99 % of the ")
    assert told["which"].count("22.44 kg") == 1
    assert told["outcome"].startswith("Nominal values are off: payload mass")


def test_it_comes_before_a_name_that_no_record_confirmed(results: dict[str, Any]) -> None:
    verdict = {"outcome": "none_of_these", "effects": [], "partly": ["cogging"], "confirmed": False}
    told = sentences({**given(results, **verdict), "asked": {"reason": "no record left"}})
    assert told["which"].startswith("Nominal values are off, payload mass (22.44 kg in place of 22 kg; ")
    assert "beside a noise floor of 0.0126 N. It looks like cogging, but" in told["which"]
    assert told["which"].count("22.44 kg") == 1
    assert told["outcome"] == "Nominal values are off: payload mass; besides, no name is sure; it looks like cogging"


def test_names_that_take_most_of_the_gap_come_first(results: dict[str, Any]) -> None:
    whole = given(results)
    far = {**whole["how_far"], "gap_refitted": {**whole["how_far"]["gap_refitted"], "force_N": 0.04}}
    for other in ({"how_far": far}, {"moved_most": [{**MASS, "share": 0.6}]}):
        assert sentences({**whole, **other})["which"].startswith("It is cogging")
    details = dict(results["where"]["details"])
    details["controller"] = [{**one, "replays": False, "would_fit": None} for one in details["controller"]]
    wrong = {**results["where"], "details": details}
    catalogue = {**results["catalogue"], "cogging": {**results["catalogue"]["cogging"], "shown_in": "log"}}
    broken = sentences({**whole, "where": wrong, "catalogue": catalogue})
    assert broken["outcome"] == "Attributed to cogging"  # by which everything else is judged


def traded(results: dict[str, Any], delay: float) -> dict[str, Any]:
    """The same with a dead time that is 63 us longer, and a delay in all that is longer by so much [s]."""
    whole = given(results)
    dead = {"name": "dead_time", "std": [1e-5, 1e-5], "unit": "s", "moved": 6.3, "beside": 6.3, "values": 1}
    dead |= {"in_all": None, "in_all_beside": None, "delay": delay, "delay_beside": delay}
    return {**whole, "shifts": [row for row in whole["shifts"] if row["name"] != "dead_time"] + [dead]}


def test_a_dead_time_that_a_lag_makes_up_for_is_not_off(results: dict[str, Any]) -> None:
    """It had been told as off by 63 us, where the sum with the lag had moved by 13."""
    assert "Nominal values are off, too, dead time by 63 µs." in sentences(traded(results, 63e-6))["which"]
    whole = traded(results, -14e-6)
    delay = {"total_s": 1.4672e-3, "std_s": 3.8e-7, "delivered_s": 1.4807e-3}
    told = sentences({**whole, "verdict": {**whole["verdict"], "input_delay": delay}})["which"]
    assert "dead time by" not in told
    assert "1.48070 ms (dead time and lag moved against each other, by 63 µs and -77 µs)." in told
    assert "off, too, input delay by -25 µs in all." in sentences(traded(results, -25e-6))["which"]
    only = {**traded(results, -25e-6), "moved_most": []}
    only["verdict"] = {**only["verdict"], "outcome": "parameters", "effects": ["dead_time"]}
    alone = sentences(only)
    assert alone["which"].startswith("Nominal values are off, input delay by -25 µs in all; ")
    assert alone["outcome"] == "Nominal values are off: input delay"


def test_a_number_has_as_many_digits_as_tell_it_from_what_it_was(results: dict[str, Any]) -> None:
    number = {"name": "frequency", "unit": "Hz", "before": 209.751, "now": 209.759}
    mode = {"name": "vibration_mode_3", "share": 1.0, "kinds": ["mode_frequency"]}
    told = sentences({**given(results), "moved_most": [{**mode, "numbers": [number]}]})["which"]
    assert "vibration mode 3 (frequency 209.76 Hz in place of 209.75 Hz; 100 % of the gap)" in told
