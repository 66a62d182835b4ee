"""The plant in C does what the simulator does, with every effect of the catalogue and one of one's own."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.deployment.hooks_in_c import HookError, in_c
from design.deployment.plant_source import plant_sources
from models.effects import catalogue
from models.effects.base import Effect, Numbers, Place
from models.effects.measured import Measured
from models.machine import Machine
from models.simulation.simulator import simulate
from tests.design.deployment.compiling import NEEDS_CC, compiled, put
from tests.models.deployment.laws import designed, motions
from tests.models.feedback.axis import axis

EFFECTS = sorted(name for name, kind in catalogue.every().items() if Place.CONTROL not in kind.hooks)


def library(machine: Machine, folder: Path) -> ctypes.CDLL:
    put(folder, plant_sources(machine))
    flags = ("-O2", "-shared", "-fPIC", "-Wno-unused-function", "-lm", "-Wno-conversion")
    found = ctypes.CDLL(str(compiled(folder, ["axis_plant.c"], flags, "plant.so")))
    found.axis_plant_start.restype = found.axis_plant_read.restype = ctypes.c_double
    found.axis_plant_read.argtypes = found.axis_plant_step.argtypes = found.axis_plant_init.argtypes = [
        ctypes.c_void_p,
        ctypes.c_double,
    ]
    return found


def readings(machine: Machine, commands: np.ndarray, folder: Path) -> np.ndarray:
    """What the scale shows in C over commands (n,) [N]."""
    plant, memory = library(machine, folder), ctypes.create_string_buffer(1 << 16)
    plant.axis_plant_init(memory, plant.axis_plant_start())
    shown = np.empty(commands.size)
    for k, command in enumerate(commands.tolist()):
        shown[k] = plant.axis_plant_read(memory, 0.0)
        plant.axis_plant_step(memory, command)
    return shown


def without_noise(machine: Machine, effects: Sequence[Effect] = ()) -> Machine:
    """Its scale exact, so that no rounding hides a difference."""
    return replace(machine, effects=tuple(effects), scale=replace(machine.scale, noise=0.0, resolution=0.0))


@NEEDS_CC
@pytest.mark.parametrize("kind", ["PID", "cascade"])
def test_on_equal_commands_the_plant_gives_the_simulator_s_bits(kind: str, tmp_path: Path) -> None:
    machine, controller = designed(kind)
    machine = without_noise(machine)
    record = simulate(machine, controller, motions(machine)).record
    assert np.array_equal(readings(machine, record.command, tmp_path), record.position)


@NEEDS_CC
def test_so_it_does_with_the_effects_of_the_catalogue(tmp_path: Path) -> None:
    """All in few machines, as each takes a compilation; those of one place in different ones."""
    machine, controller = designed("PID")
    kinds = [catalogue.every()[name] for name in EFFECTS]
    assert len(kinds) > 20
    for group in range(4):
        effects = catalogue.in_order([kind.typical() for kind in kinds[group::4]])
        one = without_noise(machine, effects)
        record = simulate(one, controller, motions(one, 4)).record
        found = readings(one, record.command, tmp_path / str(group))
        travel = float(np.ptp(record.position))
        assert found == pytest.approx(record.position, abs=1e-12 * travel), [one.name for one in effects]


@NEEDS_CC
def test_so_it_does_with_tables_of_measured_forces(tmp_path: Path) -> None:
    machine, controller = designed("PID")
    one = without_noise(
        machine,
        [
            Measured("position", (-1e-5, 0.0, 2e-5), (0.3, 0.6, 0.3), "directional"),
            Measured("path", (0.0, 1e-5, 5e-5), (0.0, 0.5, 0.2), turn=3e-7),
            Measured("speed", (0.0, 1e-3, 1e-2), (0.0, -0.2, -0.3), "odd"),
        ],
    )
    record = simulate(one, controller, motions(one, 4)).record
    found = readings(one, record.command, tmp_path)
    assert found == pytest.approx(record.position, abs=1e-12 * float(np.ptp(record.position)))


def test_effects_of_the_controller_are_left_out_and_named() -> None:
    machine, _ = designed("PID")
    kind = next(kind for kind in catalogue.every().values() if Place.CONTROL in kind.hooks)
    source = plant_sources(replace(machine, effects=(kind.typical(),)))["axis_plant.h"]
    assert f"Not in it: {kind.name}" in source


@NEEDS_CC
def test_damping_within_the_contacts_and_a_dead_time_of_whole_samples(tmp_path: Path) -> None:
    machine = without_noise(axis())
    machine = replace(
        machine,
        friction=replace(machine.friction, damping=(50.0, 0.0)),
        plant=replace(machine.plant, dead_time=2 * machine.sample_time),
    )
    _, controller = designed("cascade")
    record = simulate(machine, controller, motions(machine, 4)).record
    assert readings(machine, record.command, tmp_path) == pytest.approx(record.position, abs=1e-18)


STRENGTH = 2.5


def _bowed(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value + sum(p[0] + now[0] + memory[0] + contact[0, 0] for _ in range(3))


def _endless(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    while value > 0:
        value = value - p[0] - now[0] - memory[0] - contact[0, 0]
    return value


@NEEDS_CC
def test_a_hook_of_one_s_own_is_translated(tmp_path: Path) -> None:
    text = (
        "#include <math.h>\ntypedef double element_row[3];\n"
        "double larger(double a, double b) { return a > b ? a : b; }\n"
        "double smaller(double a, double b) { return a < b ? a : b; }\ndouble square(double a) { return a * a; }\n"
        + in_c("hook", _own, 6).replace("static double hook", "double hook", 1)
    )
    put(tmp_path, {"hook.c": text})
    flags = ("-O2", "-shared", "-fPIC", "-lm", "-Wno-missing-prototypes", "-Wno-conversion")
    hook = ctypes.CDLL(str(compiled(tmp_path, ["hook.c"], flags, "hook.so"))).hook
    hook.restype, numbers = ctypes.c_double, ctypes.POINTER(ctypes.c_double)
    hook.argtypes = [ctypes.c_double, *[numbers] * 4]
    rng = np.random.default_rng(0)
    for _ in range(50):
        p, now, memory, contact = rng.normal(size=2), rng.normal(size=8), rng.normal(size=6), rng.normal(size=(3, 3))
        kept, value = memory.copy(), float(rng.normal())
        expected = _own(value, p, now, kept, contact)  # type: ignore[arg-type]
        given = [one.ctypes.data_as(numbers) for one in (p, now, memory, contact)]
        assert hook(value, *given) == pytest.approx(expected, rel=1e-15)
        assert memory == pytest.approx(kept, rel=1e-15)


def _own(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    """A hook of one's own: a loop, choices, both kinds of numbers and an exchange."""
    total, count = 0.0, memory.size // 2
    for i in range(1, count):
        total += memory[i] * (i + 1)
    if not (now[1] > 0.0 and total >= 0.0) or p[0] == 1.0:
        total = -total / STRENGTH
    else:
        total = math.hypot(total, contact[0, 1])
    memory[0], memory[1] = memory[1], total
    return value + max(total, min(p[0], 3.0) ** 3)


@pytest.mark.parametrize("hook", [_endless, _bowed])
def test_what_has_no_translation_is_refused_by_name(hook: object) -> None:
    with pytest.raises(HookError, match="has no translation into C"):
        in_c("hook", hook, 2)  # type: ignore[arg-type]
