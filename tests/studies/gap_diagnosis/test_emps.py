"""The measured EMPS record: its authors publish that its friction differs by direction; a diagnosis has to say so.

The record has no licence and is no part of the project: without it beside the project these tests skip.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from studies.command import DONE, main
from studies.gap_diagnosis.__main__ import STUDY

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data" / "emps" / "DATA_EMPS.mat"
DIRECTIONAL = "directional_friction"
MACHINE = ROOT / "models" / "machines" / "emps.toml"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    if not DATA.is_file():
        pytest.skip("needs DATA_EMPS.mat beside the project")
    output = tmp_path_factory.mktemp("emps") / "out"
    assert main(STUDY, [str(DATA), "--machine", str(MACHINE), "--no-report", "--output", str(output)]) == DONE
    return dict(json.loads((output / "results.json").read_text(encoding="utf-8"))["results"])


def test_its_controller_replays_but_for_the_noise_of_the_log(results: dict[str, Any]) -> None:
    """A PD whose derivative is the position's; what is left is what the rounded reading makes of the command."""
    (one,) = results["where"]["details"]["controller"]
    assert one["replays"]
    assert 0.1 < one["rms_N"] < 0.2


def test_friction_that_differs_by_direction_is_named_as_what_it_is_in_part(results: dict[str, Any]) -> None:
    """The published gain, of 4.08 to 3.11 % of the force, itself leaves more than half of the gap open."""
    verdict = results["verdict"]
    assert (verdict["outcome"], verdict["effects"], verdict["partly"]) == ("none_of_these", [], [DIRECTIONAL])
    assert "In part it is directional friction" in results["answer"]["which"]
    assert "distance 7.5 µm at the end of its range" in results["answer"]["which"]


def test_friction_that_differs_by_direction_is_the_first_effect_to_go_into_the_model(results: dict[str, Any]) -> None:
    """Behind the machine file's viscous friction, which is re-fitted and no finding."""
    delivered, refitted, first, *_ = results["how_far"]["stages"]
    assert [delivered["added"], refitted["added"], first["added"]] == ["as delivered", "re-fitted", DIRECTIONAL]
    assert first["position_m"] < 0.8 * refitted["position_m"]


def test_the_closure_is_stated(results: dict[str, Any]) -> None:
    far = results["how_far"]
    low, high = far["closure_interval"]
    assert 0 < low <= far["closure"] <= high <= 1
    assert (
        f"closes {100 * far['closure']:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)" in results["answer"]["how_far"]
    )
