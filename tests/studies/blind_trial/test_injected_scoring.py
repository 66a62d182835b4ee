"""The score of answers about injected laws: what the uninjected record has as well does not count."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from studies.blind_trial.figures_of_merit import Rate
from studies.blind_trial.injected_scoring import Verdict, closure_of, rates, score


def answer(*names: str, outcome: str = "attributed", left: float = 1.0, **members: Any) -> dict[str, Any]:
    which = [
        {"effect": name, "parameters": rows[0], "further_members": list(rows[1:]), "acts": rows[0].pop("acts", None)}
        for name, rows in members.items()
    ]
    verdict = {"outcome": outcome, "effects": list(names), "equivalent": [], "partly": []}
    return {"verdict": verdict, "which": which, "how_far": {"gap_after": {"force_N": left}}}


def pitch(number: float) -> dict[str, Any]:
    return {"pitch": {"value": number, "unit": "m", "std": 1e-6, "role": "period"}}


def height(number: float, force: float | None = None) -> dict[str, Any]:
    """An amplitude, of a law that acts with so much force [N], by default as much as its amplitude."""
    acts = {"force_N": abs(number) if force is None else force, "position_m": None}
    return {"amplitude": {"value": number, "unit": "N", "std": 0.1, "role": "amplitude"}, "acts": acts}


def body(name: str, kind: str = "single", **period: float) -> dict[str, Any]:
    effect = {"name": name, "form": "a form", "size": 1.0, "unit": "N", "distance": 20.0, "shape": {}, "period": period}
    sizes = {"force_N": 2.0, "unexplained_force_N": 1.0}
    return {
        "name": [name],
        "kind": kind,
        "severity": "high",
        "identifiable": True,
        "identifiable_beside_speed": name != "stribeck",
        "record": 0,
        "effects": [effect],
        **sizes,
    }


BEFORE = answer("cogging", "stribeck", cogging=[pitch(2.5e-3)], stribeck=[height(1.0)])


@pytest.mark.parametrize(
    ("sealed", "given", "right", "wrong"),
    [
        (body("cable_spring"), answer("cogging", "cable_spring", cogging=[pitch(2.5e-3)]), True, False),
        (body("cable_spring"), answer("cogging", cogging=[pitch(2.5e-3)]), False, False),
        (body("cable_spring"), answer("cable_spring", "play"), False, True),
        (body("cable_spring"), answer("cable_spring", outcome="none_of_these"), False, False),
        (body("cogging", pitch=4e-3), answer("cogging", cogging=[pitch(2.5e-3), pitch(4.01e-3)]), True, False),
        (body("cogging", pitch=4e-3), answer("cogging", cogging=[pitch(2.5e-3), pitch(1.25e-3)]), False, False),
        (body("thrust_ripple", pitch=4e-3), answer("thrust_ripple", thrust_ripple=[pitch(9e-3)]), False, False),
        (body("stribeck"), answer("stribeck", stribeck=[height(2.0)]), True, False),
        (body("stribeck"), answer("stribeck", stribeck=[height(1.1)]), False, False),
        (body("stribeck"), answer("stribeck", stribeck=[height(-1.0)]), True, False),
        (body("stribeck"), answer("stribeck"), False, False),
        (body("stribeck"), answer("stribeck", stribeck=[height(1.1, force=4.0)]), True, False),
        (body("stribeck"), answer("stribeck", stribeck=[height(3.0, force=1.01)]), False, False),
        (body("bump", "outsider"), answer("cogging", cogging=[pitch(2.5e-3)]), True, False),
        (body("bump", "outsider"), answer("cogging", cogging=[pitch(7.1e-3)]), False, True),
        (body("bump", "outsider"), answer("play"), False, True),
        (body("bump", "outsider"), {"verdict": {"outcome": "failed"}}, False, False),
        (body("payload_mass", "parameters"), answer("stribeck", stribeck=[height(1.0)]), True, False),
        (body("payload_mass", "parameters"), answer("cable_spring"), False, True),
    ],
)
def test_only_what_the_uninjected_record_does_not_have_counts(
    sealed: dict[str, Any], given: dict[str, Any], right: bool, wrong: bool
) -> None:
    found = score("case-01", sealed, given, BEFORE)
    assert (found.right, found.wrong) == (right, wrong)


def test_closure_is_of_the_injected_part_alone() -> None:
    found = score("case-01", body("cable_spring"), answer("cable_spring", left=1.25), BEFORE)
    assert found.closure == pytest.approx(1 - math.sqrt(1.25**2 - 1.0**2))
    assert closure_of([found])["median"] == found.closure
    missed = score("case-02", body("stribeck"), answer(), BEFORE)
    rate: Mapping[str, Rate] = rates([found, missed, replace(found, right=False, wrong=True, kind="outsider")])
    assert (rate["right_name"].hits, rate["right_name"].tries) == (1, 2)
    assert (rate["right_name_apart"].hits, rate["right_name_apart"].tries) == (1, 1)
    assert (rate["wrong_name"].hits, rate["wrong_name"].tries) == (1, 3)
    assert isinstance(found, Verdict)
    assert not found.failed
