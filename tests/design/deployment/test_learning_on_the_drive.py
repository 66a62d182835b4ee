"""The law that learns by itself, in a loop with the exported axis, and what of its numbers a file may not hold."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.controller import feedback_alone
from design.deadbeat import synthesise
from design.deployment.drive_file import controller_to_json
from design.deployment.plant_source import plant_sources
from design.trajectory.compensator import MotionProfile, motion_profile
from design.trajectory.learning import learned_tables, learning_to_json, sensitivities
from design.trajectory.schemes import Scheme, history_aware
from design.validation import sequence
from models.controller import ControllerError
from models.deployment.coefficients import Coefficients, load_coefficients
from models.deployment.running_law import LEARN, LEARNING, RESET, STEP, RunningLaw
from models.machine import Machine, load
from models.records.record import motions
from models.records.settling import settling_time
from models.variation import Variation, varied
from studies.command import to_text
from tests.design.deployment.compiling import NEEDS_CC, compiled, put
from tests.models.deployment.laws import LEARNING as SMALL
from tests.models.deployment.laws import content_of, written

STROKE = 20e-6
OFF = Variation(0.2, -0.2, mass=0.03, damping=0.4, dead_time=-0.15e-3, offset=2.0)
SHIM = """#include "axis_plant.h"
static axis_plant plant;
double start(void);
double start(void) { double u = axis_plant_start(); axis_plant_init(&plant, u); return u; }
double reading(void);
double reading(void) { return axis_plant_read(&plant, 0.0); }
void step(double command);
void step(double command) { axis_plant_step(&plant, command); }
double position(void);
double position(void) { return plant.x; }
"""


def designed(machine: Machine) -> tuple[Scheme, MotionProfile]:
    deadbeat = synthesise(machine.plant, machine.sample_time, 22e-3, STROKE)
    motion = motion_profile(machine.plant, machine.sample_time, deadbeat.thrust, STROKE)
    return history_aware(machine, motion), motion


def on_file(machine: Machine, scheme: Scheme, motion: MotionProfile, folder: Path) -> Coefficients:
    n_ff, d_ff, path_ff = (
        tuple((np.diff(signal, prepend=0.0) / STROKE).tolist())
        for signal in (motion.position, motion.net, motion.middle)
    )
    controller = replace(feedback_alone(machine), n_ff=n_ff, d_ff=d_ff, path_ff=path_ff)
    controller = replace(controller, friction_compensation=machine.friction)
    content = controller_to_json(machine, controller, STROKE, 22e-3)
    content["learning"] = learning_to_json(sensitivities(machine, scheme, STROKE), machine, scheme, STROKE)
    path = folder / "controller.json"
    path.write_text(to_text(content), encoding="utf-8")
    return load_coefficients(path, 0.0, 0.0)


def axis(machine: Machine, folder: Path) -> Any:
    """The exported axis as a library."""
    put(folder, {**plant_sources(machine), "shim.c": SHIM})
    flags = ("-O2", "-shared", "-fPIC", "-lm", "-Wno-conversion", "-Wno-unused-function")
    library = ctypes.CDLL(str(compiled(folder, ("axis_plant.c", "shim.c"), flags, "axis.so")))
    library.start.restype = library.reading.restype = library.position.restype = ctypes.c_double
    library.step.argtypes = [ctypes.c_double]
    return library


@NEEDS_CC
def test_an_axis_that_is_off_in_everything_settles_finely_after_the_law_has_learned(tmp_path: Path) -> None:
    """And learns what the design does from records of the same axis."""
    table = load()
    machine = replace(table, specification=replace(table.specification, interval=0.15))
    scheme, motion = designed(machine)
    known, true = on_file(machine, scheme, motion, tmp_path), varied(machine, OFF)
    assert known.learning is not None
    assert known.wipe is not None
    plant, law = axis(true, tmp_path / "axis"), RunningLaw(known)
    wipe = np.zeros(2 * (known.wipe.count + known.wipe.still) + known.delay)
    period, rounds = sequence(machine, STROKE, 1), known.learning.rounds
    target = np.concatenate([wipe, *(period,) * (rounds + 1)])
    found, status = np.empty(target.size), np.empty(target.size, np.int64)
    law.run([RESET, LEARN], [[0.0, plant.start()], [0.0, 0.0]])
    for k, wanted in enumerate(target.tolist()):
        thrust, flags = law.run([STEP], [[wanted, plant.reading()]])
        plant.step(float(thrust[0]))
        found[k], status[k] = plant.position(), flags[0]
    last, ended = found[-period.size :], np.flatnonzero(status & LEARNING)[-1]
    assert wipe.size + 1.9 * period.size < ended < wipe.size + 2 * period.size
    slowest = max(
        settling_time(last[one.start : one.stop] - one.target, 0.5e-6, machine.sample_time) for one in motions(period)
    )
    assert slowest <= 24e-3  # x_T* rests after 22 ms, the table up to 1.3 ms later
    (taught,) = learned_tables([true], machine, scheme, STROKE, 1)
    coulomb = machine.friction.coulomb_force
    assert law.learned.force == pytest.approx(taught.learned.friction.coulomb_force / coulomb, rel=0.03)
    assert law.learned.length == pytest.approx(taught.learned.friction.limit[0] / machine.friction.limit[0], rel=0.05)
    assert law.learned.offset == pytest.approx(taught.learned.offset, abs=0.02 * coulomb)
    assert law.learned.mass == pytest.approx(OFF.mass, abs=0.01)
    assert law.learned.dead_time == pytest.approx(OFF.dead_time, abs=20e-6)


def test_a_file_that_does_not_say_all_of_it_gives_a_law_that_does_not_learn(tmp_path: Path) -> None:
    path = written("PID", tmp_path)
    content = content_of(path)
    path.write_text(to_text({**content, "learning": {"motions": 22}}), encoding="utf-8")
    known = load_coefficients(path, 0.0, 0.0)
    assert known.learning is None
    _, status = RunningLaw(known).run([LEARN, STEP], np.zeros((2, 2)))
    assert not np.any(status)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("length_candidates", [0.5, 2.0], "1 among them"),
        ("faultless_error_m", [0.0], "equally long"),
        ("rest_s", 1e-3, "must last as long"),
        ("rounds", 0, "from 1 to 100"),
        ("mass_error_per_m", [], "finite numbers"),
        ("position_by_dead_time", {"per_s": [0.0, 1.0], "per_s2": [0.0]}, "two rows of equal length"),
    ],
)
def test_learning_that_no_drive_can_do_is_refused_in_a_sentence(
    key: str, value: object, says: str, tmp_path: Path
) -> None:
    path = written("PID", tmp_path)
    path.write_text(to_text({**content_of(path), "learning": {**SMALL, key: value}}), encoding="utf-8")
    with pytest.raises(ControllerError, match=says):
        load_coefficients(path, 0.0, 0.0)
