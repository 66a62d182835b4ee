"""A spring to ground, stated or not, is no friction, nor a lag of the current loop: of a table and of a small stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import chirp

from models.controller import PID
from models.effects.base import Effect
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging, ThrustRipple
from models.effects.structure import CableSpring
from models.friction import elements
from models.identification.force.fit import SPRING
from models.identification.force.stated import along_the_path, left_out
from models.identification.joint.steps import Identified
from models.identification.modal.remarks import ResponseStep
from models.identification.modes import LAG
from models.identification.pipeline import identify
from models.machine import Machine, Provenance, load
from models.plant import Mode, Plant
from models.records.files import Loaded
from models.records.record import Record
from studies.identify_machine import own_records

TABLE = own_records.another(own_records.noisy(load()), 5)
LIMIT = np.array([0.25e-6, 1e-6, 4e-6])
# A voice coil's stage of 0.3 kg at 10 kHz with 0.4 N of friction, which turns round within 8 um.
STAGE = replace(
    TABLE,
    plant=Plant(85e-6, 1.0, (Mode(3.2, 0.0, 0.0), Mode(0.39, 640.0, 0.015))),
    friction=elements(np.array([0.2, 0.12, 0.08]) / LIMIT, LIMIT),
    scale=replace(TABLE.scale, resolution=0.5e-9, noise=0.3e-9),
    drive=replace(TABLE.drive, rated_thrust=14.0, offset=0.01),
    control=replace(TABLE.control, sample_time=1e-4, pid=PID(49500.0, 3.5e6, 163.0, 50e-6)),
)  # fmt: skip
SPRINGS = {"table": (TABLE, 4000.0), "stage": (STAGE, 600.0)}  # N/m: some per cent of the friction over the loops


def slow_loops(machine: Machine) -> Record:
    """Loops over 2.5 times the longest element either way, at a speed at which it slips within 50 ms; SI."""
    if machine.control.sample_time == TABLE.control.sample_time:
        return own_records.hysteresis(machine, 5)
    t = np.arange(round(1.6 / machine.sample_time)) * machine.sample_time
    wide = 3.0 * max(machine.friction.limit)
    path = np.where(t < 0.8, wide * np.sin(2 * np.pi * t / 0.4), 0.4 * wide * np.sin(2 * np.pi * (t - 0.8) / 0.2))
    return own_records.run(machine, np.asarray(path, float), np.zeros(t.size), 5)


@cache
def found(name: str, stated: bool) -> tuple[Machine, Identified]:
    """The true machine on its spring, and what its slow loops show beside a file that states the spring or not."""
    machine, stiffness = SPRINGS[name]
    true = replace(machine, effects=(CableSpring(stiffness),))
    record = Loaded("slow.csv", "12ab", slow_loops(true), (), ())
    return true, identify(true if stated else machine, [record], kinds=["hysteresis"])


@cache
def without(name: str) -> Identified:
    """What the loops of the same machine show where no spring pulls."""
    machine, _ = SPRINGS[name]
    return identify(machine, [Loaded("slow.csv", "", slow_loops(machine), (), ())], kinds=["hysteresis"])


@pytest.mark.parametrize("name", SPRINGS)
@pytest.mark.parametrize("stated", [True, False])
def test_the_friction_is_the_true_one_and_no_element_stands_for_the_spring(name: str, stated: bool) -> None:
    true, answer = found(name, stated)
    friction, estimate = answer.machine.friction, next(iter(answer.estimates.values()))
    assert len(friction.limit) == len(true.friction.limit)
    wanted = np.array([*true.friction.stiffness, *true.friction.limit])
    last = slice(-wanted.size, None)
    # The low-pass shifts the stage's quick, quiet loops by 0.04 % already without a spring, by 6 of its deviations.
    own = np.abs(without(name).estimates["slow.csv"].values[last] - wanted)
    assert np.max((np.abs(estimate.values[last] - wanted) - own) / estimate.deviations[last]) < 3
    assert np.max(own / wanted) < 0.02
    assert (SPRING in estimate.names) is not stated
    (spring,) = answer.machine.effects
    source = answer.machine.sources.get("effects.cable_spring.stiffness", Provenance("assumed", ""))
    if stated:
        assert spring == true.effects[0]
        assert source.kind != "identified"
        assert any("cable_spring of the machine file" in remark for remark in answer.remarks)
    else:
        assert abs(spring.values()[0] - true.effects[0].values()[0]) < 4 * estimate.deviation(SPRING)
        assert estimate.deviation(SPRING) < 0.1 * spring.values()[0]
        assert (source.kind, source.record, source.std) == ("identified", "slow.csv", estimate.deviation(SPRING))
        assert any("in proportion to the position" in remark for remark in answer.remarks)


@pytest.mark.parametrize("name", SPRINGS)
def test_an_axis_without_a_spring_is_given_none(name: str) -> None:
    assert without(name).machine.effects == ()


def test_loops_too_narrow_to_tell_a_spring_from_a_longer_element_say_so() -> None:
    """Loops of half the longest element's limit either way: what rises throughout may be that element."""
    t = np.arange(round(0.8 / STAGE.sample_time)) * STAGE.sample_time
    path = 0.5 * max(STAGE.friction.limit) * np.sin(2 * np.pi * t / 0.4)
    record = own_records.run(STAGE, path, np.zeros(t.size), 5)
    answer = identify(STAGE, [Loaded("slow.csv", "", record, (), ())], kinds=["hysteresis"])
    assert answer.machine.effects == ()
    assert any("or a spring to ground pulls" in remark for remark in answer.remarks)


@pytest.mark.parametrize(
    "effects",
    [(Cogging(0.4, 150e-6, 1.0),), (ThrustRipple(0.05, 100e-6, 0.3), CableSpring(4000.0))],
)  # fmt: skip
def test_every_stated_effect_along_the_path_is_taken_off(effects: Sequence[Effect]) -> None:
    """Of periods that the loops pass more than once, which elements would otherwise stand for."""
    true = replace(TABLE, effects=tuple(effects))
    assert along_the_path(true) == true.effects
    assert left_out(true) == ()
    record = Loaded("slow.csv", "", slow_loops(true), (), ())
    stated, unknown = (identify(machine, [record], kinds=["hysteresis"]) for machine in (true, TABLE))
    wanted = np.array([*true.friction.stiffness, *true.friction.limit])
    estimate = stated.estimates["slow.csv"]
    assert len(stated.machine.friction.limit) == len(true.friction.limit)
    assert np.max(np.abs(estimate.values[-wanted.size :] - wanted) / estimate.deviations[-wanted.size :]) < 4
    errors = [float(np.std(one.slow.measured - one.slow.modelled)) for one in (stated, unknown) if one.slow]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("stated", [True, False])
def test_a_response_of_an_axis_on_a_spring_shows_the_spring_and_no_lag(stated: bool) -> None:
    true = replace(TABLE, effects=(CableSpring(200.0),))
    record = Loaded("excited.csv", "12ab", own_records.excitation(true, 5), (), ())
    answer = identify(true if stated else TABLE, [record], kinds=["excitation"])
    estimate = answer.estimates["excited.csv"]
    (spring,) = answer.machine.effects
    assert spring.name == CableSpring.name
    assert (SPRING in estimate.names) is not stated
    if not stated:
        assert abs(spring.values()[0] - 200.0) < 4 * estimate.deviation(SPRING)
    gain = 1 / true.plant.mass
    assert abs(estimate.value("rigid body gain") - gain) < 4 * estimate.deviation("rigid body gain")
    assert abs(estimate.value("dead time") - true.plant.dead_time) < 4 * estimate.deviation("dead time")
    step = answer.steps[0].gave
    assert isinstance(step, ResponseStep)
    assert answer.misfit(step) < 1.5


def swept(*stiffness: float) -> Identified:
    """What excitations of the table show while springs of these stiffnesses [N/m] pull, one in each."""
    machines = [replace(TABLE, effects=(CableSpring(one),)) for one in stiffness]
    sweeps = [Loaded(f"{i}.csv", "", own_records.excitation(one, 5), (), ()) for i, one in enumerate(machines)]
    return identify(TABLE, sweeps, kinds=["excitation"] * len(sweeps))


@pytest.mark.parametrize(
    ("stiffness", "entered"), [((200.0, 600.0), False), ((200.0, 220.0), True), ((200.0, 220.0, 210.0), True)]
)
def test_a_spring_that_differs_much_from_sweep_to_sweep_is_none_to_ground(
    stiffness: tuple[float, ...], entered: bool
) -> None:
    """A user's rotary axis showed 0.2674 and 0.6599 N m/rad, which were its cogging and its weight: the file had had
    0.53 +- 0.26 N m/rad, 39 % of the friction a quarter of a turn on. Nor may such springs move the mass: that of both
    sweeps together had been 0.55 and 0.96 of the true one."""
    both = swept(*stiffness)
    assert both.machine.plant.mass == pytest.approx(TABLE.plant.mass, rel=2e-3)
    springs = [one.values()[0] for one in both.machine.effects if one.name == CableSpring.name]
    assert springs == (pytest.approx([210.0], rel=1e-3) if entered else [])
    told = "No spring to ground is entered in the machine file: the responses show 200 N/m and 600 N/m."
    assert any(told in one for one in both.remarks) is not entered


def test_where_the_file_has_what_pulls_along_the_way_a_sweep_adds_no_spring() -> None:
    """Which would count twice: within the travel of a sweep nothing tells the two from each other."""
    stated = replace(TABLE, effects=(Cogging(0.5, 0.02, 0.0),))
    sweep = Loaded("sweep.csv", "", own_records.excitation(replace(TABLE, effects=(CableSpring(200.0),)), 5), (), ())
    answer = identify(stated, [sweep], kinds=["excitation"])
    assert answer.machine.effects == stated.effects
    assert any("it has cogging, which may pull so" in one for one in answer.remarks)
    step = answer.steps[0].gave
    assert isinstance(step, ResponseStep)
    assert answer.misfit(step) < 1.5


def rolling_sweep(true: Machine) -> Record:
    """A sweep to 2 kHz while the stage rolls."""
    ts = STAGE.sample_time
    sweep = 0.2 * chirp(np.arange(round(2 / ts)) * ts, 200, 2, 2000, method="logarithmic", phi=-90)
    force = np.concatenate([np.zeros(round(0.2 / ts)), sweep])
    return own_records.run(true, 1.0137e-3 * ts * np.arange(force.size, dtype=float), np.asarray(force, float), 1)


@pytest.mark.parametrize("stated", [True, False])
def test_one_sweep_while_a_small_stage_rolls_tells_its_spring_from_a_lag(stated: bool) -> None:
    """Its lines are far above the spring's own frequency: what tells is that the command rises along the way."""
    true = replace(STAGE, effects=(CableSpring(180.0),))
    sweep = Loaded("sweep.csv", "", rolling_sweep(true), (), ())
    answer = identify(true if stated else STAGE, [sweep], kinds=["excitation"])
    estimate, step = answer.estimates["sweep.csv"], answer.steps[0].gave
    truth = {"rigid body gain": 3.2, "dead time": 85e-6, "mode 2 frequency": 640.0} | (
        {} if stated else {SPRING: 180.0}
    )
    for name, value in truth.items():
        assert abs(estimate.value(name) - value) < 4 * estimate.deviation(name), name
    assert LAG not in estimate.names
    assert isinstance(step, ResponseStep)
    assert answer.misfit(step) < 1.5


def test_a_sweep_keeps_the_spring_that_it_had_shown() -> None:
    """Identified again from the file that it made, in which that spring is no datasheet's."""
    true = replace(STAGE, effects=(CableSpring(180.0),))
    sweep = Loaded("sweep.csv", "", rolling_sweep(true), (), ())
    first = identify(STAGE, [sweep], kinds=["excitation"])
    again = identify(first.machine, [sweep], kinds=["excitation"])
    one, other = (answer.estimates["sweep.csv"] for answer in (first, again))
    (spring,) = again.machine.effects
    assert abs(spring.values()[0] - 180.0) < 4 * one.deviation(SPRING)
    gain, known = one.value("rigid body gain"), one.deviation("rigid body gain")
    assert abs(other.value("rigid body gain") - gain) < known


@pytest.mark.parametrize("effect", [CableSpring(600.0), ViscousFriction(300.0)], ids=lambda one: one.name)
def test_what_only_slow_loops_show_is_not_taken_where_the_rolling_axis_has_none(effect: Effect) -> None:
    """Loops that end within a smooth friction curve had taken its tail for a spring of 4 N/mm, 160 N at the end of the
    travel, and its form for a drag of 540 N s/m, which the file then had."""
    loops = Loaded("slow.csv", "12ab", slow_loops(replace(STAGE, effects=(effect,))), (), ())
    sweep = Loaded("sweep.csv", "34cd", rolling_sweep(STAGE), (), ())
    alone, beside = (identify(STAGE, given) for given in ([loops], [loops, sweep]))
    assert [one.name for one in alone.machine.effects] == [effect.name]
    assert beside.machine.effects == ()
    assert any("is not taken, as the response of sweep.csv" in one for one in beside.remarks)
    (gave,) = (step.gave for step in beside.steps if isinstance(step.gave, ResponseStep))
    assert beside.misfit(gave) < 1.5


def strokes(machine: Machine, half: float) -> Loaded:
    """Strokes of half a way [m] to either side of 0, ever faster: at one frequency inertia looks like a spring."""
    t = np.arange(round(6 / machine.sample_time)) * machine.sample_time
    path = half * np.sin(2 * np.pi * t * (0.5 + 0.1 * t))
    return Loaded("strokes.csv", "34cd", own_records.run(machine, path, np.zeros(t.size), 4), (), ())


@pytest.mark.parametrize("stiffness", [0.0, 150.0])
def test_a_spring_of_short_loops_gives_way_to_what_a_longer_way_shows(stiffness: float) -> None:
    """A cable that is stiff at the loops: 103 N/m +- 34 N/m over 0.2 mm had been written for a travel of 120 mm, where
    a sweep in the same call shows 26 N/m +- 0.5 N/m."""
    kinked, far = (replace(TABLE, effects=(CableSpring(k),) if k else ()) for k in (SPRINGS["table"][1], stiffness))
    loops = Loaded("slow.csv", "12ab", slow_loops(kinked), (), ())
    found = identify(TABLE, [loops, strokes(far, 5e-3)], kinds=["hysteresis", "dynamics"])
    springs = [one for one in found.machine.effects if one.name == CableSpring.name]
    (said,) = (one for one in found.remarks if "The record alone would show a spring to ground of" in one)
    assert "over a way of 10 mm" in said
    if stiffness == 0:
        assert springs == []
        assert "it is not taken, as strokes.csv, in which the axis goes further, shows" in said
    else:
        source = found.machine.sources["effects.cable_spring.stiffness"]
        assert (source.kind, source.record) == ("identified", "strokes.csv")
        assert isinstance(source.std, float)
        assert source.std < 0.1 * stiffness
        assert springs[0].values()[0] == pytest.approx(stiffness, abs=4 * source.std)


def test_a_spring_that_no_longer_way_shows_better_is_kept_with_its_own_way() -> None:
    """Strokes that go less far than the loops say nothing of what is beyond these."""
    _, alone = found("table", False)
    true, _ = found("table", True)
    loops = Loaded("slow.csv", "12ab", slow_loops(true), (), ())
    short = strokes(replace(TABLE, effects=()), 0.3 * float(np.ptp(slow_loops(true).position)))
    beside = identify(TABLE, [loops, short], kinds=["hysteresis", "dynamics"])
    springs = [[one for one in each.machine.effects if one.name == CableSpring.name] for each in (alone, beside)]
    assert springs[0] == springs[1] != []
    assert any("beyond these loops it is not known" in one for one in beside.remarks)
