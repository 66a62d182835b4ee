"""What is said where what is left of the records has no name."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from studies.gap_diagnosis import values_off
from studies.gap_diagnosis.answer import sentences


def test_values_that_are_most_of_the_gap_come_before_what_has_no_name(results: dict[str, Any]) -> None:
    """A rotary table, 5 % lighter than its file says: the re-fit leaves 2 mN m of 231, and the floor is 1.8."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    gaps = {
        name: {**results["how_far"][name], "force_N": force}
        for name, force in (("gap_as_delivered", 0.231), ("gap_refitted", 0.002), ("floor", 0.0018))
    }
    shifts = [{**row, "moved": 0.1, "beside": None} for row in results["shifts"]]
    mass, contacts = ({**row, "std": [0.015]} for row in shifts[:2])
    mass |= {"name": "payload_mass", "moved": -3.25, "unit": "1", "values": 1, "in_all": None}
    contacts |= {"name": "presliding_stiffness", "moved": 6.0, "unit": "1", "values": 18, "in_all": -0.01}
    far = {**results["how_far"], **gaps, "adopted_file": "re-fitted"}
    given = {**results, "verdict": verdict, "how_far": far, "shifts": [mass, contacts]}
    told = sentences(given)
    assert told["which"].startswith(
        "Nominal values are off, payload mass by -4.8 %; re-fitted, they reduce the unknown force from 0.231 N to "
        "0.002 N, beside a noise floor of 0.0018 N. No effect of the catalogue, alone or with others, explains what is "
        "left within its prior range"
    )
    assert told["outcome"] == "Nominal values are off: payload mass; what is left has no name"
    lag = {"effect": "current_loop_lag", "name": "time", "unit": "s", "before": 1e-3, "now": 2.205e-3, "std": 1e-6}
    stated = sentences({**given, "shifts": [], "stated_effects": [lag]})
    assert stated["which"].startswith("Nominal values are off, current loop lag (time 2.205 ms in place of 1 ms); re-")
    assert "have other values" not in stated["which"], "said once"
    assert stated["outcome"] == "Nominal values are off: current loop lag; what is left has no name"
    gaps["gap_refitted"] = {**gaps["gap_refitted"], "force_N": 0.06}
    less = sentences({**given, "how_far": {**far, **gaps}})
    assert less["which"].startswith("No effect of the catalogue")
    assert less["outcome"] == "No effect of the catalogue explains it"


def test_what_only_repeated_motions_would_show_is_said_where_nothing_has_a_name(results: dict[str, Any]) -> None:
    """Of one command in thirty that came late, the first page had said that its cause is not in the catalogue."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    limits = [{**row, "limit": None if row["effect"] == "timing_jitter" else 1.0} for row in limits_of(results)]
    whole = {**results, "verdict": verdict, "confusability": {**results["confusability"], "limits": limits}}
    said = ", or is timing jitter, which equal motions that are repeated would show"
    assert said in sentences(whole)["which"]
    (logged,) = (row for row in limits if row["effect"] == "timing_jitter")
    logged["limit"] = 0.01
    assert said not in sentences(whole)["which"]
    logged["limit"] = None
    whole["where"] = copy.deepcopy(results["where"])
    whole["where"]["details"]["controller"][0] |= {"every": 3}
    assert said not in sentences(whole)["which"]


def test_values_at_the_end_of_their_range_may_be_the_cause_of_what_has_no_name(results: dict[str, Any]) -> None:
    """A worm gear's first file had five assumed contacts: what they left had a cause that "is not in the catalogue"."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    ends = [{"name": "presliding_limit", "part": "nominal", "value": 1e-5, "bound": 1e-5, "unit": "m"}] * 2
    whole = {**results, "verdict": verdict, "how_far": {**results["how_far"], "at_bounds": ends}}
    said = ", or is a value of the file that is farther off than its range goes (presliding limit)"
    assert said in sentences(whole)["which"]
    inside = {
        **whole,
        "how_far": {**results["how_far"], "at_bounds": [{**ends[0], "part": "cogging", "name": "pitch"}]},
    }
    assert said[:20] not in sentences(inside)["which"]


def test_a_simulation_that_swings_by_itself_has_no_noise_floor(results: dict[str, Any]) -> None:
    """On a rack whose mode moves the scale against the thrust, simulated records scattered by 22 N, where the axis did
    by 0.6 N: what was left was "no more than the noise floor"."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    far = {**results["how_far"], "gap_refitted": results["how_far"]["floor"], "floor_source": "simulated"}
    whole = {**results, "verdict": verdict, "how_far": far, "learned": None}
    told = sentences(whole)
    assert "no more than the noise floor" in told["which"] + told["outcome"]
    assert "no noise floor" not in told["how_far"]
    least = {"force_N": 0.5 * far["floor"]["force_N"], "position_m": far["floor"]["position_m"]}
    swings = {**whole, "how_far": {**far, "gap_as_delivered": {**far["gap_as_delivered"], **least}}}
    for other in ({**whole, "sticking": {"state": "the model's loop is unstable"}}, swings):
        told = sentences(other)
        assert "no more than the noise floor" not in told["which"] + told["outcome"]
    assert "so that this is no noise floor" in told["how_far"]


def test_noise_that_is_all_that_is_left_is_no_cause_out_of_the_catalogue(results: dict[str, Any]) -> None:
    """A healthy stage whose thrust scatters by 10 mN: its first page had asked for its friction and its clock."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    force = {
        "usual": 0.0022,
        "taken": 0.0022,
        "by_record": [0.0022],
        "interpolated": False,
        "biased": [],
        "may_be_noise": False,
    }
    far = {**results["how_far"], "drive_rms_N": 1.2}
    whole = {**results, "verdict": verdict, "white_force_N": {**force, "alone": [0.0091, 0.0098]}, "how_far": far}
    told = sentences(whole)
    assert "a force that scatters by 0.0098 N from sample to sample would leave, 0.82 % of the drive's" in told["which"]
    assert "not in the catalogue" not in told["which"]
    assert told["outcome"].endswith("is left is noise of 0.0098 N")
    other = {**whole, "white_force_N": {**force, "alone": None}}
    assert "not in the catalogue" in sentences(other)["which"]


@pytest.mark.parametrize("may_be_noise", [True, False])
def test_what_comes_in_places_is_no_noise_of_the_drive(results: dict[str, Any], may_be_noise: bool) -> None:
    """Of a cable chain the page had said that the drive scatters by 0.2 N; it does by 0.01 N."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    force = {
        "usual": 0.0022,
        "taken": 0.2,
        "by_record": [0.2],
        "interpolated": False,
        "biased": [],
        "may_be_noise": may_be_noise,
        "alone": None,
    }
    told = sentences({**results, "verdict": verdict, "white_force_N": force})["which"]
    assert ("The drive is rougher than its model" in told) == may_be_noise
    assert ("is no such noise, as it is not alike at all times" in told) != may_be_noise


def test_what_interpolation_leaves_is_not_said_of_the_drive(results: dict[str, Any]) -> None:
    """A cascade at 2 kHz, logged at 1 kHz: its drive is as smooth as its model."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    force = {
        "usual": 1.0,
        "taken": 6.4,
        "by_record": [6.4, 1.0, 5.0, 6.0],
        "interpolated": True,
        "log_has_one_of": [2, 2, 4, 2],
        "biased": [],
        "may_be_noise": False,
        "alone": None,
    }
    told = sentences({**results, "verdict": verdict, "white_force_N": force})["which"]
    assert (
        "Records 1 and 4 have one of 2 and record 3 has one of 4 samples of the controller, and the commands between"
        in told
    )
    assert "a force that scatters by 6.4 N from sample to sample, and hides what is smaller" in told
    assert "The drive is rougher" not in told
    assert "no such noise" not in told
    none = {**force, "taken": 1.0, "by_record": [1.0] * 4}  # as an effect that was found may leave it
    assert "interpolated" not in sentences({**results, "verdict": verdict, "white_force_N": none})["which"]


def limits_of(results: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows of the detection limits, late commands among them."""
    rows = [row for row in results["confusability"]["limits"] if row["effect"] != "timing_jitter"]
    return [*rows, {"effect": "timing_jitter", "limit": None, "parameter": "part", "unit": "1", "typical": 0.02}]


def test_what_hardly_exceeds_the_floor_may_be_noise(results: dict[str, Any]) -> None:
    """A healthy die bonder's axis, its thrust a little noisier than its file's: 0.0179 N of 32 N had a cause that "is
    not in the catalogue"."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}

    def told(force: float, position: float, **other: Any) -> dict[str, str]:
        gaps = {
            "gap_refitted": {**results["how_far"]["gap_refitted"], "force_N": force, "position_m": position},
            "floor": {**results["how_far"]["floor"], "force_N": 0.016, "position_m": 21e-9},
        }
        far = {**results["how_far"], **gaps, "floor_source": "simulated", **other}
        return sentences({**results, "verdict": verdict, "how_far": far, "shifts": []})

    noisy = told(0.0179, 26.3e-9)
    said = (
        "it is 25 % above the noise floor, and may be noise of the drive or the scale that the machine file has smaller"
    )
    assert said in noisy["which"]
    assert noisy["outcome"] == "What is left is 25 % above the noise floor, and has no name"
    assert "What is left is 4 % above" in told(0.01664, 20e-9)["outcome"]
    for even in (told(0.0159, 20e-9), told(0.01608, 21e-9)):
        assert even["outcome"] == "What is left is no more than the noise floor, and has no name"
    for other in (told(0.05, 26.3e-9), told(0.0179, 90e-9), told(0.0179, 26.3e-9, floor_source="repeats")):
        assert "may be noise of the drive" not in other["which"]
        assert "the cause is not in the catalogue" in other["which"]


def test_values_that_a_re_fit_bends_to_a_missing_effect_are_not_off(results: dict[str, Any]) -> None:
    """Of a loose tool, named, the page had said that a mode's gain is off by 35 % and the dead time by -40 us; beside
    the effect neither was."""
    gaps = {
        name: {**results["how_far"][name], "force_N": force}
        for name, force in (("gap_as_delivered", 8.3), ("gap_refitted", 0.2), ("floor", 0.02))
    }
    far = {**results["how_far"], **gaps}
    row = {**results["shifts"][0], "name": "dead_time", "unit": "s", "std": [5e-6], "values": 1}
    row |= {"moved": -8.0, "beside": -0.4, "in_all": None, "in_all_beside": None}
    assert "Nominal values are off" not in sentences({**results, "how_far": far, "shifts": [row]})["which"]
    alone = sentences({**results, "how_far": far, "shifts": [{**row, "beside": None}]})["which"]
    assert "Nominal values are off, dead time by -40 µs; re-fitted, they reduce the unknown force from 8.3 N" in alone
    both = sentences({**results, "how_far": far, "shifts": [{**row, "beside": -8.4}]})["which"]
    assert "Nominal values are off, too, dead time by -42 µs." in both


def test_the_friction_level_is_the_force_of_all_contacts() -> None:
    """Stiffer contacts that slip sooner were a level 15 % higher on an axis whose friction was as stated."""
    row = {"name": "friction_level", "moved": 1.5, "std": [0.1], "unit": "1", "values": 1, "in_all": 0.002}
    assert values_off.off_by(row) == "friction level by 0.2 %"
    assert not values_off._is_off(row)
    contacts = {"name": "presliding_stiffness", "moved": 1.9, "std": [0.1], "unit": "1", "values": 7, "in_all": 0.27}
    assert values_off.off_by(contacts) == "presliding stiffness by 27 %"
    single = {**contacts, "in_all": -0.05}
    assert values_off.off_by(single) == "presliding stiffness by -5 % in all (single contacts by up to 21 %)"
