"""Policies at equal budget: what is scored, and how the curve of right names over machine time is counted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from studies.full_circle.policies import POLICIES, rates, right_over_time, scored

LABEL = {"case": "sealed", "kind": "single", "name": ["cogging"], "severity": "low", "effects": [{"distance": 12.0}]}


def look(seconds: float, names: list[str], logarithm: float, failed: str = "") -> dict[str, Any]:
    after = None if failed else {"outcome": "attributed" if names else "nothing_to_explain", "names": names}
    return {
        "seconds": seconds,
        "after": after,
        "failed": failed,
        "log10_e_value": logarithm,
        "log10_e_values": dict.fromkeys(names, logarithm),
    }


def answer(names: list[str], *looks: dict[str, Any], sure: bool = True) -> dict[str, Any]:
    outcome = "attributed" if names else "nothing_to_explain"
    course = {
        "outcome": "named" if names and sure else "cannot_tell",
        "effects": names if sure else [],
        "seconds": sum(one["seconds"] for one in looks),
        "looks": list(looks),
        "needed": 50.0,
    }
    verdict = {"outcome": outcome, "effects": names, "equivalent": [], "partly": []}
    return {"begun_s": 2.0, "course": course, "verdict": verdict, "beyond": 0}


def test_only_sure_names_are_right_or_false() -> None:
    looks = (look(0.0, ["cogging"], 0.0), look(8.0, ["cogging"], 4.0))
    right = scored("3", "active", answer(["cogging"], *looks), LABEL)
    assert (right.right, right.severity, right.seconds, right.named) == (True, "low", 10.0, ("cogging",))
    assert right.looks == ((2.0, ()), (10.0, ("cogging",)))
    unsure = scored("3", "active", answer(["cogging"], looks[0], sure=False), LABEL)
    assert not unsure.right
    clean = {**LABEL, "kind": "clean", "name": [], "effects": []}
    assert scored("3", "active", answer(["cogging"], *looks), clean).false_name
    assert not scored("3", "active", answer(["cogging"], looks[0], sure=False), clean).false_name


def test_a_failure_is_a_wrong_answer_of_whatever_kind() -> None:
    for kind in ("single", "clean"):
        label = {**LABEL, "kind": kind, "name": ["cogging"] if kind == "single" else []}
        failed = scored("3", "active", {"failed": "it ended", "beyond": 0}, label)
        assert not failed.right
        assert rates([failed])["active"]["false name"].hits == (kind == "clean")


def test_rates_and_the_curve_over_time_count_what_they_say() -> None:
    early = scored("3", "active", answer(["cogging"], look(3.0, ["cogging"], 3.0)), LABEL)
    late = replace(early, looks=((5.0, ()), (20.0, ("cogging",))))
    wrong = replace(early, right=False, looks=((5.0, ("play",)),), refused=2)
    table = rates([early, late, wrong])["active"]
    assert (table["right name"].hits, table["right name"].tries) == (2, 3)
    assert (table["right name, low"].hits, table["right name, high"].tries) == (2, 0)
    assert table["beyond the limits"].hits == 1
    curve = right_over_time([early, late, wrong], (1.0, 5.0, 30.0))["active"]
    assert [one.hits for one in curve] == [0, 1, 2]
    assert {one.tries for one in curve} == {3}


def test_every_policy_has_a_name_of_its_own() -> None:
    assert list(POLICIES) == ["active", "fixed suite", "random", "D-optimal"]
    assert all(callable(make(0)) for make in POLICIES.values())
