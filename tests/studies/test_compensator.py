"""Studies of a machine whose file leaves the number of compensator elements open: what they choose, write and say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from design.controller import default_controller
from design.element_count import Choice, Trial
from models.controller import load as load_controller
from models.machine import Machine, load, to_json
from models.machine_file import to_toml
from studies.catalogue import STUDIES
from studies.command import DONE, main, plain
from studies.compensator import _line, with_elements
from studies.deadbeat_design.__main__ import STUDY
from studies.deadbeat_design.report import tell
from studies.identify_machine.own_records import motions
from studies.options import BadInputError, Options
from studies.study import Answer, Progress
from tests.design.rolling_axis import rolling_axis

ELEMENTS = 20  # of the machine's friction; simulations take longer with more


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a quick run on the axis wrote."""
    output = tmp_path_factory.mktemp("axis")
    file = output / "axis.toml"
    file.write_text(to_toml(rolling_axis(count=ELEMENTS)), encoding="utf-8")
    assert main(STUDY, ["--quick", "--machine", str(file), "--output", str(output / "out")]) == DONE
    return output / "out"


@pytest.fixture(scope="module")
def whole(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    return content


def test_results_hold_the_chosen_number_and_the_curve(whole: dict[str, Any]) -> None:
    counts, in_time = whole["results"]["compensator_elements"], whole["machine"]["specification"]["settling_time_s"]
    assert (counts["meets"], counts["largest"]) == (True, ELEMENTS)
    assert 1 < counts["chosen"] < ELEMENTS
    numbers = [one["elements"] for one in counts["curve"]]
    assert numbers == sorted({*range(1, counts["chosen"] + 4), ELEMENTS})
    for one in counts["curve"]:
        assert one["meets"] == (one["settling_s"] <= in_time)
    chosen = counts["curve"][counts["chosen"] - 1]
    assert chosen["settling_s"] == max(motion["settling_s"] for motion in whole["results"]["with"]["motions"])
    assert chosen["dispersion_m"] == whole["results"]["with"]["worst_dispersion_m"]


def test_the_controller_says_the_number_and_is_that_of_a_file_that_states_it(
    folder: Path, whole: dict[str, Any]
) -> None:
    number = whole["results"]["compensator_elements"]["chosen"]
    file = folder / "controller.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["compensator_elements"] == number == len(content["friction_compensation"]["limit_m"])
    assert load_controller(file) == default_controller(load(folder / "machine.toml"))
    stated = STUDIES.deadbeat_design(rolling_axis(number, count=ELEMENTS), quick=True)
    del content["compensator_elements"]
    assert json.loads(json.dumps(stated.files["controller.json"])) == content
    assert "compensator_elements" not in stated.results


def test_the_report_shows_the_curve_where_the_study_chose_and_only_there(folder: Path, whole: dict[str, Any]) -> None:
    assert (folder / "figures" / "elements.svg").exists()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "The number of the compensator" in page
    assert "the fewest with which" in page
    stated = {name: one for name, one in whole["results"].items() if name != "compensator_elements"}
    names = [figure.name for figure in tell({**whole, "results": stated}).figures]
    assert [one.name for one in tell(whole).figures if one.name not in names] == ["elements"]


def test_where_no_number_meets_the_checks_say_what_is_missed() -> None:
    machine = rolling_axis(count=4, tolerance=20e-9, in_time=7.5e-3)
    answer = STUDIES.deadbeat_design(machine, quick=True)
    counts = answer.results["compensator_elements"]
    assert not counts["meets"]
    assert [one["elements"] for one in counts["curve"]] == [1, 2, 3, 4]
    assert "settling with compensation, all motions" in [one.name for one in answer.checks if not one.holds]
    row = dict(answer.summary)["friction compensator, none of 1 to 4 elements meets; the best"]
    assert row.startswith(f"{counts['chosen']} (settling by elements: 1: never, ")
    figure = next(one for one in tell(_told(machine, answer)).figures if one.name == "elements")
    above = figure.draw(_told(machine, answer)).axes[0]
    legend = above.get_legend()
    assert legend is not None
    assert "never settles" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize(("periodic", "why"), [(True, ""), (False, ", whose periods differ")])
def test_where_the_best_number_settles_in_time_it_is_said_what_it_misses(periodic: bool, why: str) -> None:
    """121.5 ms of 200 beside "none of 1 to 5 elements meets" was a riddle."""
    trials = (Trial(1, 0.2, 1e-6, 1.0, True, False, False), Trial(2, 0.1215, 1e-6, 1.0, periodic, False, False))
    assert _line(Choice(2, 2, trials))[0] == f"friction compensator, none of 1 to 2 elements meets; the best{why}"


def _told(machine: Machine, answer: Answer) -> dict[str, Any]:
    content: dict[str, Any] = plain({"machine": to_json(machine), "results": answer.results})
    return content


def test_a_stated_number_is_kept_and_says_nothing() -> None:
    machine = rolling_axis(7, count=ELEMENTS)
    found = with_elements(machine, Options(), Progress())
    assert found.machine is machine
    assert (found.choice, found.results, found.summary) == (None, {}, ())


def test_a_search_beyond_the_time_limit_is_refused_before_it_begins() -> None:
    machine = rolling_axis(count=ELEMENTS)
    with pytest.raises(BadInputError, match=r"most of the time for the number of compensator elements, more than"):
        with_elements(machine, Options(time_limit=1e-6), Progress())


def test_what_needs_no_compensation_searches_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a search where nothing is compensated")

    monkeypatch.setattr("design.controller.choose", refuse)
    table = load()
    left_open = replace(table, control=replace(table.control, compensator_elements="auto"))
    assert motions(left_open, 0).position.size == motions(table, 0).position.size
