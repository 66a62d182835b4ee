"""The trade-off as its user meets it: a front with certificates, limits that hold, a controller that others take."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.family import Member
from design.loop import frequency_response, pid_response, spectral_radius
from models.controller import PID, load
from models.friction import branch
from models.machine import load as load_machine
from models.plant import Mode, Plant, sampled
from studies.command import DONE, main
from studies.deadbeat_design.__main__ import STUDY as DEADBEAT
from studies.pid_tradeoff.__main__ import STUDY
from studies.pid_tradeoff.front import Point, between_samples, nearest, step_error
from studies.pid_tradeoff.limits import bode_area, highest_crossover, least_sensitivity

TS = 5e-4


@pytest.fixture(scope="module")
def folder(quick_run: Callable[[str], tuple[Path, int]]) -> Path:
    """What one quick run wrote."""
    output, status = quick_run("pid_tradeoff")
    assert status == DONE
    return output


def read(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text(encoding="utf-8"))


def test_everything_is_written_and_every_check_holds(folder: Path) -> None:
    names = {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}
    assert names >= {"report.html", "report.pdf", "results.json", "manifest.json", "controller.json"}
    checks = read(folder, "results.json")["checks"]
    assert len(checks) >= 7
    assert all(check["holds"] for check in checks)


def test_the_front_trades_stability_for_suppression(folder: Path) -> None:
    results = read(folder, "results.json")["results"]
    front = results["front"]
    assert len(front) >= 4
    gains = [row["ki_N_per_ms"] for row in front]
    assert gains == sorted(gains)
    settling = [row["settling_s"] or math.inf for row in front]
    assert settling == sorted(settling, reverse=True)
    for row in front:
        assert row["ms"] == pytest.approx(row["bound"], rel=2e-4)
        assert row["phase_margin_deg"] >= math.degrees(2 * math.asin(1 / (2 * row["ms"]))) - 0.1
    for row in results["rules"]:  # nothing that keeps the same bounds lies beyond the front
        within = [other for other in front if other["ms"] >= row["ms"] and other["mt"] >= row["mt"]]
        if within and row["mcs_N_per_m"] <= results["wanted"]["mcs_N_per_m"]:
            assert row["ki_N_per_ms"] <= within[0]["ki_N_per_ms"]


def test_no_point_passes_the_limits(folder: Path) -> None:
    results = read(folder, "results.json")["results"]
    limits = results["limits"]
    for row in (*results["front"], results["present"]):
        assert row["crossover_Hz"] <= np.interp(row["ms"], limits["ms"], limits["crossover_Hz"])
    assert np.all(np.array(limits["suppressed_Hz"]) < np.array(limits["allowed_Hz"]))


def test_the_controller_is_taken_by_another_study(folder: Path, tmp_path: Path) -> None:
    controller = load(folder / "controller.json")
    arguments = ["--quick", "--no-report", "--controller", str(folder / "controller.json"), "--output", str(tmp_path)]
    main(DEADBEAT, arguments)
    assert load(tmp_path / "controller.json").pid == controller.pid
    chosen = read(folder, "results.json")["results"]["chosen"]
    assert chosen["ki_N_per_ms"] == controller.pid.ki
    reversal = next(m for m in read(tmp_path, "results.json")["results"]["without"]["motions"] if m["reversal"])
    assert reversal["settling_s"] == pytest.approx(chosen["settling_s"], abs=2 * TS)


def test_the_same_inputs_give_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    assert main(STUDY, ["--quick", "--no-report", "--output", str(tmp_path)]) == DONE
    assert (tmp_path / "results.json").read_bytes() == (folder / "results.json").read_bytes()


@pytest.mark.parametrize("dead_time", [1e-3, 1.3e-3])
def test_the_dead_times_limit_is_the_closed_form_for_a_rigid_body(dead_time: float) -> None:
    """Phase -180 degrees - omega (L + T_s / 2) + 90 degrees - omega T_s / 2: omega (L + T_s) = 90 degrees - margin."""
    rigid = Plant(dead_time, 1.0, (Mode(1 / 45, 0.0, 0.0),))
    expected = (math.pi / 2 - 2 * math.asin(1 / 4)) / (dead_time + TS)
    assert highest_crossover(rigid, TS, 2.0)[0] == pytest.approx(expected, rel=3e-3)


def test_no_pid_of_many_crosses_over_above_the_limit() -> None:
    plant = load_machine().plant
    model, omega = sampled(plant, TS), np.linspace(0.001, 0.5, 3000) * math.pi / TS
    response, rng = frequency_response(model, omega), np.random.default_rng(2)
    levels: list[float] = []
    found: list[float] = []
    for _ in range(300):
        kp, ki, kd, tau = (10 ** rng.uniform(*ends) for ends in ((5, 6.7), (6, 8.5), (3.5, 4.6), (-5, -3.3)))
        loop = response * pid_response(PID(kp, ki, kd, tau), TS, omega)
        ms = float(np.max(1 / np.abs(1 + loop)))
        crossings = omega[:-1][(np.abs(loop[:-1]) >= 1) & (np.abs(loop[1:]) < 1)]
        if 1 < ms < 4 and crossings.size and spectral_radius(model, PID(kp, ki, kd, tau)) < 1:
            levels.append(ms)
            found.append(crossings[-1])
    assert len(found) > 10
    assert np.all(np.array(found) <= highest_crossover(plant, TS, levels) * 1.001)


def test_bodes_integral_is_zero_and_its_allowance_a_bound() -> None:
    machine = load_machine()
    member = Member("P_l", sampled(machine.plant, TS))
    area = bode_area(member, machine.control.pid, 2.5, 4e7)
    assert area.suppressed == pytest.approx(area.amplified, rel=0.01)
    assert area.amplified < area.allowed
    assert least_sensitivity(np.array([0j, 1e-8 + 0j, 1e-6 + 0j]), 4e7) == pytest.approx([1.0, 0.6, 0.0])


def test_between_the_samples_the_path_passes_through_the_samples() -> None:
    machine = load_machine()
    _, path, samples = between_samples(machine, machine.control.pid, 8e5, 7, 0.05)
    assert path[::7] == pytest.approx(samples)
    member = Member("P_e1", sampled(machine.plant, TS, 8e5))
    force = float(branch(machine.friction, machine.specification.stroke))
    expected = force * step_error(member, machine.control.pid, TS)  # by the closed loop's matrices, from sample 1 on
    assert np.abs(samples[1:4]) == pytest.approx(expected[:3])


def test_the_ensembles_counts_are_those_of_its_members(folder: Path) -> None:
    """On machines that the PID was not tuned for; the one tuned for all keeps its bound on every one."""
    ensemble = read(folder, "results.json")["results"]["ensemble"]
    rows = {row["name"]: row for row in ensemble["rows"]}
    count, bound = len(ensemble["members"]), ensemble["ms_bound"]
    assert count >= 5
    assert rows["all members"]["within"] == count
    for row in rows.values():
        assert len(row["ms"]) == len(row["settling_s"]) == count
        assert row["within"] == sum(ms is not None and ms <= bound * (1 + 2e-4) for ms in row["ms"])
        pairs = zip(row["settling_s"], rows["own"]["settling_s"], strict=True)
        assert row["faster"] == sum((here or math.inf) < (own or math.inf) for here, own in pairs)
        assert row["stable"] == sum(ms is not None for ms in row["ms"])
    assert rows["own"]["faster"] == 0


def test_a_bound_without_a_pid_is_answered_by_the_next_stricter_one_or_else_the_first() -> None:
    points = [Point(f"{bound}", PID(1.0, 1.0, 0.0, 0.0), (), bound) for bound in (1.4, 1.8, 2.4)]
    assert [nearest(points, ms).bound for ms in (1.8, 2.0, 3.0, 1.2)] == [1.8, 1.8, 2.4, 1.4]
