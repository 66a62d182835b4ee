"""Friction from slow records of tables: elements, damping, what the path leaves open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.controller import References
from models.friction import branch, elements
from models.identification.force import by_elements
from models.identification.force.fit import ForceFit
from models.identification.force.signals import Terms
from models.machine import Machine, load
from models.records.record import Record
from models.simulation.simulator import simulate
from studies.identify_machine import own_records

Array = NDArray[np.float64]

MACHINE = own_records.noisy(load())


def test_the_elements_come_back_from_a_clean_hysteresis() -> None:
    table = own_records.another(MACHINE, 5)
    table = replace(table, scale=replace(table.scale, noise=0.0, resolution=0.0))
    terms = Terms(mass=1 / table.plant.modes[0].gain, known_delay=table.plant.dead_time + table.sample_time / 2)
    found = by_elements.identify(own_records.hysteresis(table, 5), terms, pass_band=20.0)
    assert found.friction.limit == pytest.approx(table.friction.limit, rel=0.03)
    slip, _ = found.slip_force()
    assert slip == pytest.approx(table.friction.coulomb_force, rel=1e-3)
    distance = np.array([5e-6, 20e-6, 100e-6, 400e-6])
    assert found.curve(distance)[0] == pytest.approx(branch(table.friction, distance), abs=0.1)


def test_the_elements_do_not_depend_on_the_unit_of_force() -> None:
    """A galvo scanner has a millionth of a table's force: a search that ends at slopes of absolute size leaves its
    elements where it began, and makes up for it by more of them."""
    table = own_records.another(MACHINE, 5)
    record = own_records.hysteresis(table, 5)
    mass = 1 / table.plant.modes[0].gain
    terms = Terms(mass=mass, known_delay=table.plant.dead_time + table.sample_time / 2)
    weak = replace(record, command=1e-6 * record.command)
    found = by_elements.identify(record, terms, pass_band=20.0)
    small = by_elements.identify(weak, replace(terms, mass=1e-6 * mass), pass_band=20.0)
    assert small.friction.limit == pytest.approx(found.friction.limit, rel=1e-6)
    assert 1e6 * np.array(small.friction.stiffness) == pytest.approx(np.array(found.friction.stiffness), rel=1e-6)


def test_a_path_that_is_too_short_leaves_the_offset_open_by_what_friction_remembers() -> None:
    """Loops of half of the longest element's range, which began strained: its force looks like an offset."""
    table = own_records.another(MACHINE, 5)
    limit, stiffness = table.friction.limit[-1], table.friction.stiffness[-1]
    t = np.arange(round(8 / table.sample_time)) * table.sample_time
    reference = limit / 2 * np.sin(np.pi * t / 2)
    zero = np.zeros(t.size)
    strained = np.where(np.arange(3) == 2, -limit, 0.0)
    given = References(reference, zero, zero)
    record = simulate(table, table.feedback_only(), reference, given=given, seed=5, initial_friction=strained).record
    terms = Terms(mass=1 / table.plant.modes[0].gain, known_delay=table.plant.dead_time + table.sample_time / 2)
    found = by_elements.identify(record, terms, pass_band=20.0)
    wrong = found.estimate.value("offset") - table.drive.offset
    assert wrong < -0.5 * stiffness * limit
    assert found.short
    assert abs(wrong) < 3 * found.estimate.deviation("offset")
    long = by_elements.identify(own_records.hysteresis(table, 5), terms, pass_band=20.0)
    assert not long.short
    assert long.remembered == 0.0


def slow(seed: int, time: float, late: float = 0.0, late_std: float = 0.0) -> tuple[Machine, ForceFit]:
    """A table with D_i = time K_i, and what its slow record shows if the delay is taken `late` too short."""
    table = own_records.another(MACHINE, seed)
    stiffness = np.array(table.friction.stiffness)
    table = replace(table, friction=elements(stiffness, table.friction.limit, time * stiffness))
    delay = table.plant.dead_time + table.sample_time / 2 - late
    terms = Terms(1 / table.plant.modes[0].gain, known_delay=delay, known_delay_std=late_std, damped=True)
    return table, by_elements.identify(own_records.hysteresis(table, seed), terms, pass_band=20.0)


@pytest.mark.parametrize("seed", [100, 107])
def test_damping_comes_back_where_the_record_shows_it(seed: int) -> None:
    table, found = slow(seed, 2e-3)
    assert found.damped
    assert found.lag is not None
    assert abs(found.lag[0] - 2e-3) < 3 * found.lag[1] < 2e-3
    errors = np.array(found.friction.damping) - np.array(table.friction.damping)
    assert np.all(np.abs(errors) < 3 * found.damping_std())
    assert np.all(found.damping_std() < 0.6 * np.array(table.friction.damping))


@pytest.mark.parametrize("seed", [100, 107])
def test_no_damping_is_found_where_there_is_none(seed: int) -> None:
    _, found = slow(seed, 0.0)
    assert found.friction.damping == (0.0,) * 3
    assert found.lag is not None
    assert abs(found.lag[0]) < 3 * found.lag[1]
    assert 0 < found.longest_lag < 2e-3  # so that the damping of the test above is seen


def test_a_delay_that_is_not_known_is_no_damping() -> None:
    """A delay 1 ms too short looks like 1 ms of damping: with that much uncertainty of it, nothing is claimed."""
    _, misled = slow(107, 0.0, late=1e-3)
    assert misled.damped
    assert misled.lag is not None
    assert misled.lag[0] == pytest.approx(1e-3, abs=3 * misled.lag[1])
    _, found = slow(107, 0.0, late=1e-3, late_std=1e-3)
    assert not found.damped
    assert found.longest_lag > 2e-3
    _, early = slow(107, 0.0, late=-1e-3)
    assert early.lag is not None
    assert early.lag[0] == pytest.approx(-1e-3, abs=3 * early.lag[1])
    assert not early.damped


def test_a_record_without_friction_in_it_is_refused() -> None:
    n = 4000
    flat = Record(5e-4, *(np.zeros(n) for _ in range(5)))
    with pytest.raises(ValueError, match="constant"):
        by_elements.identify(flat, Terms(), pass_band=20.0)
