"""The plants that a loop has to hold are those of the machine with its effects, by closed forms of another package."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.family import DEVIATIONS, MASS_ERROR, family, largest_pole, linear, slopes, usual_errors, with_effects
from design.loop import assess, frequency_response
from design.pid.rules import slow_rule
from design.pid.tuning import tune_pid
from models.effects.base import Effect
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging, CurrentLoopLag
from models.effects.structure import AdditionalMode, CableSpring
from models.identification import modes
from models.machine import Provenance, load
from models.plant import Mode

MACHINE = load()
LAG = CurrentLoopLag(0.4e-3)
ADDED = AdditionalMode(0.0008, 190.0, 0.01)
EFFECTS: tuple[Effect, ...] = (LAG, ViscousFriction(60.0), CableSpring(900.0), ADDED, Cogging(2.0, 0.03, 0.0))


def test_a_member_s_response_is_that_of_the_machine_with_its_effects() -> None:
    machine = replace(MACHINE, effects=EFFECTS)
    plant = replace(MACHINE.plant, modes=(*MACHINE.plant.modes, Mode(0.0008, 190.0, 0.01)))
    f, ts = np.array([0.3, 5.0, 38.0, 120.0, 190.0, 450.0]), MACHINE.sample_time
    for name, slope in slopes(machine).items():
        member = next(one for one in family(machine) if one.name == name)
        expected = modes.model(plant, f, ts, lag=0.4e-3, drag=60.0, spring=900.0 + slope)
        assert np.abs(frequency_response(member.plant, 2 * np.pi * f) / expected - 1) == pytest.approx(0.0, abs=1e-6)


def test_every_member_has_the_lag_also_of_a_machine_that_could_be_this_one() -> None:
    other = replace(MACHINE, name="other", effects=(CurrentLoopLag(0.8e-3),))
    plain, lagging = (family(one, others=(other,)) for one in (MACHINE, replace(MACHINE, effects=(LAG,))))
    omega = np.array([2 * np.pi * 150.0])
    late = [
        float(np.angle(frequency_response(b.plant, omega)[0] / frequency_response(a.plant, omega)[0]))
        for a, b in zip(plain, lagging, strict=True)
    ]
    own = [one for one, member in zip(late, plain, strict=True) if " of other" not in member.name]
    assert own == pytest.approx([-np.arctan(150.0 * 2 * np.pi * 0.4e-3)] * len(own), abs=0.02)
    others = [one for one, member in zip(late, plain, strict=True) if " of other" in member.name]
    assert others == pytest.approx([0.0] * 4, abs=1e-12)


def test_without_effects_the_plant_is_the_machine_s() -> None:
    assert linear(MACHINE).plant == linear(MACHINE).late == MACHINE.plant


def test_a_pid_is_tuned_for_the_lag() -> None:
    """Tuned without it, it has |S| beyond the bound on the plant that has it."""
    lagging = replace(MACHINE, effects=(CurrentLoopLag(0.2e-3),))
    found, blind = (tune_pid(one, ms=2.0, mode_error=0, mass_error=0) for one in (lagging, MACHINE))
    assert max(assess(with_effects(lagging, slope=k), blind.pid).ms.value for k in slopes(MACHINE).values()) > 2.1
    assert found.ms < 2.001
    assert found.pid.ki < 0.9 * blind.pid.ki
    ts, f = MACHINE.sample_time, np.geomspace(5.0, 990.0, 4000)
    z = np.exp(2j * np.pi * f * ts)
    pid, keep = found.pid, found.pid.pole(ts)
    law = pid.kp + pid.ki * ts / (1 - 1 / z) + pid.kd * (1 - keep) / ts * (1 - 1 / z) / (1 - keep / z)
    for slope in slopes(MACHINE).values():
        loop = modes.model(MACHINE.plant, f, ts, lag=0.2e-3, spring=slope) * law
        assert np.max(np.abs(1 / (1 + loop))) < 2.01


def test_a_loop_that_the_lag_makes_unstable_is_one() -> None:
    late = replace(MACHINE, effects=(CurrentLoopLag(10e-3),))
    assert largest_pole(MACHINE, MACHINE.control.pid) < 1 < largest_pole(late, MACHINE.control.pid)
    assert slow_rule(late).kp < 0.5 * slow_rule(MACHINE).kp


def test_a_mass_error_covers_what_is_stated_of_gain_and_thrust_constant() -> None:
    """A loop's gain is their product."""
    machine = load()
    rigid = f"plant.modes.{machine.plant.rigid + 1}.gain"
    names = {rigid: 0.04 * machine.plant.modes[machine.plant.rigid].gain, "plant.thrust_constant": 0.03}
    said = {name: Provenance("identified", "a record", std=std) for name, std in names.items()}
    stated = replace(machine, sources={**machine.sources, **said})
    assert usual_errors(stated)[1] == pytest.approx(DEVIATIONS * 0.05)
    assert usual_errors(machine)[1] == MASS_ERROR
