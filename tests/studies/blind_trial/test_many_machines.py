"""Figures over many machines: bounds against targets, the worst tenth and what it has in common, kinds, no answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from studies.blind_trial import many_machines
from studies.blind_trial.packs import read_pack
from studies.blind_trial.scoring import label_of, score
from studies.options import BadInputError
from tests.studies.blind_trial.conftest import Packer

CATALOGUE = ("cogging", "stribeck", "viscous_friction", "cable_spring")


def body(case: str, number: int, *names: str, kind: str = "single", **more: Any) -> str:
    features = {"number": number, "mass_kg": 1.0 + number, "controller": "PID" if number < 3 else "P/PI"}
    effects = [{"name": name, "form": "another", "distance": 90.0} for name in names]
    whole = {"case": case, "name": list(names), "kind": kind, "machine": features, "effects": effects, **more}
    return json.dumps({"rejected": {"unstable": number}, "identifiable": True, **whole})


def said(outcome: str, *effects: str, **more: Any) -> dict[str, Any]:
    verdict = {"outcome": outcome, "effects": list(effects), "equivalent": []}
    return {"verdict": verdict, "which": [], "how_far": {"closure": 0.8}, "seconds": 3.0, **more}


def figures(*rows: tuple[str, dict[str, Any]]) -> dict[str, Any]:
    bodies = {json.loads(one)["case"]: one for one, _ in rows}
    labels = {case: label_of(case, one, CATALOGUE) for case, one in bodies.items()}
    found = many_machines.figures(bodies, labels, {json.loads(one)["case"]: answer for one, answer in rows})
    assert found is not None
    return found


def test_labels_of_one_table_have_none() -> None:
    plain = json.dumps({"case": "case-1", "name": ["cogging"]})
    label = label_of("case-1", plain, CATALOGUE)
    assert (
        many_machines.figures({"case-1": plain}, {"case-1": label}, {"case-1": said("attributed", "cogging")}) is None
    )


def test_an_innocent_without_an_answer_counts_as_accused() -> None:
    found = figures(
        (body("case-1", 0, kind="clean"), said("nothing_to_explain")),
        (body("case-2", 0, kind="clean"), {**said("failed"), "error": "ValueError: singular"}),
        (body("case-3", 1, kind="parameters"), said("attributed", "cogging")),
    )
    assert (found["rates"]["false_accusation"]["hits"], found["rates"]["false_accusation"]["tries"]) == (2, 3)
    assert found["errors"] == {"ValueError: singular": 1}
    assert found["innocents"] == 3
    assert found["rejected"] == {"unstable": 1}  # of each machine once


def test_an_abstention_needs_the_right_coordinate() -> None:
    outsider: dict[str, Any] = {"kind": "outsider", "coordinates": ["position"]}
    places = [{"position": 0.6, "time": 0.2}, {"position": 0.1, "time": 0.2}, {}]
    rows = [
        (body(f"case-{k}", 0, "bump", **outsider), said("none_of_these", where={"by_coordinate": shares}))
        for k, shares in enumerate(places)
    ]
    found = figures(*rows)["rates"]
    assert (found["abstention"]["hits"], found["right_coordinate"]["hits"]) == (3, 1)


def answered(right: Sequence[bool]) -> list[dict[str, Any]]:
    return [said("attributed", "cogging" if one else "stribeck") for one in right]


def test_the_worst_tenth_is_named_with_what_it_has_in_common() -> None:
    """Twenty machines with four cases each: of the two heaviest none is right, of all others each."""
    rows = [
        (body(f"case-{20 * k + i}", i, "cogging"), answered([i < 18])[0]) for i in range(20) for k in range(4)
    ]  # fmt: skip
    found = figures(*rows)
    worst = found["worst"]
    assert worst["machines"] == [19, 20]
    assert (worst["share"], worst["tries"]) == (0.0, 8)
    assert worst["by_chance"] == pytest.approx(0.55, abs=0.15)  # 2 of 20 at 0.9, four cases each
    assert worst["common"][0]["feature"] == "mass_kg"
    assert worst["common"][0]["worst"] > worst["common"][0]["others"]


def test_chance_alone_is_the_mean_of_the_worst_of_equal_machines() -> None:
    """One case on each of ten machines: the worst is wrong unless all are right."""
    by_chance = many_machines._by_chance([1] * 10, 0.8)
    assert by_chance == pytest.approx(0.8**10, abs=0.03)


def test_kinds_are_confused_by_coordinate_parity_and_memory() -> None:
    found = figures(
        (body("case-1", 0, "cogging"), said("attributed", "cogging")),
        (body("case-2", 0, "cogging"), said("attributed", "cable_spring")),
        (body("case-3", 1, "stribeck"), said("none_of_these")),
    )["kinds"]
    table = {
        row: dict(zip(found["columns"], counts, strict=True))
        for row, counts in zip(found["rows"], found["counts"], strict=True)
    }
    own, other = (many_machines.kind_of(name) for name in ("cogging", "stribeck"))
    assert own == many_machines.kind_of("cable_spring") != other  # a force along the position, whatever its form
    assert table[own] == {own: 2, "none_of_these": 0}
    assert table[other]["none_of_these"] == 1
    assert np.sum(found["counts"]) == 3


def test_a_target_is_reached_where_the_bound_reaches_it() -> None:
    """19 of 20 is a share of 0.95; the bound of 0.75 misses 0.9."""
    rows = [(body(f"case-{k}", k, "cogging"), answered([k > 0])[0]) for k in range(20)]
    many = figures(*rows)
    results = {
        "machines": many,
        "closure": {"count": 0},
        "calibration": {"first": {"count": 0}},
        "seconds": {"median": 3.0, "trial": None},
        "cases": 20,
    }
    checks = {check.name: check for check in many_machines.checks(results, quick=False)}
    name = "right name, single effects above the detection limit: lower bound"
    assert checks[name].value == many["rates"]["right_name"]["low"] < 0.76
    assert not checks[name].holds
    assert checks["median time of one diagnosis"].holds
    assert not checks["machines, enough for the claim"].holds


def test_a_learned_law_counts_by_its_own_closure_and_also_where_it_is_refused() -> None:
    """The figure had been that of named laws in another form, whose curve is measured: an adopted law did not count."""
    form = [{"effect": "cogging", "probability": 0.9, "measured": {"coordinate": "position"}}]
    named = {**said("attributed", "cogging"), "which": form, "learned": None}
    too_few = {"adopted": False, "reason": "the records hold 1 type of motion"}
    laws = ({"adopted": True, "closure": 0.9}, {"adopted": False, "closure": 0.2}, too_few)
    rows = [
        (body("case-1", 0, "cogging"), named),
        *((body(f"case-{i}", 0, "fold"), {**said("none_of_these"), "learned": law}) for i, law in enumerate(laws, 2)),
    ]
    assert figures(*rows)["learned"] == {"count": 2, "median": pytest.approx(0.55)}


def test_a_case_has_a_nominal_machine_of_its_own(small_pack: Packer) -> None:
    folder = small_pack({"name": ["cogging"]}, {"name": []})
    (folder / "nominal.json").rename(folder / "case-02" / "nominal.json")
    with pytest.raises(BadInputError, match="case-01 has none of its own"):
        read_pack(folder)
    (folder / "case-01" / "nominal.json").write_text("{}", encoding="utf-8")
    assert [case.nominal.parent.name for case in read_pack(folder).cases] == ["case-01", "case-02"]


def test_the_strongest_coordinate_is_the_one_that_is_scored() -> None:
    label = label_of("case-1", body("case-1", 4, "bump", kind="outsider", coordinates=["position"]), CATALOGUE)
    found = score(label, said("none_of_these", where={"by_coordinate": {"position": 0.2, "time": 0.5, "dwell": None}}))
    assert found.coordinate == "time"
    assert (label.machine, label.coordinates) == (4, ("position",))
