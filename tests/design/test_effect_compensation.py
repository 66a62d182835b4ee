"""Effects met ahead: by closed forms along simple paths, and by the nonsmooth machine that has them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.controller import assemble, default_controller, design_deadbeat
from design.deadbeat import synthesise
from design.effect_compensation import designed_for, designed_with_effects, left_out, with_effects
from design.element_count import Choice
from design.validation import validate
from models.controller import Controller, ControllerError, load, references, to_json
from models.effect_feedforward import EffectFeedforward, effect_thrust
from models.effects.base import Effect
from models.effects.catalogue import every
from models.effects.friction_laws import FrictionRelaxation, ViscousFriction
from models.effects.motor import Cogging, GainAsymmetry
from models.effects.structure import CableSpring
from models.friction import elements
from models.machine import Machine
from models.machine import load as load_machine
from models.plant import delay_split
from models.simulation.simulator import Response, simulate

TS = 5e-4


def with_these(machine: Machine, *effects: Effect) -> Machine:
    """The machine with effects."""
    return replace(machine, effects=effects)


def exact() -> Machine:
    """The default table with a scale that does not round, so that a gap is of the effects alone."""
    machine = load_machine()
    return replace(machine, scale=replace(machine.scale, resolution=0.0))


@pytest.mark.parametrize("late", [0.0, 0.3 * TS])
def test_forces_along_a_ramp_have_their_closed_form(late: float) -> None:
    """A cable pulls k x and a drag c v at the middle of the interval in which a thrust acts."""
    speed, count = 0.02, 60
    position = np.asarray(speed * TS * np.arange(count), float)
    middles = position + speed * (0.5 * TS + late)
    inner = slice(3, count - 3)  # the cubic rounds the ramp's ends
    cable = effect_thrust(EffectFeedforward((CableSpring(300.0),), late), None, position, np.zeros(count), TS)
    drag = effect_thrust(EffectFeedforward((ViscousFriction(50.0),), late), None, position, np.zeros(count), TS)
    assert cable[inner] == pytest.approx(300.0 * middles[inner], rel=1e-9)
    assert drag[inner] == pytest.approx(50.0 * speed, rel=1e-9)


def test_an_amplifier_s_gain_is_inverted_but_for_the_third_order() -> None:
    thrust = 100.0 * np.sin(np.arange(80) / 5)
    added = effect_thrust(EffectFeedforward((GainAsymmetry(0.03),), 0.0), None, np.zeros(80), thrust, TS)
    sent = thrust + added
    assert np.max(np.abs(sent + 0.03 * np.abs(sent) - thrust)) < 1.5 * 0.03**3 * 100
    assert np.max(np.abs(added)) > 2.9


def test_what_holds_the_table_before_the_start_is_the_feedback_s() -> None:
    pull = Cogging(2.0, 0.03, 1.0)
    still = effect_thrust(EffectFeedforward((pull,), 0.0), None, np.zeros(20), np.zeros(20), TS)
    assert np.all(still == 0.0)


def test_without_effects_nothing_changes() -> None:
    machine = load_machine()
    controller = default_controller(machine)
    assert with_effects(controller, machine) is controller
    target = np.repeat([0.0, 20e-6, 0.0], 100)
    off = ViscousFriction(0.0)
    plain, nothing = (
        references(controller, target),
        references(replace(controller, effect_compensation=EffectFeedforward((off,), 0.0)), target),
    )
    assert np.array_equal(plain.compensation, nothing.compensation)
    assert controller.without_compensation().effect_compensation is None


def test_every_effect_is_met_or_designed_for_or_has_a_reason() -> None:
    machine, met = load_machine(), set[str]()
    bare = default_controller(machine)
    for name, kind in every().items():
        one = with_these(machine, kind.typical())
        known = with_effects(bare, one).effect_compensation is not None
        assert known + bool(left_out(one)) + (designed_for(one) != machine.plant) == 1, name
        met |= {name} if known else set()
    assert met >= {"friction_relaxation", "viscous_friction", "cogging", "cable_spring", "thrust_ripple", "stribeck"}
    for name in ("scale_drift", "controller_mismatch", "dac_quantisation", "timing_jitter", "floor_vibration"):
        assert left_out(with_these(machine, every()[name].typical()))[name]


def test_a_long_move_with_drag_and_cogging_follows_its_reference() -> None:
    """10 mm in 0.25 s, a third of a pitch: without, the feedback has to find out."""
    machine = with_these(exact(), ViscousFriction(50.0), Cogging(3.0, 0.03, 0.5))
    deadbeat = synthesise(machine.plant, TS, 0.25, 10e-3)
    plain = assemble(machine, deadbeat)
    target, off = np.full(800, 10e-3), []
    for controller in (plain, with_effects(plain, machine)):
        delay = controller.reference_delay
        response = simulate(machine, controller, target)
        off.append(response.position[delay:] - response.record.reference[: -delay or None])
    assert np.sqrt(np.mean(off[1] ** 2)) < 0.2 * np.sqrt(np.mean(off[0] ** 2))


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("friction_relaxation", 0.35),
        ("gain_asymmetry", 0.15),
        ("thrust_saturation", 0.15),
        ("position_dependent_friction", 0.35),
    ],
)
def test_the_gap_of_the_sequence_shrinks(name: str, most: float) -> None:
    """The table's path beside that of the table without the effect, over a period of 20 um motions."""
    machine = exact()
    controller = default_controller(machine)
    worse = with_these(machine, every()[name].typical())
    ideal = validate(machine, controller).response.position

    def gap(law: Controller) -> float:
        return float(np.sqrt(np.mean((validate(worse, law).response.position - ideal) ** 2)))

    assert gap(with_effects(controller, worse)) < most * gap(controller)


def test_a_mode_is_designed_for() -> None:
    machine = with_these(load_machine(), every()["additional_mode"].typical())
    plant = designed_for(machine)
    assert plant.modes == (*machine.plant.modes, *machine.effects[0].modes())
    free = replace(machine, friction=elements([1e-3], [1e-3]), scale=replace(machine.scale, resolution=0.0))
    left = []
    for known in (plant, machine.plant):
        deadbeat = synthesise(known, TS, 22e-3, 20e-6)
        assert np.max(np.abs(deadbeat.thrust)) < machine.drive.rated_thrust
        law = assemble(machine, deadbeat).without_compensation()
        response = simulate(free, law, np.full(200, 20e-6))
        left.append(np.max(np.abs(response.position[50:] - 20e-6)))
    assert left[0] < 1e-5 * 20e-6
    assert left[1] > 1e3 * left[0]


def test_a_lag_is_designed_for_as_dead_time() -> None:
    """Half a sample and more of lag: judged on the table that has it, beside the design that does not know it."""
    machine = with_these(exact(), every()["current_loop_lag"].typical())
    lag = machine.effects[0].input_delay()
    assert designed_for(machine) == replace(machine.plant, dead_time=machine.plant.dead_time + lag)
    unknowing = assemble(machine, design_deadbeat(machine))
    whole, deadbeat, refused = designed_with_effects(machine, design_deadbeat)
    knowing = with_effects(assemble(machine, deadbeat, whole.plant), machine)
    assert not refused
    assert knowing.effect_compensation is None
    first, last = (validate(machine, law).response for law in (unknowing, knowing))

    def off(found: Response, law: Controller) -> float:
        late = law.reference_delay
        return float(np.sqrt(np.mean((found.position[late:] - found.record.reference[: -late or None]) ** 2)))

    assert off(last, knowing) < 0.5 * off(first, unknowing)
    assert default_controller(machine) == knowing


def test_a_number_of_elements_is_judged_on_the_machine_whose_lag_acts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = with_these(exact(), every()["current_loop_lag"].typical())
    machine = replace(machine, control=replace(machine.control, compensator_elements="auto"))
    judged: list[Machine] = []

    def choosing(its: Machine, bare: Controller, *, stroke: float) -> Choice:
        judged.append(its)
        assert bare.reference_delay == delay_split(designed_for(machine).dead_time, TS)[0]
        assert stroke == machine.specification.stroke
        return Choice(4, 10, ())

    monkeypatch.setattr("design.controller.choose", choosing)
    deadbeat = design_deadbeat(replace(machine, plant=designed_for(machine)))
    law = assemble(machine, deadbeat, designed_for(machine))
    assert judged == [machine]
    assert law.friction_compensation is not None
    assert len(law.friction_compensation.limit) == 4


def test_the_controller_file_keeps_the_effects(tmp_path: Path) -> None:
    machine = with_these(
        load_machine(), FrictionRelaxation.typical(), Cogging(1.0, 0.03, 0.1), Cogging(0.5, 0.015, 0.2)
    )
    controller = with_effects(default_controller(machine), machine)
    content = to_json(controller, 20e-6, 20e-3)
    path = tmp_path / "controller.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    assert load(path) == controller
    assert set(content["effect_compensation"]["effects"]) == {"friction_relaxation", "cogging.1", "cogging.2"}
    path.write_text(json.dumps(content).replace('"friction_relaxation"', '"magic"'), encoding="utf-8")
    with pytest.raises(ControllerError, match="no effect is named 'magic'"):
        load(path)
