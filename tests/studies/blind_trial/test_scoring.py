"""The scoring rules, on hand-made answers with known scores."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.blind_trial import figures_of_merit as merit
from studies.blind_trial.scoring import KeyFileError, Label, Score, groups_of, label_of, score

CATALOGUE = ("cogging", "cable_spring", "stribeck", "viscous_friction")


def label(kind: str, *names: str, identifiable: bool = True, case: str = "case-01", severity: str = "high") -> Label:
    return Label(case, kind, names, severity, 100.0, identifiable)


def answer(outcome: str, effects: Sequence[str] = (), equivalent: Sequence[Sequence[str]] = (), **more: Any) -> Any:
    return {"verdict": {"outcome": outcome, "effects": list(effects), "equivalent": list(equivalent)}, **more}


SINGLE = label("single", "cogging")
PAIR = label("pair", "cogging", "stribeck")


@pytest.mark.parametrize(
    ("sealed", "answered", "right", "false_positive"),
    [
        (SINGLE, answer("attributed", ["cogging"]), True, False),
        (SINGLE, answer("attributed", ["cogging"], [["cogging", "cable_spring"]]), True, False),
        (SINGLE, answer("ambiguous", ["cable_spring", "cogging"]), True, False),
        (SINGLE, answer("ambiguous", ["cable_spring"], [["cogging", "cable_spring", "stribeck"]]), True, False),
        (SINGLE, answer("ambiguous", ["a", "b", "c", "cogging"]), False, False),  # four names are no name
        (SINGLE, answer("attributed", ["stribeck"]), False, True),
        (SINGLE, answer("attributed", ["cogging", "stribeck"]), False, True),
        (SINGLE, answer("none_of_these"), False, False),
        (SINGLE, answer("nothing_to_explain", ["cogging"]), False, False),
        (SINGLE, answer("failed"), False, False),
        (SINGLE, {}, False, False),
        (PAIR, answer("attributed", ["stribeck", "cogging"]), True, False),
        (PAIR, answer("attributed", ["stribeck", "cable_spring"], [["cogging", "cable_spring"]]), True, False),
        (PAIR, answer("ambiguous", ["cogging"], [["cogging", "stribeck"]]), False, False),  # one of two, not both
        (PAIR, answer("attributed", ["cogging"]), False, False),
        (PAIR, answer("attributed", ["cogging", "stribeck", "viscous_friction"]), False, True),
        (label("clean"), answer("nothing_to_explain"), True, False),
        (label("clean"), answer("parameters", ["payload_mass"]), True, False),
        (label("clean"), answer("none_of_these"), True, False),
        (label("clean"), answer("ambiguous", ["cogging", "stribeck"]), False, True),
        (label("clean"), answer("failed"), False, False),
        (label("parameters"), answer("attributed", ["cogging"]), False, True),
        (label("outsider", "gusts"), answer("none_of_these"), True, False),
        (label("outsider", "gusts"), answer("nothing_to_explain"), False, False),
        (label("outsider", "gusts"), answer("attributed", ["cogging"]), False, True),
        (label("disabled", "cogging"), answer("none_of_these"), True, False),
        (label("disabled", "cogging"), answer("attributed", ["cable_spring"]), False, True),
    ],
)
def test_an_answer_is_scored_as_right_or_as_a_false_positive(
    sealed: Label, answered: Any, right: bool, false_positive: bool
) -> None:
    found = score(sealed, answered)
    assert (found.right, found.false_positive) == (right, false_positive)


def test_groups_that_touch_are_one() -> None:
    verdict = {"outcome": "ambiguous", "effects": ["a", "c"], "equivalent": [["a", "b"], ["b", "c"], ["x", "y"]]}
    assert groups_of(verdict) == (("a", "c", "b"),)


@given(
    st.lists(st.sampled_from("abcdef"), max_size=4, unique=True),
    st.lists(st.sets(st.sampled_from("abcdef")), max_size=3),
)
def test_every_named_effect_is_in_exactly_one_group(effects: list[str], equivalent: list[set[str]]) -> None:
    groups = groups_of({"outcome": "attributed", "effects": effects, "equivalent": [list(one) for one in equivalent]})
    named = [name for group in groups for name in group]
    assert len(named) == len(set(named))
    assert set(effects) <= set(named) <= set(effects).union(*equivalent)


def body(**content: Any) -> str:
    return json.dumps({"case": "case-01", **content})


@pytest.mark.parametrize(
    ("sealed", "kind"),
    [
        (body(name=[]), "clean"),
        (body(name="nothing"), "clean"),
        (body(name=["payload_mass"]), "parameters"),
        (body(name=["cogging"]), "single"),
        (body(name=["cogging", "stribeck"]), "pair"),
        (body(name=["moon"]), "outsider"),
        (body(name=["cogging"], disabled=["cogging"]), "disabled"),
        (body(name=["cogging"], kind="outsider"), "outsider"),
    ],
)
def test_labels_of_others_are_sorted_by_their_names(sealed: str, kind: str) -> None:
    assert label_of("case-01", sealed, CATALOGUE).kind == kind


@pytest.mark.parametrize("sealed", ["no json", "[]", body(), json.dumps({"case": "case-02", "name": []})])
def test_a_malformed_body_of_a_key_is_an_error(sealed: str) -> None:
    with pytest.raises(KeyFileError, match="case-01"):
        label_of("case-01", sealed, CATALOGUE)


def test_only_what_is_visible_counts() -> None:
    hidden = score(label("single", "cogging", identifiable=False), answer("nothing_to_explain"))
    shown = score(SINGLE, answer("attributed", ["cogging"]))
    assert merit.rates([hidden, shown])["right_name"] == merit.Rate(1, 1)
    assert merit.by_severity([hidden, shown])["high"]["silent"]["hits"] == 1


def test_how_often_a_likeness_is_the_effect_itself() -> None:
    """A named effect does not count as a resemblance, whatever else is stated."""
    unnamed = answer("none_of_these")["verdict"]
    alike = [
        score(SINGLE, {"verdict": {**unnamed, "partly": ["stribeck", "cogging"]}}),
        score(label("outsider", "gusts"), {"verdict": {**unnamed, "partly": ["cogging"]}}),
        score(SINGLE, {"verdict": {**unnamed, "partly": []}}),
        score(SINGLE, answer("attributed", ["cogging"])),
    ]
    assert merit.likeness(alike) == merit.Rate(1, 2)


def test_the_interval_of_a_rate_is_clopper_and_pearsons() -> None:
    """Known limits: 0 of n has the upper end 1 - (a/2)^(1/n); the tail beyond either end is a/2."""
    low, high = merit.Rate(0, 20).interval
    assert low == 0
    assert high == pytest.approx(1 - 0.025 ** (1 / 20))
    low, high = merit.Rate(7, 10).interval
    tail = sum(math.comb(10, k) * low**k * (1 - low) ** (10 - k) for k in range(7, 11))
    assert tail == pytest.approx(0.025, rel=1e-6)
    assert merit.Rate(0, 0).interval == (0.0, 1.0)
    assert math.isnan(merit.Rate(0, 0).share)


def test_calibration_of_known_statements() -> None:
    """80 % stated ten times and true eight times: no error; 30 % stated and never true: an error of 0.3."""
    exact = [merit.Statement(0.8, k < 8) for k in range(10)]
    wrong = [merit.Statement(0.3, False)] * 10
    assert merit.calibration(exact)["error"] == pytest.approx(0.0)
    assert merit.calibration(wrong)["error"] == pytest.approx(0.3)
    assert merit.calibration(exact + wrong)["error"] == pytest.approx(0.15)
    assert merit.calibration([merit.Statement(1.0, True)])["error"] == 0.0
    assert merit.calibration([])["error"] is None


def scored(sealed: Label, answered: Any) -> tuple[Score, dict[str, Any]]:
    return score(sealed, answered), {sealed.case: answered}


def test_a_probability_is_true_if_the_effect_is_in_the_case() -> None:
    which = [{"effect": "cogging", "probability": 0.9}, {"effect": "stribeck", "probability": 0.1}]
    one, answers = scored(SINGLE, answer("attributed", ["cogging"], which=which))
    assert merit.statements(answers, [one], first=True) == [merit.Statement(0.9, True)]
    assert merit.statements(answers, [one], first=False)[1] == merit.Statement(0.1, False)
    assert one.probability == 0.9


def test_confusion_counts_every_case_once() -> None:
    cases = [
        score(SINGLE, answer("attributed", ["cogging"])),
        score(SINGLE, answer("attributed", ["stribeck"])),
        score(PAIR, answer("attributed", ["stribeck", "cogging"])),
        score(label("clean"), answer("nothing_to_explain")),
        score(label("outsider", "gusts"), answer("none_of_these")),
    ]
    table = merit.confusion(cases)
    assert sum(map(sum, table["counts"])) == len(cases)
    assert table["rows"][0] == "cogging"
    row = dict(zip(table["columns"], table["counts"][0], strict=True))
    assert row["cogging"] == row["stribeck"] == 1


def test_closure_is_the_median_of_right_answers() -> None:
    far = [{"closure": value, "closure_interval": [value - 0.1, value + 0.1]} for value in (0.2, 0.9, 0.95)]
    cases = [
        score(SINGLE, answer("attributed", ["stribeck"], how_far=far[0])),
        score(SINGLE, answer("attributed", ["cogging"], how_far=far[1])),
        score(SINGLE, answer("attributed", ["cogging"], how_far=far[2])),
    ]
    assert merit.closures(cases)["median"] == pytest.approx(0.925)
    assert merit.closures(cases)["count"] == 2
