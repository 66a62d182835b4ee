"""The trade-off as its user meets it: a front with certificates, limits that hold, a controller that others take."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.controller import default_controller
from design.family import family
from design.loop import assess
from design.pid.front import assessed_point
from design.pid.problem import Attempt, TuningError
from design.validation import validate
from models.controller import PID, load
from models.machine import Provenance
from models.machine import load as load_machine
from reports import text
from studies.command import DONE, main
from studies.deadbeat_design.__main__ import STUDY as DEADBEAT
from studies.pid_tradeoff.compute import _keeps_present, _settles_alone, _wanted, loop_curve, shown_levels
from studies.pid_tradeoff.options import TradeoffOptions
from studies.pid_tradeoff.refusal import refusal
from studies.pid_tradeoff.report import _gain, tell
from studies.pid_tradeoff.rows import summary
from tests.design.machines import far_side

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


def test_a_present_feedback_that_is_better_with_compensation_is_kept() -> None:
    """Sooner, and with a peak that was asked for, or as the only one of both in time."""
    machine = load_machine()
    law = default_controller(machine)
    quick, slow = validate(machine, law), validate(machine, law.without_compensation())
    assert quick.slowest.settling_time < machine.specification.settling_time < slow.slowest.settling_time
    present = assessed_point("present", machine.control.pid, family(machine, 0.05, 0.05, ()))
    assert _keeps_present(present, (quick, slow), present.ms, machine)
    assert _keeps_present(present, (quick, slow), 0.9 * present.ms, machine)
    assert not _keeps_present(present, (quick, quick), present.ms, machine)
    assert not _keeps_present(present, (slow, quick), present.ms, machine)
    patient = replace(machine, specification=replace(machine.specification, settling_time=1.0))
    assert _keeps_present(present, (quick, slow), present.ms, patient)
    assert not _keeps_present(present, (quick, slow), 0.9 * present.ms, patient)


@pytest.mark.parametrize(
    ("settles", "over_runs", "enough", "said"),
    [
        (24e-3, 24.5e-3, 1.6, "**Feedback alone is enough: at $M_s$ = 1.90"),
        (24e-3, 26e-3, 2.0, "**Not for certain: at $M_s$ = 1.60"),
        (None, None, 2.0, "**Not for certain: at $M_s$ = 1.60"),
        (30e-3, 31e-3, 2.5, "**Not enough: only at $M_s$ = 1.60"),
    ],
)
def test_whether_feedback_alone_is_enough_is_told_of_the_pid_that_is_written(
    settles: float | None, over_runs: float | None, enough: float, said: str, folder: Path
) -> None:
    """Another PID of the front that is in time is not the one that the recommendation gives the gains of."""
    whole = read(folder, "results.json")
    results, (other, *_) = whole["results"], whole["results"]["front"]
    chosen = results["chosen"]
    reversal = chosen["settling"]["reversal"] | {"single_s": settles, "quantile_s": over_runs}
    times = {key: value or math.inf for key, value in reversal.items() if key in {"single_s", "quantile_s"}}
    alone = _settles_alone({"settling": {"reversal": times}}, 25e-3)
    chosen = chosen | {"ms": 1.9, "settling_s": settles, "settling": chosen["settling"] | {"reversal": reversal}}
    results |= {"alone": alone, "chosen": chosen, "enough": other | {"ms": 1.6, "bound": enough}, "keep_present": False}
    report = tell(whole)
    page = text.fill(report.template, whole, {one.name: one.caption for one in report.figures}, report.filters)
    assert said in page
    assert f"| Median | longest of {results['present']['settling']['runs']} | Largest |" in page
    assert ("and keep the friction compensation" in page) != alone


def test_figures_over_ms_hold_every_point_and_bound() -> None:
    machine = load_machine()
    every = family(machine, 0.05, 0.05, ())[:1]
    gains = [replace(machine.control.pid, kp=factor * machine.control.pid.kp) for factor in (1.0, 3.0)]
    points = [assessed_point("present", pid, every) for pid in gains]
    points.append(replace(points[0], bound=1.1 * max(point.ms for point in points)))
    levels = shown_levels(points)
    assert max(point.ms for point in points) > 3.15
    assert levels[0] < min(point.ms for point in points)
    assert levels[-1] > max(point.bound or point.ms for point in points)


def test_nyquists_plot_holds_the_crossover_of_a_slow_loop() -> None:
    """One at 2 Hz comes nearest to -1 below 5 Hz."""
    member = family(load_machine(), 0.05, 0.05, ())[0]
    slow = PID(7e3, 1.5e4, 600.0, 5e-3)
    loop = assess(member.plant, slow)
    assert loop.crossover < 2 * math.pi * 3
    drawn = loop_curve(member, slow, 0.1 * loop.crossover)
    assert np.min(np.abs(1 + drawn)) == pytest.approx(1 / loop.ms.value, rel=0.02)


@pytest.mark.parametrize(
    ("time", "said"), [(0.03, "settles in 30 ms (in 20 ms if"), (math.inf, "reversal never settles (never settles if")]
)
def test_a_motion_that_never_settles_does_not_settle_in_never(time: float, said: str, folder: Path) -> None:
    results = read(folder, "results.json")["results"]
    margin = {"nearest_m": 1e-8, "less_m": 1e-8, "otherwise_s": time if math.isinf(time) else 0.02}
    row = {**results["present"], "settling_s": time, "settling": {"reversal": margin}}
    lines = summary({**results, "present": row, "chosen": row, "fastest": row})
    assert sum(said in text for _, text in lines) == 3


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


@pytest.mark.parametrize(("deviation", "covered"), [(1e-6, 0.1), (0.05, 0.15), (0.4, 0.49)])
def test_the_family_covers_what_the_file_knows_less_well_and_never_less_than_usual(
    deviation: float, covered: float
) -> None:
    machine = load_machine()
    rigid = machine.plant.rigid
    name, gain = f"plant.modes.{rigid + 1}.gain", machine.plant.modes[rigid].gain
    stated = machine.with_value(name, gain, Provenance("identified", "a record", std=deviation * gain))
    wanted = _wanted(stated, TradeoffOptions())
    assert (wanted["mode_error"], wanted["mass_error"]) == (0.03, pytest.approx(covered))
    assert _wanted(stated, TradeoffOptions(mass_error=0.02))["mass_error"] == 0.02


def test_a_mode_through_which_the_friction_does_work_is_the_reason_why_there_is_no_pid() -> None:
    """And neither the dead time nor a bound; the dead time is, where there is no such mode."""
    tried = (Attempt("present PID", "it keeps to the bounds, but a loop is unstable", None),)
    error = TuningError("no PID (tried); raise a bound, or take plants out of the family", tried, "no PID")
    table = load_machine()
    belt = far_side(table)
    told = refusal(replace(belt, plant=replace(belt.plant, dead_time=8e-3)), error, 3.0)
    assert told.startswith("no PID (present PID: it keeps to the bounds, but a loop is unstable); with the present")
    assert "the mode of negative gain at 38 Hz" in told
    assert "keep the present feedback and judge it by a record" in told
    assert "raise a bound" not in told
    assert "dead time" not in told
    late = refusal(replace(table, plant=replace(table.plant, dead_time=8e-3)), error, 3.0)
    assert late.startswith(str(error))
    assert late.endswith("shorten the dead time")


@pytest.mark.parametrize(
    ("gain", "shown"),
    [(5.174, "5.17"), (117.2, "117"), (0.05, "0.0500"), (3412.0, "$3.41\\cdot 10^{3}$"), (0.0, "0"), (None, "–")],
)
def test_a_gain_of_few_digits_is_written_out(gain: float | None, shown: str) -> None:
    assert _gain(gain) == shown
