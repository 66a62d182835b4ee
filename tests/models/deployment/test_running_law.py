"""The law as a drive runs it is the one that is simulated, holds its promises at the edges, and needs no compiler."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.deployment.vectors import golden
from design.validation import respond, sequence
from design.wiping import carried_on, wipe, wipe_references
from models.controller import compensator_path, references
from models.deployment.coefficients import Coefficients, coefficients, load_coefficients
from models.deployment.running_law import LIMITED, READING_MISSING, STEP, TARGET_MISSING, WIPE, WIPING, RunningLaw
from models.machine import load
from models.simulation.simulator import simulate
from tests.models.deployment.laws import KINDS, designed, motions, written


def steps(law: RunningLaw, target: np.ndarray, reading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return law.run(np.full(target.size, STEP), np.column_stack([target, reading]))


def known_of(kind: str, folder: Path) -> Coefficients:
    return load_coefficients(written(kind, folder), math.nan, math.nan)


@pytest.mark.parametrize("kind", KINDS)
def test_from_its_file_alone_the_law_puts_out_what_the_simulated_controller_does(kind: str, tmp_path: Path) -> None:
    machine, controller = designed(kind)
    target = motions(machine)
    record = simulate(machine, controller, target, seed=1).record
    known = known_of(kind, tmp_path)
    law = RunningLaw(known)
    thrust, status = steps(law, target, record.position)
    limit = machine.drive.rated_thrust
    if kind == "without an integral":
        assert known.start == machine.drive.offset  # which it cannot hold, as the simulated one
    assert thrust == pytest.approx(np.clip(record.command, -limit, limit), abs=1e-9 * limit)
    assert set(np.unique(status)) <= {0, LIMITED}
    assert np.max(np.abs(thrust)) > 0.02 * limit


@pytest.mark.parametrize("kind", ["PID", "filters and anti-windup"])
def test_nothing_changes_far_from_zero_beyond_the_rounding_of_the_readings(kind: str, tmp_path: Path) -> None:
    machine, controller = designed(kind)
    known, target = known_of(kind, tmp_path), motions(machine)
    reading = simulate(machine, controller, target, seed=1).record.position
    here, there = RunningLaw(known), RunningLaw(known)
    there.reset(0.25, known.start)
    away, _ = steps(there, target + 0.25, reading + 0.25)
    assert away == pytest.approx(steps(here, target, reading)[0], abs=1e-6 * known.thrust_limit)


def test_the_compensator_can_follow_a_path_of_its_own() -> None:
    """As trajectory_optimisation's does, which is led through the middles of the intervals."""
    machine, controller = designed("PID")
    late = (0.0, *controller.n_ff)
    known = coefficients(replace(controller, path_ff=late), 20e-6, 1e9)
    target, rfm = motions(machine), controller.friction_compensation
    wanted = references(replace(controller, n_ff=late, d_ff=(0.0,), path_ff=None), target).compensation
    bare = coefficients(controller.without_compensation(), 20e-6, 1e9)
    assert rfm is not None
    reading = np.zeros(target.size)
    difference = steps(RunningLaw(known), target, reading)[0] - steps(RunningLaw(bare), target, reading)[0]
    assert difference == pytest.approx(wanted, abs=1e-7)


def test_after_a_wipe_the_compensator_goes_on_without_a_bump(tmp_path: Path) -> None:
    machine, controller = designed("PID")
    known = known_of("PID", tmp_path)
    given, rests = wipe_references(machine, wipe(machine))
    start = np.array(machine.friction.limit) * 0.7
    (wiped,) = respond([machine], controller, given.position, given=given, seed=3, initial_friction=[start])
    law = RunningLaw(known)
    held = float(np.dot(machine.friction.stiffness, start))
    law.reset(0.0, held)
    law.run([WIPE], [[0.0, 0.0]])
    thrust, status = steps(law, np.zeros(given.position.size), wiped.record.position)
    assert np.all(status == WIPING)
    assert thrust == pytest.approx(wiped.record.command, abs=1e-2)  # the simulated reference waits at its first value
    assert abs(thrust[rests[1]] - held) > 1.0  # the friction stands elsewhere now, and the integral holds it
    target, rfm = sequence(machine, 20e-6, 1), controller.friction_compensation
    assert rfm is not None
    virgin = references(controller, target)
    wanted = carried_on(rfm, given.position, compensator_path(controller, target), virgin)
    (went_on,) = respond([machine], controller, target, given=wanted, seed=4, initial_friction=[wiped.elements])
    after, flags = steps(law, target, went_on.record.position)
    assert not np.any(flags & WIPING)
    again = went_on.record.command - held  # the simulation starts its integral at the elements' force anew
    assert np.diff(after) == pytest.approx(np.diff(again), abs=2e-2)


def test_what_is_not_a_number_is_taken_as_at_the_sample_before(tmp_path: Path) -> None:
    known = known_of("PID", tmp_path)
    target, reading = np.full(30, 20e-6), np.linspace(0, 20e-6, 30)
    broken_target, broken_reading = target.copy(), reading.copy()
    broken_target[[3, 7]], broken_reading[[5, 7]] = math.nan, (math.inf, -2e6)
    kept_reading = reading.copy()
    kept_reading[5], kept_reading[7] = reading[4], reading[6]
    thrust, status = steps(RunningLaw(known), broken_target, broken_reading)
    assert thrust == pytest.approx(steps(RunningLaw(known), target, kept_reading)[0], abs=0)
    assert status[3] & ~LIMITED == TARGET_MISSING
    assert status[5] & ~LIMITED == READING_MISSING
    assert status[7] & ~LIMITED == TARGET_MISSING | READING_MISSING


def test_the_anti_windup_ends_what_a_long_stroke_begins(tmp_path: Path) -> None:
    """Three strokes that the table does not follow saturate; the integral then runs away unless it is taken back."""
    path, last, limited = written("PID", tmp_path), {}, {}
    machine, _ = designed("PID")
    for time in (0.0, 5e-3):
        law = RunningLaw(load_coefficients(path, 0.0, 0.0, anti_windup=time))
        _, limited[time] = steps(law, np.full(200, 60e-6), np.zeros(200))
        thrust, _ = steps(law, np.full(60, 60e-6), np.full(60, 60e-6))
        last[time] = np.abs(thrust[-1])
    assert last[0.0] == machine.drive.rated_thrust
    assert last[5e-3] < 0.98 * machine.drive.rated_thrust
    assert all(status[-1] == LIMITED for status in limited.values())


def test_older_files_take_the_machine_s_rating_and_start(tmp_path: Path) -> None:
    path = written("PID", tmp_path)
    text = path.read_text(encoding="utf-8").replace("thrust_limit_N", "other").replace('"start"', '"begin"')
    path.write_text(text, encoding="utf-8")
    known = load_coefficients(path, 77.0, 3.0)
    assert (known.thrust_limit, known.start) == (77.0, 3.0)


def test_compiled_and_uncompiled_give_the_same_bits(tmp_path: Path) -> None:
    path = written("PID", tmp_path)
    script = (
        "import sys; from pathlib import Path\n"
        "from design.deployment.vectors import golden\n"
        "from models.deployment.coefficients import load_coefficients\n"
        "found = golden(load_coefficients(Path(sys.argv[1]), 0.0, 0.0), 0)\n"
        "print(found.thrust.tobytes().hex(), found.status.tobytes().hex())\n"
    )
    plain = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    found = golden(load_coefficients(path, 0.0, 0.0), 0)
    assert plain == [found.thrust.tobytes().hex(), found.status.tobytes().hex()]
    assert load().name
