"""The settling times of a diagnosis come with their margins and their scatter."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.handover.files import judged_file
from diagnosis.how_far import quiet
from diagnosis.null import simulated
from models.machine import load
from studies.gap_diagnosis.own_records import made
from studies.gap_diagnosis.settling import settling_told


@pytest.fixture(scope="module")
def results(quick_run: Callable[[str], tuple[Path, int]]) -> dict[str, Any]:
    folder, _ = quick_run("gap_diagnosis")
    return dict(json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"])


def test_settling_times_come_with_what_they_hang_on_and_their_scatter(results: dict[str, Any]) -> None:
    """The single run is the comparison that the table of files shows."""
    told, files = results["settling"], {one["file"]: one["on_records"] for one in results["how_far"]["files"]}
    assert [row["file"] for row in told["rows"]] == ["as delivered", results["how_far"]["adopted_file"]]
    for row in told["rows"]:
        assert row["single_s"] == pytest.approx(files[row["file"]]["settling_s"])
        assert 0 < row["median_s"] <= row["quantile_s"] <= row["largest_s"]
    assert told["rows"][0]["largest_s"] > told["rows"][0]["single_s"]  # which a dither changes
    assert 0 <= told["nearest_least_m"] < told["nearest_median_m"]


def test_records_that_do_not_go_in_steps_have_no_settling_times() -> None:
    record = made(load(), 0, quick=True).records[0]
    ramp = replace(record, target=np.linspace(0.0, 1e-3, record.target.size))
    delivered: Any = SimpleNamespace(machine=load())  # of which nothing else is asked
    assert settling_told([delivered], [ramp], [ramp], 0) is None


def test_the_simulation_s_dither_is_in_its_loop() -> None:
    """The feedback answers to it, by its proportional gain at least; without one two seeds are the same run."""
    machine, size = load(), 1e-7
    (drives,) = made(machine, 0, quick=True).records[:1]
    candidate = judged_file(machine, [np.zeros(len(machine.friction.limit))]).candidate
    exact, again = (simulated(quiet(candidate), drives, 0, seed) for seed in (0, 1))
    assert np.abs(exact.position - again.position).max() < 1e-10
    shaken = simulated(quiet(candidate, size), drives, 0, 1)
    assert np.std(shaken.position - exact.position) == pytest.approx(size, rel=0.5)
    assert np.std(shaken.command - exact.command) > 0.5 * machine.control.pid.kp * size
