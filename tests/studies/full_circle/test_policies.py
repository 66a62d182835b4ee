"""Policies at equal budget on sealed machines: what is scored, what is kept, and cheats that are caught."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from studies.blind_trial.sealer.machines import cases
from studies.full_circle import policies
from studies.full_circle.policies import POLICIES, Result, Terms, answered, rates, right_over_time, run, scored

SEED, CASE = 5, 6  # a machine that is drawn fast, with a slow controller
BODY = {"case": "3", "kind": "single", "name": ["cogging"], "severity": "low", "effects": [{"distance": 12.0}]}


def look(seconds: float, names: list[str], logarithm: float, failed: str = "") -> dict[str, Any]:
    after = None if failed else {"outcome": "attributed" if names else "nothing_to_explain", "names": names}
    return {
        "seconds": seconds,
        "after": after,
        "failed": failed,
        "log10_e_value": logarithm,
        "log10_e_values": dict.fromkeys(names, logarithm),
    }


def answer(names: list[str], *looks: dict[str, Any], sure: bool = True, **body: Any) -> dict[str, Any]:
    outcome = "attributed" if names else "nothing_to_explain"
    course = {
        "outcome": "named" if names and sure else "cannot_tell",
        "effects": names if sure else [],
        "seconds": sum(one["seconds"] for one in looks),
        "looks": list(looks),
        "needed": 50.0,
    }
    verdict = {"outcome": outcome, "effects": names, "equivalent": [], "partly": []}
    return {"course": course, "verdict": verdict, "refused": [], "beyond": 0, "body": json.dumps({**BODY, **body})}


def test_only_sure_names_are_right_or_false() -> None:
    looks = (look(2.0, ["cogging"], 0.0), look(8.0, ["cogging"], 4.0))
    right = scored(3, "active", answer(["cogging"], *looks))
    assert (right.right, right.severity, right.seconds, right.named) == (True, "low", 10.0, ("cogging",))
    assert right.looks == ((2.0, "attributed", ()), (10.0, "attributed", ("cogging",)))
    unsure = scored(3, "active", answer(["cogging"], looks[0], sure=False))
    assert not unsure.right
    clean: dict[str, Any] = {"kind": "clean", "name": [], "effects": []}
    accused = scored(3, "active", answer(["cogging"], *looks, **clean))
    assert accused.false_name
    quiet = scored(3, "active", answer(["cogging"], looks[0], sure=False, **clean))
    assert not quiet.false_name


def test_an_error_is_a_wrong_answer_of_whatever_kind() -> None:
    for kind in ("single", "clean"):
        body = {**BODY, "kind": kind, "name": ["cogging"] if kind == "single" else []}
        failed = scored(3, "active", {"error": "it ended", "body": json.dumps(body)})
        assert not failed.right
        table = rates([failed])["active"]
        assert table["false name"].hits == (kind == "clean")


def test_rates_and_the_curve_over_time_count_what_they_say() -> None:
    early = scored(3, "active", answer(["cogging"], look(5.0, ["cogging"], 3.0)))
    late = replace(early, looks=((5.0, "nothing_to_explain", ()), (20.0, "attributed", ("cogging",))))
    wrong = replace(early, right=False, looks=((5.0, "attributed", ("play",)),), refused=2)
    table = rates([early, late, wrong])["active"]
    assert (table["right name"].hits, table["right name"].tries) == (2, 3)
    assert (table["right name, low"].hits, table["right name, high"].tries) == (2, 0)
    assert table["beyond the limits"].hits == 1
    curve = right_over_time([early, late, wrong], (1.0, 5.0, 30.0))["active"]
    assert [one.hits for one in curve] == [0, 1, 2]
    assert {one.tries for one in curve} == {3}


def test_a_run_is_resumed_where_it_stopped_unless_the_terms_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[int, str]] = []

    def stand_in(_seed: int, case: int, name: str, _terms: Terms) -> dict[str, Any]:
        done.append((case, name))
        return answer(["cogging"], look(5.0, ["cogging"], 3.0), case=str(case))

    monkeypatch.setattr(policies, "answered", stand_in)
    file = tmp_path / "answers.json"
    assert len(run(7, [0, 1], ["active"], file)) == 2
    found = run(7, [0, 1], ["active", "random"], file)
    assert done == [(0, "active"), (1, "active"), (0, "random"), (1, "random")]
    assert [(one.case, one.policy) for one in found] == [(0, "active"), (0, "random"), (1, "active"), (1, "random")]
    run(7, [0], ["active"], file, Terms(seconds=30.0))
    assert len(done) == 5


@pytest.mark.parametrize("way", ["opens the sealer", "imports the sealer"])
def test_an_asker_that_opens_what_is_sealed_has_no_answer(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = _with(way, tmp_path, monkeypatch)
    assert str(found["error"]).startswith("refused: ")
    assert scored(CASE, "active", found).right is False


def test_requests_beyond_the_limits_are_counted_by_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _with("asks for too much", tmp_path, monkeypatch)["beyond"] == 1


def _with(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Mapping[str, Any]:
    monkeypatch.setattr(policies, "ASKER", (sys.executable, "-m", "tests.studies.full_circle.cheating_asker", way))
    return answered(SEED, CASE, "active", Terms(cache=tmp_path / "null"))


def test_a_sealed_machine_is_diagnosed_by_asking_it(tmp_path: Path) -> None:
    """An outsider: within the limits of time and records, and without a name that is not sure."""
    terms = Terms(seconds=9.0, records=2, cache=tmp_path / "null")
    (found,) = run(SEED, [CASE], ["active"], tmp_path / "answers.json", terms)
    assert isinstance(found, Result)
    assert (found.error, found.refused, found.kind) == ("", 0, "outsider")
    assert 0 < found.seconds <= terms.seconds
    assert len(found.looks) <= terms.records
    assert found.named == () or found.stop == "named"
    text = (tmp_path / "answers.json").read_text(encoding="utf-8")
    assert json.loads(json.loads(text)["answers"][f"{CASE} active"]["body"])["kind"] == cases.plan(SEED, CASE, "").kind


def test_every_policy_has_a_name_of_its_own() -> None:
    assert list(POLICIES) == ["active", "fixed suite", "random", "D-optimal"]
    assert all(callable(make(0)) for make in POLICIES.values())
