"""Designs of a machine: what they meet, what they say that they do not, and that the loop in place can run them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.deadbeat import DesignError
from design.family import family
from design.loop import assess
from design.redesign.designs import designed, in_place, retuned
from design.redesign.outcome import judged_target
from models.controller import PID, references
from models.effects.catalogue import every
from models.feedback.forms import Cascade
from models.machine import Machine
from models.simulation.simulator import simulate
from models.variation import Variation, varied
from tests.design.redesign.axes import KNOWN, TRUE

MASS = KNOWN.plant.mass
CASCADE = Cascade(
    position_gain=40.0,
    velocity_gain=4000.0,
    integral_time=20e-3,
    velocity_feedforward=1.0,
    acceleration_feedforward=MASS,
)


def with_control(machine: Machine, **changes: object) -> Machine:
    return replace(machine, control=replace(machine.control, **changes))  # type: ignore[arg-type]


def weighted() -> Machine:
    pid = replace(KNOWN.control.pid, proportional_weight=0.6, derivative_weight=0.0)
    return with_control(KNOWN, pid=pid)


@pytest.mark.parametrize(
    "machine",
    [
        KNOWN,
        weighted(),
        with_control(KNOWN, cascade=CASCADE),
        with_control(weighted(), reference_delay=4),
    ],
    ids=["PID", "PI-D", "cascade", "PI-D that waits longer"],
)
def test_the_loop_in_place_does_what_the_design_does(machine: Machine) -> None:
    """It weighs the reference in its own way and waits in its own way; the table makes up for both."""
    design, target = designed(machine, "new"), judged_target(machine)
    quiet = replace(machine, scale=replace(machine.scale, noise=0.0, resolution=0.0))
    known = in_place(design, machine, target)
    meant = simulate(quiet, design.controller, target).position
    done = simulate(quiet, machine.feedback_only(), target, given=known).position
    later = max(machine.control.reference_delay - design.controller.reference_delay, 0)
    assert np.max(np.abs(done[later:] - meant[: meant.size - later])) < 1e-10


def test_a_loop_that_waits_less_gets_a_later_reference() -> None:
    machine = with_control(KNOWN, reference_delay=0)
    design, target = designed(machine, "new"), judged_target(machine)
    known = in_place(design, machine, target)
    plain = references(design.controller, target).position
    late = design.controller.reference_delay
    assert late > 0
    np.testing.assert_array_equal(known.position[late:], plain[: plain.size - late])


def test_a_weaker_drive_gets_the_shortest_motion_that_it_can_do_and_says_so() -> None:
    weak = replace(KNOWN, drive=replace(KNOWN.drive, rated_thrust=80.0))
    design = designed(weak, "new")
    assert design.settling_time > KNOWN.specification.reference_settling_time
    assert "takes more thrust than the" in design.notes[0]
    thrust = np.max(np.abs(references(design.controller.without_compensation(), judged_target(weak)).feedforward))
    assert thrust <= 80.0 - KNOWN.friction.coulomb_force + 1e-6
    with pytest.raises(DesignError):
        designed(replace(KNOWN, drive=replace(KNOWN.drive, rated_thrust=16.6)), "new")


def test_what_cannot_be_met_ahead_is_said_with_its_reason() -> None:
    cogging, scale = (every()[name].typical() for name in ("cogging", "scale_periodic_error"))
    design = designed(replace(KNOWN, effects=(cogging, scale)), "new")
    assert design.controller.effect_compensation is not None
    assert design.controller.effect_compensation.effects == (cogging,)
    assert [
        note
        for note in design.notes
        if note.startswith("scale periodic error stays: the scale shows the table elsewhere")
    ]


def test_a_compensator_has_the_stated_number_of_elements_only_where_asked() -> None:
    def count(*, every_element: bool) -> int:
        found = designed(KNOWN, "new", every_element=every_element).controller.friction_compensation
        assert found is not None
        return len(found.limit)

    assert KNOWN.control.compensator_elements == 5
    assert (count(every_element=False), count(every_element=True)) == (5, 10)


def test_another_pid_keeps_to_the_peak_that_the_one_in_place_had() -> None:
    before = KNOWN
    design = retuned(designed(TRUE, "new"), TRUE, before, (), "PID")
    old = max(assess(member.plant, before.control.pid).ms.value for member in family(before, 0.0, 0.0))
    new = max(assess(member.plant, design.controller.pid).ms.value for member in family(TRUE, 0.0, 0.0))
    assert design.controller.pid != before.control.pid
    assert new <= old * (1 + 1e-3)


def test_another_structure_than_a_pid_stays_and_it_is_said() -> None:
    machine = with_control(KNOWN, cascade=CASCADE)
    design = designed(machine, "new")
    kept = retuned(design, machine, machine, (), "PID")
    assert kept.controller == design.controller
    assert "only a plain PID is retuned" in kept.notes[-1]


def test_a_pid_that_cannot_be_retuned_stays_and_the_note_says_why_without_advice() -> None:
    others = [varied(TRUE, Variation(payload=share)) for share in (-0.9, 9.0)]
    kept = retuned(designed(TRUE, "new"), TRUE, KNOWN, others, "PID")
    assert kept.controller.pid == KNOWN.control.pid
    assert kept.notes[-1].startswith("the PID stays as it is: no PID with |S| <= ")
    assert kept.notes[-1].endswith("plants was found")


def test_an_unstable_loop_is_not_tuned_from() -> None:
    wild = with_control(KNOWN, pid=PID(kp=1e9, ki=0.0, kd=0.0, derivative_filter=0.0))
    kept = retuned(designed(KNOWN, "new"), KNOWN, wild, (), "PID")
    assert "is not stable" in kept.notes[-1]
