"""The machine from its motions: what was changed, damping, memory of the start, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.controller import Controller, References
from models.friction import elements
from models.identification import motion
from models.identification.pipeline import identify
from models.identification.unusable import UnusableError
from models.machine import Tolerance, load
from models.records.files import Loaded
from models.records.record import Record, cut
from models.simulation.simulator import simulate
from models.variation import Variation, varied
from studies.identify_machine import own_records
from studies.identify_machine.round_trip import errors_of_file

Array = NDArray[np.float64]

MACHINE = own_records.noisy(load())


def test_a_motion_fit_finds_what_was_changed() -> None:
    table, truth = own_records.drawn_from(MACHINE, 11)
    found = motion.identify(own_records.motions(table, 11, MACHINE), MACHINE)
    assert found.estimate.values == pytest.approx(truth, rel=0.02, abs=0.05)
    assert np.all(np.abs(found.estimate.values - truth) < 4 * found.estimate.deviations)
    assert np.diag(found.estimate.correlation) == pytest.approx(np.ones(5))


def test_motions_without_noise_settle_too() -> None:
    """Beside deviations that are next to none no step is small, however small it is."""
    exact = replace(load(), scale=replace(load().scale, noise=0.0, resolution=0.0))
    heavier = varied(exact, Variation(mass=0.1))
    found = motion.identify(own_records.motions(heavier, 11, exact), exact).estimate
    assert found.values[:4] == pytest.approx([1.1, 1.0, 1.0, heavier.plant.dead_time], rel=1e-3)


@pytest.mark.parametrize("seed", [21, 23])
def test_motions_show_the_elements_damping(seed: int) -> None:
    """D = 0.1 ms times K, a lead of 0.2 um at the motions' 2 mm/s; and none where there is none. What the fit holds as
    known is right here, and the machine file says so; by the usual tolerances the damping is three times less sure."""
    sure = Tolerance(mode_gain=1e-3, frequency=1e-3, damping=1e-2, stiffness=1e-3, limit=1e-3)
    known = replace(MACHINE, tolerance=sure)
    table, truth = own_records.drawn_from(MACHINE, seed)
    stiffness = np.array(table.friction.stiffness)
    damped = replace(table, friction=elements(stiffness, table.friction.limit, 1e-4 * stiffness))
    found = motion.identify(own_records.motions(damped, seed, MACHINE), known)
    usual = motion.identify(own_records.motions(damped, seed, MACHINE), MACHINE)
    assert found.damped
    assert usual.damped
    assert usual.lag[1] > 2 * found.lag[1]
    assert abs(found.lag[0] - 1e-4) < 4 * found.lag[1] < 1e-4
    truth = np.append(truth[:4], [1e-4, truth[4]])
    assert np.all(np.abs(found.estimate.values - truth) < 4 * found.estimate.deviations)
    assert found.machine.friction.damping == pytest.approx(damped.friction.damping, rel=0.6)
    plain = motion.identify(own_records.motions(table, seed, MACHINE), known)
    assert not plain.damped
    assert abs(plain.lag[0]) < 4 * plain.lag[1] < 1e-4
    assert plain.machine.friction.damping == (0.0,) * len(stiffness)


def test_what_friction_remembers_at_the_start_does_not_mislead_a_motion_fit() -> None:
    """The longest element begins full: the offset alone takes the force that stays in it, no more than is said."""
    table, truth = own_records.drawn_from(MACHINE, 11)
    table = replace(table, drive=MACHINE.drive)
    control = MACHINE.control
    controller = Controller(MACHINE.sample_time, control.pid, control.reference_delay, (1.0,), (0.0,))
    given = own_records.motions(table, 11, MACHINE)
    strained = np.where(
        np.arange(len(table.friction.limit)) == len(table.friction.limit) - 1, -table.friction.limit[-1], 0
    )
    known = References(given.reference, given.feedforward, np.zeros(given.feedforward.size))
    record = simulate(table, controller, given.target, given=known, seed=11, initial_friction=strained).record
    found = motion.identify(record, MACHINE)
    wrong = np.abs(found.estimate.values[:4] - truth[:4])
    assert np.all(wrong < 4 * found.estimate.deviations[:4])
    assert found.carried[0] == 1
    assert 1.0 < abs(found.estimate.value("offset")) < found.carried[1]
    assert abs(found.estimate.value("offset")) < 2 * found.estimate.deviation("offset")  # it covers that memory


def test_motions_of_another_machine_end_in_one_sentence() -> None:
    """With the command's sign turned round, no loop makes anything of it, wherever the steps wander; a presliding
    length that is 30 times too large runs away, and it is told that it is the length; and of a fit that had too few
    steps it is told what still moves."""
    record = own_records.motions(own_records.noisy(MACHINE), 1).part(0, 4000)
    with pytest.raises(UnusableError, match=r"the simulated loop leaves .* of a command of .* \(root mean square\)$"):
        motion.identify(replace(record, command=-record.command), MACHINE, iterations=12)
    heavy = own_records.motions(varied(MACHINE, Variation(mass=1.5)), 5, MACHINE)
    with pytest.raises(UnusableError, match=r"has not settled after 3 steps: the mass .* standard deviations$"):
        motion.identify(heavy, MACHINE, iterations=3)
    long = varied(MACHINE, Variation(friction_length=29.0))
    with pytest.raises(UnusableError, match=r"does not converge: the presliding length runs away, to 0\.05 times that"):
        motion.identify(own_records.motions(MACHINE, 5), long)


@pytest.mark.parametrize(
    ("off", "which", "truth"), [(Variation(mass=1.5), 0, 2.5), (Variation(friction_length=3.0), 2, 4.0)]
)
def test_a_fit_goes_on_until_it_has_settled(off: Variation, which: int, truth: float) -> None:
    """It had ended after six steps of 0.2 times the mass and 0.3 times the length: a mass of 2.5 times the known one
    gave a length of 0.43 +- 0.015 in place of 1, and four times its length came out as 2.7 times."""
    found = motion.identify(own_records.motions(varied(MACHINE, off), 5, MACHINE), MACHINE).estimate
    assert found.values[which] == pytest.approx(truth, rel=0.01)
    expected = np.where(np.arange(3) == which, truth, 1.0)
    assert np.all(np.abs(found.values[:3] - expected) < 4 * found.deviations[:3])


def test_what_motions_do_not_show_does_not_run_away() -> None:
    """On an air bearing of 3 mN and a scale of 1 um, the length of a friction that hardly acts had come to -0.03 times
    what is known, and the record was refused for it, with the advice to check the command's sign."""
    machine = varied(MACHINE, Variation(friction_force=-0.9998))
    machine = replace(machine, scale=replace(machine.scale, resolution=1e-6, noise=0.0))
    found = motion.identify(own_records.motions(machine, 4).part(0, 6000), machine).estimate
    assert found.value("mass") == pytest.approx(1.0, abs=4 * found.deviation("mass"))
    assert found.deviation("presliding length") > 0.5 * found.value("presliding length")


def test_a_motion_record_that_does_not_move_or_has_another_clock_is_refused() -> None:
    record = own_records.motions(MACHINE, 1)
    with pytest.raises(ValueError, match="sampled at"):
        motion.identify(replace(record, sample_time=1e-3), MACHINE)
    with pytest.raises(ValueError, match="does not move"):
        motion.identify(replace(record, reference=0 * record.reference), MACHINE)


@pytest.mark.parametrize("seed", [1301, 1304, 1307])
def test_motions_alone_are_no_surer_than_what_is_held_as_known(seed: int) -> None:
    """A table that is off in its modes and its friction's shape by what the file tolerates: every value that the file
    states then is within four deviations, and most within two. Before, masses were off by six deviations, and the
    friction by twenty."""
    table, _ = own_records.drawn_from(MACHINE, seed, held=True)
    record = Loaded("moves.csv", "0", own_records.motions(table, seed, MACHINE), (), ())
    errors = errors_of_file(identify(MACHINE, [record], kinds=["motion"]).machine, table)
    assert np.max(np.abs(errors)) < 4
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.6


def test_a_loop_that_makes_nothing_of_the_command_gives_no_values() -> None:
    """With gains that are not stable on it the simulated loop ran away: "offset -8e6 N +- 1.4e8 N" was in the table."""
    record = own_records.motions(MACHINE, 11)
    pid = MACHINE.control.pid
    wild = replace(pid, kp=3 * pid.kp, kd=8 * pid.kd, ki=3 * pid.ki)
    loop = replace(MACHINE, control=replace(MACHINE.control, pid=wild))
    with pytest.raises(UnusableError, match=r"the simulated loop leaves .* of a command of "):
        motion.identify(record, loop)


def test_places_of_unequal_motions_stay_apart_where_a_later_one_dwells_longer() -> None:
    """The tail of the longest motion of a kind has numbers of its own, so that equal motions alone share a part."""
    target = np.repeat([0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0], [100, 100, 100, 100, 100, 100, 300, 100, 100])
    record = Record(1e-3, target, target, np.zeros_like(target), np.zeros_like(target), target)
    place = motion._phases(record)
    moves = {move.start: place[move.start : move.stop] for move in cut(record)}
    equal = [{100, 500}, {200, 600}, {300, 900}, {400, 1000}]
    for i, one in enumerate(equal):
        first, again = (moves[start] for start in sorted(one))
        np.testing.assert_array_equal(first, again[: first.size])
        others = [moves[start] for j, other in enumerate(equal) if j != i for start in other]
        assert not set(again) & set(np.concatenate(others))
