"""The law and tables in C: the simulator's settling times on the machine itself, worse ones on tables that are off."""

from __future__ import annotations

from pathlib import Path

import pytest

from design.deployment.c_source import law_sources, loop_sources
from design.validation import sequence
from models.deployment.coefficients import load_coefficients
from models.records.record import motions
from models.records.settling import settling_time
from models.simulation.simulator import simulate
from models.variation import Variation
from studies.binomial import interval
from studies.export.tables import on_tables
from studies.perturbed import TOGETHER, Perturbed
from tests.design.deployment.compiling import NEEDS_CC, put
from tests.models.deployment.laws import designed, written


@NEEDS_CC
@pytest.mark.parametrize("kind", ["PID", "no compensator"])
def test_a_table_like_the_machine_settles_as_the_simulator_says(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wipe has the friction forget the random moves before; what the scale shows is not what is judged."""
    machine, controller = designed(kind)
    known = load_coefficients(written(kind, tmp_path), machine.drive.rated_thrust, machine.drive.offset)
    put(tmp_path, {**law_sources(known, "a test"), **loop_sources(known)})
    target = sequence(machine, known.stroke, periods=2)
    position = simulate(machine, controller, target).position
    simulated = max(
        settling_time(position[one.start : one.stop] - one.target, machine.specification.tolerance, known.sample_time)
        for one in motions(target)
        if one.start >= target.size // 2
    )
    off = on_tables(tmp_path, machine, known, 6, 3, lambda _: None)
    monkeypatch.setattr("studies.export.tables.perturbations", lambda _: {TOGETHER: Perturbed(Variation())})
    done: list[int] = []
    alike = on_tables(tmp_path, machine, known, 2, 3, done.append)
    assert done == [1, 2]
    assert alike["rows"][0]["slowest_s"] == pytest.approx(simulated, abs=1.01 * known.sample_time)
    assert alike["rows"][0]["share"] == (simulated <= machine.specification.settling_time)
    assert off["rows"][0]["slowest_s"] > alike["rows"][0]["slowest_s"]
    assert off["rows"][0]["low"] == interval(off["rows"][0]["hits"], 6)[0]
