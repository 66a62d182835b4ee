"""What is said of a learned law, from plain results."""

from __future__ import annotations

from typing import Any

import pytest

from studies.gap_diagnosis import figures, unknown_law
from studies.gap_diagnosis.answer import front, sentences

LEARNED: dict[str, Any] = {
    "adopted": True,
    "reason": None,
    "coordinate": "position",
    "unit": "m",
    "symmetry": "plain",
    "knots": [0.0, 1e-3, 2e-3],
    "values": [0.0, -3.0, 0.0],
    "values_unit": "N",
    "band": [[-0.1, 0.1], [-3.1, -2.9], [-0.1, 0.2]],
    "closure": 0.97,
    "closure_interval": [0.91, 0.99],
}


def test_an_adopted_law_is_told_with_its_judgement() -> None:
    assert unknown_law.told(LEARNED) == [
        "Learned from the records, it is a force over the position, the same in both directions, of up to 3 N.",
        "On types of motion that were not used it closes 97 % (91 to 99 %) of the gap, and improved.toml has it as "
        "[effects.measured].",
    ]


def test_a_law_at_one_place_is_told_with_the_place() -> None:
    """As of a rail's joint: 4.2 N at 41.5 mm, on an axis of 150 mm."""
    knots, values = [0.0, 0.038, 0.0397, 0.0415, 0.0428, 0.044, 0.0458, 0.15], [0, 0, -1.3, -4.2, -4.1, -1.7, 0, 0]
    rail = {**LEARNED, "symmetry": "directional", "knots": knots, "values": values}
    assert unknown_law.told(rail)[0].endswith(
        "turning with the direction of motion, of up to 4.2 N at 41.5 mm, and more than half of that from 40.2 mm to "
        "43.8 mm."
    )
    for other in (
        {**rail, "values": [-2.5, 0, -1.3, -4.2, -4.1, -1.7, 0, 0]},  # elsewhere, too
        {**rail, "values": [0, 0, 0, 0, 0, 0, 0, -4.2]},  # at the end of the way, beyond which it may grow
        {**rail, "knots": [0.0, 0.01, 0.02, 0.05, 0.09, 0.1, 0.11, 0.15]},  # over much of it
        {**rail, "values": [0, 0, 3.0, -4.2, -4.1, 0, 0, 0]},  # the other way beside it
        {**rail, "coordinate": "speed"},
    ):
        assert unknown_law.told(other)[0].endswith("of up to 4.2 N.")


@pytest.mark.parametrize(
    ("symmetry", "unit", "law", "size", "label"),
    [
        (
            "drag",
            "N s/m",
            "a drag, in proportion to the speed, over the position",
            "3 N s/m",
            "drag on the table [N s/m]",
        ),
        ("thrust", "1", "a part of the thrust over the position", "3 %", "part of the thrust [1]"),
    ],
)
def test_a_law_in_proportion_to_speed_or_thrust_is_told_with_its_unit(
    symmetry: str, unit: str, law: str, size: str, label: str
) -> None:
    values = [0.0, -0.03, 0.0] if unit == "1" else LEARNED["values"]
    shown = {**LEARNED, "symmetry": symmetry, "values_unit": unit, "values": values}
    assert unknown_law.told(shown)[0] == f"Learned from the records, it is {law}, of up to {size}."
    assert unknown_law.in_short(shown) == f"A{law[1:]}"
    (axes,) = figures.learned_curve({"results": {"learned": shown}}).axes
    assert axes.get_ylabel() == label


def test_a_law_that_is_handed_over_comes_before_what_it_resembles(results: dict[str, Any]) -> None:
    """The page of a rail's joint had begun with the friction that it resembles in part, and had the law in a remark."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": ["cogging"]}
    gap = {"force_N": 0.0208, "position_m": 28e-9, "settling_s": None}
    files = [*results["how_far"]["files"][:2], {"file": "measured law", "on_records": gap, "held_out": gap}]
    stages = [*results["how_far"]["stages"][:2], {"added": "measured law", **gap}]
    far = {**results["how_far"], "adopted_file": "measured law", "files": files, "harms": [], "stages": stages}
    whole = {**results, "verdict": verdict, "how_far": far, "learned": LEARNED}
    told, page = sentences(whole), front(whole)
    assert told["outcome"] == (
        "A force over the position, the same in both directions, explains it, which has no name in the catalogue"
    )
    assert page["which"] == " ".join(unknown_law.told(LEARNED))
    assert "and with the measured law 0.0208 N" in told["how_far"]
    assert "With the measured law 0.021 N and 28 nm of position are left on motions held out." in page["how_far"]
    assert told["how_far"].count("With the measured law") == 1
    axes = figures.waterfall({"results": whole}).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()][2:] == ["with measured law"]
    refused = {**whole, "how_far": {**results["how_far"], "adopted_file": "re-fitted"}}
    assert sentences(refused)["outcome"].endswith("in part it resembles cogging")


def test_a_refused_law_is_told_with_the_reason() -> None:
    refused = {**LEARNED, "adopted": False, "reason": "on types of motion that were not used it closes 40 %"}
    (told,) = unknown_law.told(refused)
    assert told.endswith(
        "up to 3 N; but on types of motion that were not used it closes 40 %, so that improved.toml does not have it."
    )
    (unsized,) = unknown_law.told({**refused, "closure": 0.19})  # a user's was of 1540 N, where 3.6 N were left
    assert unsized.startswith(
        "A force over the position, the same in both directions, was learned from the records; but on types of motion"
    )


@pytest.mark.parametrize(
    ("learned", "text"),
    [(None, []), ({"adopted": False, "reason": "too few"}, ["No law was learned in its place: too few."])],
)
def test_without_a_curve_there_is_a_reason_or_nothing(learned: dict[str, Any] | None, text: list[str]) -> None:
    assert unknown_law.told(learned) == text
    assert not unknown_law.has_curve(learned)


def test_what_the_file_with_the_law_leaves_is_told() -> None:
    file = {"file": "measured law", "held_out": {"force_N": 0.023, "position_m": 44e-9}}
    assert unknown_law.left({"files": [file]}) == [
        "With the measured law 0.023 N and 44 nm of position are left on motions held out."
    ]
    assert unknown_law.left({"files": [{**file, "file": "re-fitted"}]}) == []


def test_the_figure_shows_the_curve_and_its_band() -> None:
    (axes,) = figures.learned_curve({"results": {"learned": LEARNED}}).axes
    (line,) = axes.lines
    assert list(line.get_ydata()) == LEARNED["values"]  # type: ignore[arg-type]
    assert len(axes.collections) == 1
    assert axes.get_xlabel() == "the position [m]"
