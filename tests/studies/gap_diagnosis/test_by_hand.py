"""A diagnosis that is not the first look at its records: its course, and what is said of names that came up later."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.look import Found
from diagnosis.experiments.looked import EarlierLooks
from diagnosis.verdict import Outcome
from studies.gap_diagnosis import by_hand
from studies.gap_diagnosis.by_hand import Before, course_of, require_growing
from studies.gap_diagnosis.course import confirmed
from studies.options import BadInputError

SHOWN = [{"name": f"{name}.csv", "samples": 4000, "sample_time_s": 5e-4} for name in ("one", "two", "three")]
SURE, UNSURE = np.log(1e3), np.log(3.0)


def verdict(outcome: str, *names: str) -> dict[str, Any]:
    return {"outcome": outcome, "effects": list(names), "partly": [], "equivalent": [], "next_experiment": ""}


def earlier(*names: str, course: dict[str, Any] | None = None) -> Before:
    """One look at the first record, which named these."""
    found = Found(Outcome.ATTRIBUTED if names else Outcome.NOTHING, names, (), {})
    return Before(EarlierLooks((1,), (found,), (EProcess(),), SimpleNamespace()), course)  # type: ignore[arg-type]


@pytest.fixture
def e_value(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets the e-process that the last records give."""

    def prepared(whole: float, **each: float) -> None:
        monkeypatch.setattr(by_hand, "with_last", lambda looks, _: (*looks.processes, EProcess(whole, each)))

    return prepared


def test_a_name_of_the_first_look_stands_and_one_that_comes_up_later_is_unconfirmed(e_value: Any) -> None:
    e_value(UNSURE, play=UNSURE)
    now = verdict("attributed", "cogging", "play")
    course = course_of(earlier("cogging"), None, now, SHOWN)  # type: ignore[arg-type]
    assert course["effects"] == ["cogging"]
    assert [(one["asked"], one["seconds"]) for one in course["looks"]] == [
        ("one.csv", 2.0),
        ("two.csv and three.csv", 4.0),
    ]
    assert [one["after"]["names"] for one in course["looks"]] == [["cogging"], ["cogging", "play"]]
    told = confirmed(now, course)
    assert (told["outcome"], told["effects"]) == (
        "attributed",
        ["cogging", "play"],
    )  # by hand, names are not taken away
    assert (told["confirmed"], told["unconfirmed"]) == (False, ["play"])
    assert course["reason"] == (
        "e-values (50 confirm a name): cogging 1, named from the first look on; play 3, not confirmed yet"
    )


def test_a_name_that_later_records_confirm_stands(e_value: Any) -> None:
    e_value(SURE, play=SURE)
    now = verdict("attributed", "play")
    course = course_of(earlier(), None, now, SHOWN)  # type: ignore[arg-type]
    assert confirmed(now, course)["unconfirmed"] == []
    assert course["reason"].endswith("play 1e+03, confirmed by a record that did not choose it")


def test_of_several_that_are_alike_it_is_enough_that_something_is_there(e_value: Any) -> None:
    now = verdict("ambiguous", "play")
    for whole, unsure in ((SURE, []), (UNSURE, ["play"])):
        e_value(whole, cogging=SURE)
        course = course_of(earlier(), None, now, SHOWN)  # type: ignore[arg-type]
        assert confirmed(now, course)["unconfirmed"] == unsure


def test_it_goes_on_from_a_machine_that_was_asked(e_value: Any) -> None:
    """Whose names were sure, and whose first look gave none."""
    e_value(UNSURE, play=UNSURE)
    row = {"asked": "own test", "seconds": 8.0, "log10_e_value": 2.0, "log10_e_values": {"cogging": 2.0}}
    asked = {"effects": ["cogging"], "looks": [row]}
    assert by_hand._reached(asked).of("cogging") == pytest.approx(np.log(100))
    now = verdict("attributed", "cogging", "stribeck")
    course = course_of(earlier("stribeck", course=asked), None, now, SHOWN)  # type: ignore[arg-type]
    assert course["looks"][0] == row
    assert [one["asked"] for one in course["looks"]] == ["own test", "two.csv and three.csv"]
    assert confirmed(now, course)["unconfirmed"] == ["stribeck"]


def test_nothing_named_needs_no_confirmation(e_value: Any) -> None:
    e_value(UNSURE)
    now = verdict("none_of_these")
    course = course_of(earlier("cogging"), None, now, SHOWN)  # type: ignore[arg-type]
    assert confirmed(now, course) == now
    assert course["reason"] == "no effect is named"


@pytest.mark.parametrize("counts", [(3,), (2, 1), (1, 1), (4,)])
def test_looks_are_at_fewer_records_than_there_are(counts: tuple[int, ...]) -> None:
    require_growing((1, 2), 3)
    with pytest.raises(BadInputError, match=r"^--looked .* of 3 records; give growing numbers below that$"):
        require_growing(counts, 3)
