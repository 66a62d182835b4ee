"""Which values of a file take most of the gap, whatever their tolerances are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.handover.moved_most import MovedMost, moved_most
from diagnosis.model.fit import fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.unknown_force import unknown_force
from diagnosis.records.motions import rms
from diagnosis.records.units import with_units
from models.effects.base import Effect
from models.effects.motor import Cogging, CurrentLoopLag
from models.machine import Machine
from models.variation import Variation, varied
from tests.diagnosis.tables import recorded, table

FINE = replace(table(), scale=replace(table().scale, resolution=5e-9, noise=3e-9))
PLAN = (together("short", [amplitude_ladder(FINE, (5e-6, 20e-6, 100e-6)), strokes(FINE, 45e-3, (0.2,))]),)


def found(
    given: Machine, variation: Variation, moves: dict[str, float], effects: tuple[Effect, ...] = ()
) -> list[MovedMost]:
    """What takes most of the gap on records of a table that is off by the variation, by a fit that moved these entries
    of theta [SI and logarithms], with the starts of the friction that a fit has."""
    records = recorded(varied(given, variation), PLAN, given.effects, seed=4, wrong=0.0)
    machine = with_units(given, records)
    layout = parameters(machine, len(records))
    theta = np.zeros(layout.count)
    for name, size in moves.items():
        theta[layout.of(name)] = size
    begun = fit(Candidate(layout, theta, effects or given.effects), records, iterations=4).candidate
    starts = np.array(layout.names) == "initial_friction_state"
    candidate = replace(begun, theta=np.where(starts, begun.theta, theta), effects=effects or given.effects)
    fitted = fit(candidate, records, iterations=0)
    floor = rms(unknown_force(candidate, records, fitted.paths))  # of a fit that leaves nothing but noise
    return list(moved_most(fitted, records, floor))


def test_a_mass_within_its_tolerance_takes_most_of_the_gap_and_not_what_moved_by_more_of_them() -> None:
    """Of 2 % more mass, 1.4 of its tolerances, the page had told the dead time alone, moved by 6 of its own."""
    one, *others = found(FINE, Variation(payload=0.02), {"payload_mass": -np.log(1.02), "mode_damping": 0.4})
    assert (one.name, one.kinds, others) == ("payload_mass", ("payload_mass",), [])
    (number,) = one.numbers
    assert number.unit == "kg"
    assert number.now / number.before == pytest.approx(1.02)
    assert one.share > 0.95


def test_a_dead_time_that_a_lag_makes_up_for_is_told_as_the_whole_delay_or_not_at_all() -> None:
    late = replace(FINE, plant=replace(FINE.plant, dead_time=500e-6), effects=(CurrentLoopLag(300e-6),))
    shifts = {"payload_mass": -np.log(1.02), "dead_time": 60e-6}
    (one,) = found(late, Variation(payload=0.02), shifts, (CurrentLoopLag(240e-6),))
    assert one.name == "payload_mass"
    (delay,) = found(late, Variation(dead_time=200e-6), {"dead_time": 260e-6}, (CurrentLoopLag(240e-6),))
    assert (delay.name, delay.kinds) == ("input_delay", ("dead_time", "current_loop_lag"))
    (number,) = delay.numbers
    assert number.now - number.before == pytest.approx(200e-6)


def test_the_harmonics_of_an_effect_that_the_file_states_go_together() -> None:
    """A user's cogging of three times its size had no name: its file had two of that name, and none of them counted."""
    given = replace(FINE, effects=(Cogging(0.3, 0.02, 0.5), Cogging(0.1, 0.01, 0.2)))
    now = (Cogging(0.9, 0.02, 0.5), Cogging(0.1, 0.01, 0.2))
    records = recorded(FINE, PLAN, now, seed=4, wrong=0.0)
    machine = with_units(given, records)
    layout = parameters(machine, len(records))
    fitted = fit(Candidate(layout, np.zeros(layout.count), now), records, iterations=10)
    floor = rms(unknown_force(fitted.candidate, records, fitted.paths))
    first = moved_most(fitted, records, floor)[0]
    assert (first.name, first.kinds) == ("cogging", ("cogging",))
    assert first.share > 0.9
    assert first.numbers[0].before == 0.3
    assert first.numbers[0].now == pytest.approx(0.9, rel=0.02)


def test_two_values_that_are_off_are_told_by_their_shares() -> None:
    larger, smaller = found(
        FINE, Variation(friction_force=0.3, offset=1.5), {"friction_level": np.log(1.3), "amplifier_offset": 1.5}
    )
    assert {larger.name, smaller.name} == {"friction_level", "amplifier_offset"}
    assert larger.share >= smaller.share > 0.05
    assert larger.share + smaller.share == pytest.approx(1.0, abs=0.05)


def test_a_level_of_friction_is_told_and_not_all_contacts_where_these_take_hardly_more() -> None:
    """A brake that drags: 33 % more friction, which all contacts together take to the last per mille."""
    moves = {"friction_level": np.log(1.3), "presliding_limit": np.log(1.02)}
    (one,) = found(FINE, Variation(friction_force=0.3, limit=0.02), moves)
    assert one.name == "friction_level"
    (number,) = one.numbers
    assert number.now / number.before == pytest.approx(1.3 * 1.02)
