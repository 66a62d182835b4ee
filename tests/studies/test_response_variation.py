"""The paper's evidence: its numbers on the default table, the set that meets them, and the search that finds it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from design.controller import default_controller
from design.validation import validate
from models.ensemble import load_ensemble
from models.machine import DEFAULT, Machine, load
from reports import text
from studies.command import BAD_INPUT, CHECK_MISSED, main
from studies.response_variation import alternatives
from studies.response_variation import search as searching
from studies.response_variation.__main__ import STUDY
from studies.response_variation.report import tell
from studies.response_variation.search import HIGH, LARGEST_MS, LOW, TOLERANCE, largest_sensitivity, table
from studies.response_variation.tables import COORDINATES, coordinates

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def folder(quick_run: Callable[[str], tuple[Path, int]]) -> Path:
    """What one quick run wrote."""
    output, status = quick_run("response_variation")
    assert status == CHECK_MISSED
    checks = json.loads((output / "results.json").read_text(encoding="utf-8"))["checks"]
    # Two tables of 60 exceed it by up to 0.1 %, between the frequencies at which the search looked.
    missed = ["largest Ms of a member", "3 sigma with compensation: difference to the paper"]
    assert [check["name"] for check in checks if not check["holds"]] == missed
    return output


def results(folder: Path) -> Any:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def test_every_published_outcome_is_met_within_three_per_cent(folder: Path) -> None:
    whole = results(folder)
    outcomes = {row["name"]: row for row in whole["results"]["paper"] if row["outcome"]}
    assert len(outcomes) == 9
    for row in outcomes.values():
        assert abs(row["here"] / row["paper"] - 1) <= 0.03, row["name"]


@pytest.mark.parametrize("holds", [True, False])
def test_the_first_page_concludes_what_its_checks_say(holds: bool, folder: Path) -> None:
    whole = results(folder)
    history, dispersion = (
        next(check for check in whole["checks"] if check["name"].startswith(name))
        for name in ("share of the reversal's delay", "3 sigma with compensation")
    )
    history |= {"holds": holds, "value": 0.95 if holds else 0.4}
    dispersion["holds"] = not holds
    report = tell(whole)
    page = text.fill(report.template, whole, {one.name: one.caption for one in report.figures}, report.filters)
    assert ("so the friction's history causes the variation." in page) == holds
    assert ("delay 40 % are due to the friction's history" in page) != holds
    assert ("The model does *not* reproduce\nthe dispersion" in page) == holds
    assert ("The model reproduces\nthe dispersion" in page) != holds


def test_the_history_makes_the_variation(folder: Path) -> None:
    """Exchange the friction's history between reversal and inching, and the responses are exchanged."""
    mechanism = results(folder)["results"]["mechanism"]["central"]
    assert mechanism["reversal_settling_s"] > mechanism["inching_settling_s"] + 0.02
    assert mechanism["reversal_with_inching_history_s"] == pytest.approx(mechanism["inching_settling_s"], abs=2e-3)
    assert mechanism["inching_with_reversal_history_s"] == pytest.approx(mechanism["reversal_settling_s"], abs=2e-3)
    assert mechanism["slope_reversal_N_per_m"] > 4 * mechanism["slope_inching_N_per_m"]
    assert np.all(np.diff(mechanism["steady_friction_N"]) > 0)


def test_the_model_leaves_a_gap_and_says_how_large(folder: Path) -> None:
    gap = results(folder)["results"]["gap"]
    assert gap["central"]["dispersion_m"] < 2.4e-6
    median = gap["dispersion_quantiles_m"][2]
    assert gap["unexplained_m"] ** 2 + median**2 == pytest.approx(2.4e-6**2)


def test_what_was_chosen_is_said_and_varied(folder: Path) -> None:
    """x_T* as the paper leaves it open: the chosen one goes back and takes most of the thrust, others less."""
    found = results(folder)["results"]["conventions"]
    by = {one["objective"]: one for one in found["feedforwards"]}
    assert by["thrust_difference"]["back_m"] == pytest.approx(9.5e-6, abs=0.1e-6)
    assert by["thrust_difference"]["peak_N"] == pytest.approx(120, abs=1)
    assert by["peak_thrust"]["peak_N"] < 100
    assert by["thrust_difference"]["fit"] == by["thrust_difference"]["tables"]
    assert by["thrust_difference"]["fit_one_less"] == 0
    assert found["divisor_ratio"] == pytest.approx(np.sqrt(5 / 4))
    searched = {(one["objective"], one["monotone"], one["one_less"]): one["tables"] for one in found["sets"]}
    assert set(searched) == {(one.objective, one.monotone, one.one_less) for one in alternatives.SEARCHED}
    empty = [("thrust_difference", True, False), ("mode_robustness", False, False)]
    assert [key for key, tables in searched.items() if tables == 0] == empty
    assert found["largest_difference"] <= TOLERANCE
    own = {one["name"]: one for one in results(folder)["results"]["set"]["parameters"]}
    for one in found["parameters"]:
        assert one["share"] > 0.5 * own[one["name"]]["share"], one["name"]


def test_kept_tables_of_other_conventions_are_written_as_they_are_read() -> None:
    kept = alternatives.kept(alternatives.CONVENTIONS_FILE.read_text(encoding="utf-8"))
    assert len({convention for convention, _ in kept}) == len(kept)
    text = "".join(alternatives.to_text(convention, list(points)) for convention, points in kept)
    for (one, points), (same, again) in zip(kept, alternatives.kept(text), strict=True):
        assert one == same
        np.testing.assert_allclose(again, points, atol=1e-9)


@pytest.mark.parametrize("index", [0, 13, 29, 44, 59])
def test_members_of_the_kept_set_meet_the_published_outcomes(index: int) -> None:
    member = load_ensemble()[index]
    outcome = validate(member, default_controller(member).without_compensation())
    reversal = outcome.reversal.settling_time
    assert reversal == pytest.approx(52e-3, rel=TOLERANCE)
    assert outcome.worst_dispersion == pytest.approx(4.8e-6, rel=TOLERANCE)
    assert largest_sensitivity(member) <= LARGEST_MS
    assert outcome.peak_thrust <= 150


def test_a_table_has_the_parameters_that_it_was_made_from() -> None:
    theta = LOW + 0.4 * (HIGH - LOW)
    said = dict(zip((one.name for one in searching.RANGES), np.exp(theta), strict=True))
    found = dict(zip((one.name for one in COORDINATES), coordinates(table(load(), theta)), strict=True))
    for name in set(said) & set(found):
        assert found[name] == pytest.approx(said[name], rel=2e-3), name
    assert table(load(), theta).friction.coulomb_force == pytest.approx(16.5, rel=1e-4)


def test_the_search_finds_tables_and_repeats_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small search near a table of the set: the same seed gives the same tables, each within the tolerance."""
    near = _theta(load())
    monkeypatch.setattr(searching, "POPULATION", 8)
    monkeypatch.setattr(searching, "BATCH", 16)
    monkeypatch.setattr(searching, "LOW", np.maximum(LOW, near - 0.1))
    monkeypatch.setattr(searching, "HIGH", np.minimum(HIGH, near + 0.1))
    found = [searching.search(load(), 5, 3, workers=1, tell=lambda _share, _text: None) for _ in range(2)]
    assert [list(a.theta) for a in found[0]] == [list(b.theta) for b in found[1]]
    assert len({tuple(member.theta) for member in found[0]}) == 5
    assert all(member.distance <= 1 for member in found[0])


def test_a_search_goes_on_where_many_tables_are_equally_far() -> None:
    """Settling times are whole samples: where half of the tables are as far as the worst, less is asked for."""
    assert searching._next_aim([1.5, 2.0, 3.0, 4.0]) == 3.0
    assert searching._next_aim([1.5, 3.0, 3.0, 3.0]) == 1.5
    assert 2.999 < searching._next_aim([3.0, 3.0, 3.0, 3.0]) < 3.0
    assert searching._next_aim([0.5, 3.0, 3.0, 3.0]) == 1.0


def _theta(machine: Machine) -> Array:
    """The search's point of a table; of the four numbers behind three gains, the bandwidth is taken as 40 Hz."""
    said = dict(zip((one.name for one in COORDINATES), coordinates(machine), strict=True))
    w = 2 * np.pi * 40.0
    rules = {"bandwidth": 40.0, "a": said["kd"] / said["mass"] / w}
    rules |= {"b": said["kp"] / said["kd"] / w, "c": said["ki"] / said["kp"] / w}
    return np.log([{**said, **rules}[one.name] for one in searching.RANGES])


def test_a_machine_by_itself_is_no_set(tmp_path: Path) -> None:
    """An own machine alone: nothing is stated of a set, and the report has neither its figures nor its words."""
    (tmp_path / "own.toml").write_text(DEFAULT.read_text(encoding="utf-8"), encoding="utf-8")
    output = tmp_path / "out"
    assert main(STUDY, ["--machine", str(tmp_path / "own.toml"), "--quick", "--output", str(output)]) == CHECK_MISSED
    names = [check["name"] for check in results(output)["checks"]]
    assert "settling of the reversal, with compensation" in names
    assert not any("member" in name or "convention" in name for name in names)
    assert not list((output / "figures").glob("set.svg")) + list((output / "figures").glob("gap.svg"))
    assert "different tables" not in (output / "report.html").read_text(encoding="utf-8")


def test_the_error_against_the_number_of_elements(folder: Path) -> None:
    """Fitted and held-out errors fall to near the noise, and the published facts alone make two elements."""
    choice = results(folder)["results"]["choice"]
    assert choice["fitted_N"] == sorted(choice["fitted_N"], reverse=True)
    assert choice["held_out_N"][-1] < 0.05 * choice["held_out_N"][0]
    assert choice["noise_N"] * 0.9 < choice["fitted_N"][-1] < 2 * choice["noise_N"]
    assert choice["facts"]["limit_m"] == pytest.approx([10e-6, 95e-6], rel=1e-4)
    assert choice["facts"]["stiffness_N_per_m"] == pytest.approx([7e5, 1e5], rel=1e-4)
    assert len(choice["elements"]["limit_std_m"]) == choice["own"] == 10
    assert choice["own_over_least"] >= 1


def test_a_machine_without_published_outcomes_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = re.sub(r"\[published\][\s\S]*", "", DEFAULT.read_text(encoding="utf-8"))
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    assert main(STUDY, ["--machine", str(tmp_path / "own.toml"), "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert "no [published] outcomes" in capsys.readouterr().err
    assert main(STUDY, ["--ensemble", "nowhere.toml", "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert not (tmp_path / "out").exists()
