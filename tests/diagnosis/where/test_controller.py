"""What of a difference between logged and replayed commands is the log's: rounded references, clipped commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.where.controller import replayed, rounding
from diagnosis.where.sentences import added_in_words
from models.controller import References
from models.feedback.forms import Cascade
from models.machine import Machine
from models.quantity import show
from models.simulation.simulator import simulate
from tests.diagnosis.where.test_structure import moves
from tests.models.feedback.axis import CASCADE, axis

STRONG = replace(CASCADE, acceleration_feedforward=40.0)


def s_curve() -> NDArray[np.float64]:
    """Strokes of many lengths [m] with a smooth start and stop."""
    rng, path = np.random.default_rng(0), [np.zeros(50)]
    for stroke in rng.uniform(-1e-3, 1e-3, 20):
        share = np.linspace(0, 1, 150)
        path += [path[-1][-1] + stroke * share**3 * (10 - 15 * share + 6 * share**2), np.full(40, 0.0)]
        path[-1] += path[-2][-1]
    return np.concatenate(path)


@pytest.mark.parametrize("step", [1e-9, 1e-8, 1e-7])
def test_how_far_a_reference_was_rounded_is_read_off_it(step: float) -> None:
    smooth = s_curve()
    assert rounding(step * np.round(smooth / step)) == pytest.approx(step / 12**0.5, rel=0.1)
    assert rounding(smooth) < 1e-3 * step


@pytest.mark.parametrize("path", ["steps", "speeds", "accelerations"])
def test_a_path_with_corners_was_not_rounded(path: str) -> None:
    corners = np.repeat(np.random.default_rng(1).integers(-3, 4, 40), 50) * 1e-6
    signal = {"steps": corners, "speeds": np.cumsum(corners), "accelerations": np.cumsum(np.cumsum(corners))}[path]
    assert rounding(np.asarray(signal, float)) == 0.0


def test_a_rounded_reference_is_no_other_controller_where_feedforward_makes_much_of_it() -> None:
    """In steps of 10 nm, 40 kg times which over a sample squared are newtons; the scale is far finer."""
    machine = axis(STRONG)
    record = simulate(machine, machine.feedback_only(), moves(), seed=1).record
    step = 1e-8
    logged = replace(record, reference=step * np.round(record.reference / step))
    found = replayed(machine, logged)
    assert found.rms > 0.1
    assert found.replays
    other = replace(STRONG, acceleration_feedforward=44.0)
    assert not replayed(axis(other), logged).replays


@pytest.mark.parametrize("size", [0.02, 0.05])
def test_a_law_that_has_less_of_a_rounded_reference_is_no_better_one(size: float) -> None:
    """Of strokes so small that the steps make more of the feedforward than the motion does: a controller that was
    exactly right was a mismatch, as a cascade with a fifth of its acceleration feedforward left a third."""
    machine, step = axis(STRONG), 5e-8
    record = simulate(machine, machine.feedback_only(), size * moves(6000), seed=1).record
    logged = replace(record, reference=step * np.round(record.reference / step))
    assert replayed(machine, record).replays
    assert replayed(machine, logged).rms > np.std(record.command)
    assert replayed(machine, logged).replays


def test_another_law_is_told_where_the_controller_has_the_rounded_reference() -> None:
    """A drive that is given counts: its log has lost nothing, however much rounding would make."""
    machine, step = axis(STRONG), 1e-8
    path = step * np.round(0.05 * moves(6000) / step)
    record = simulate(machine, machine.feedback_only(), path, seed=1).record
    assert rounding(record.reference) > 0
    assert replayed(machine, record).replays
    found = replayed(axis(replace(STRONG, acceleration_feedforward=44.0)), record)
    assert 0 < found.rms < 1
    assert not found.replays


def test_a_command_that_the_rating_cuts_off_accuses_no_controller() -> None:
    """A few samples at the rated thrust, beyond which the law would go; cut off elsewhere, it is another controller."""
    machine = axis(STRONG)
    record = simulate(machine, machine.feedback_only(), moves(), seed=1).record
    limit = float(np.sort(np.abs(record.command))[-20])
    cut = replace(record, command=np.clip(record.command, -limit, limit))
    assert 10 <= np.count_nonzero(cut.command != record.command) < 20
    rated = replace(machine, drive=replace(machine.drive, rated_thrust=limit))
    assert replayed(rated, cut).replays
    assert not replayed(machine, cut).replays
    for other in (np.maximum(record.command, 0.0), np.clip(record.command, -0.2 * limit, 0.2 * limit)):
        assert not replayed(rated, replace(record, command=other)).replays


def test_a_limit_below_the_rating_is_told_and_accuses_no_controller_once_it_is_stated() -> None:
    """A drive's torque limit of 22 %, with an anti-windup of its own: "the whole command times -0.00078" was said."""
    strong = simulate(axis(), axis().feedback_only(), moves(), seed=1).record
    limit = 0.5 * float(np.max(np.abs(strong.command)))

    def rated(thrust: float, cascade: Cascade = CASCADE, anti_windup: float = 0.0) -> Machine:
        machine = axis(cascade, anti_windup=anti_windup)
        return replace(machine, drive=replace(machine.drive, rated_thrust=thrust))

    limited = rated(limit, anti_windup=3e-3)
    record = simulate(limited, limited.feedback_only(), moves(), seed=1).record
    told = replayed(rated(2 * limit), record)
    assert not told.replays
    assert told.remedy == f"the commands kept to {show(limit, 'N', 4)} (rated_thrust in [drive])"
    assert told.remains < 1e-9 * limit
    assert told.structure is None
    assert replayed(rated(limit), record).replays
    assert not replayed(rated(limit, replace(CASCADE, velocity_gain=0.9 * CASCADE.velocity_gain)), record).replays


@pytest.mark.parametrize("period", [0.0, 2.5])
def test_a_noisy_reference_was_not_rounded(period: float) -> None:
    """White, or a sine as fast as the samples tell: neighbours go against each other without a step."""
    n = np.arange(3000)
    signal = np.sin(2 * np.pi * n / period) if period else np.random.default_rng(0).standard_normal(n.size)
    assert rounding(1e-6 * signal) == 0.0


@pytest.mark.parametrize(("shift", "said"), [(-1, "1 sample sooner"), (2, "2 samples later")])
@pytest.mark.parametrize("delay", [0, 1])
def test_an_acceleration_that_comes_at_another_sample_is_told(shift: int, said: str, delay: int) -> None:
    """A profile generator's own, and one with a wrong delay: a fit of all gains had told 2751 N s/m for 2600."""
    path, own = moves(), replace(STRONG, acceleration_feedforward=0.0)
    machine, stated = axis(own), axis(STRONG)
    late = np.diff(path, n=2, prepend=(path[0], path[0])) / machine.sample_time**2
    force = STRONG.acceleration_feedforward * np.roll(late, shift)
    record = simulate(machine, machine.feedback_only(), path, seed=1, given=References(path, force, 0 * path)).record
    logged = replace(record, feedforward=np.zeros(path.size))
    found = replayed(replace(stated, control=replace(stated.control, reference_delay=delay)), logged)
    assert not found.replays
    wait = machine.control.reference_delay
    words = {0: "0 samples", 1: "1 sample"}[wait]
    other = f"a reference delay of {words} instead of {delay} and " if delay != wait else ""
    assert found.remedy == f"{other}the acceleration feedforward {said}"
    assert found.remains < 0.02 * found.rms
    assert found.other is None


def test_a_mapped_feedforward_that_is_late_is_told_in_every_record() -> None:
    """In the record of small strokes, whose feedforward is less than what rounding may leave, too: it was a controller
    mismatch there."""
    own = replace(STRONG, acceleration_feedforward=0.0)
    machine = axis(own)
    for size in (1.0, 0.02):
        path = size * moves()
        late = np.diff(path, n=2, prepend=(path[0], path[0])) / machine.sample_time**2
        force = STRONG.acceleration_feedforward * late
        given = References(path, np.roll(force, 3), 0 * path)
        record = simulate(machine, machine.feedback_only(), path, seed=1, given=given).record
        found = replayed(machine, replace(record, feedforward=force))
        assert found.replays
        assert found.added is not None
        assert found.added.delay == 3
        assert found.added.gain == pytest.approx(1.0, abs=1e-3)
        told = added_in_words(found, found.added, "record 1", machine.sample_time)
        assert "acts 3 samples late: what is left then" in told
