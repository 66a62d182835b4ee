"""Which signal is the reference follows from the sign of the feedback, whatever machine, controller and digits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.signal import cont2discrete

from models.machine import load
from models.records.checks import Facts
from models.records.feedback_sign import Mistake, acts_against_the_reference, mistake
from models.records.plausible import doubts
from models.records.record import Record
from studies.identify_machine import own_records

Array = NDArray[np.float64]
MACHINE = load()
EMPS = Path(__file__).parents[4] / "shared" / "data" / "emps"
GIVEN = {"time", "target", "reference", "feedforward", "command", "position"}


def swapped(record: Record) -> Record:
    return replace(record, reference=record.position, target=record.position, position=record.reference)


def rounded(signal: Array, digits: int) -> Array:
    return np.array([float(f"{value:.{digits}g}") for value in signal])


def mass_under(gain: float, damping: float, mass: float, scale: float, seed: int) -> Record:
    """A mass in viscous friction under a PD law of its own gains [N/m, N s/m], by matrices; scale [m] of the way."""
    ts, count = 1e-3, 4_000
    state = (np.array([[0.0, 1.0], [0.0, -2.0 / mass]]), np.array([[0.0], [1 / mass]]), np.eye(2), np.zeros((2, 1)))
    a, b, *_ = cont2discrete(state, ts)
    draw = np.random.default_rng(seed)
    wave = 1.5 * np.sin(2 * np.pi * np.cumsum(np.linspace(0.5, 2.0, count)) * ts)
    reference = np.clip(wave, -1, 1) * scale  # with rests
    position, command, x, before = np.empty(count), np.empty(count), np.zeros(2), 0.0
    for k in range(count):
        position[k] = x[0] + 1e-4 * scale * draw.standard_normal()
        error = reference[k] - position[k]
        command[k] = gain * error + damping * (error - before) / ts
        before = error
        x = a @ x + b[:, 0] * (command[k] + 0.05 * gain * scale * np.sign(-x[1]))
    return Record(ts, reference, reference, np.zeros(count), command, position)


@pytest.mark.parametrize(("gain", "damping", "mass"), [(4e4, 400.0, 10.0), (9.0, 0.3, 0.01), (5e6, 2e5, 8e3)])
@pytest.mark.parametrize("scale", [1e-6, 0.1])
def test_any_stable_loop_shows_which_is_the_reference(gain: float, damping: float, mass: float, scale: float) -> None:
    record = mass_under(gain, damping, mass, scale, 1)
    assert not acts_against_the_reference(record)
    assert acts_against_the_reference(swapped(record))


@pytest.mark.parametrize("kind", ["excitation", "hysteresis", "motions"])
def test_records_of_the_table_are_told_too(kind: str) -> None:
    make: Mapping[str, Callable[..., Record]] = vars(own_records)
    record = make[kind](own_records.noisy(MACHINE), 1)
    assert not acts_against_the_reference(record)
    assert acts_against_the_reference(swapped(record))


def under(reference: Array, feedforward: Array, held: Callable[[float, float], float], limit: float = np.inf) -> Record:
    """A mass of 10 kg with friction under a PID law of 40 kN/m, whose proportional part takes `held` of error and
    position [m]; its thrust is cut off at a limit [N]. The log is rounded, as the scale is."""
    ts, kp, ki, kd = 1e-3, 4e4, 8e5, 400.0
    x = v = integral = before = 0.0
    position, command = np.empty(reference.size), np.empty(reference.size)
    for k, wanted in enumerate(reference):
        position[k] = round(x / 1e-9) * 1e-9
        error = wanted - position[k]
        moved = held(error, position[k])
        force = kp * moved + integral + kd * (moved - before) / ts + feedforward[k]
        command[k] = min(max(force, -limit), limit)
        integral += ki * ts * error if abs(force) < limit else 0.0
        before = moved
        v += ts / 10.0 * (command[k] - 5.0 * np.tanh(v / 1e-4) - 50.0 * v)
        x += ts * v
    logged = np.round(reference / 1e-8) * 1e-8
    return Record(ts, logged, logged, feedforward, command, position)


STROKES = 1e-2 * np.sin(2 * np.pi * 0.7e-3 * np.arange(4000)) ** 3
NOTHING = np.zeros(STROKES.size)
INERTIA = 10.0 * np.gradient(np.gradient(STROKES, 1e-3), 1e-3)
LOOPS = {
    "of the error": under(STROKES, NOTHING, lambda error, _: error),
    "with feedforward": under(STROKES, INERTIA, lambda error, _: error),
    "set-point weights of zero": under(STROKES, NOTHING, lambda _, position: -position),
    "a set-point weight of 0.3": under(STROKES, NOTHING, lambda error, position: 0.3 * error - 0.7 * position),
    "saturated": under(3 * STROKES, NOTHING, lambda error, _: error, 12.0),
}


@pytest.mark.parametrize("name", LOOPS)
def test_what_a_loop_of_unknown_gains_makes_is_taken_as_it_is(name: str) -> None:
    assert mistake(LOOPS[name], None, 0) is None


@pytest.mark.parametrize("name", ["of the error", "with feedforward"])
def test_a_set_point_that_is_rounded_in_the_log_does_not_hide_a_swap(name: str) -> None:
    """The rounding makes coefficients of a smooth set point look sure, which are nothing beside those of the scale."""
    assert mistake(swapped(LOOPS[name]), None, 0) is Mistake.EITHER


def test_a_turned_command_of_unknown_gains_shows_beside_its_feedforward() -> None:
    record = LOOPS["with feedforward"]
    assert mistake(replace(record, command=-record.command), None, 0) is Mistake.EITHER


@pytest.mark.parametrize("kind", ["excitation", "hysteresis", "motions"])
def test_the_stated_controller_tells_a_turned_command_from_swapped_signals(kind: str) -> None:
    make: Mapping[str, Callable[..., Record]] = vars(own_records)
    record, control = make[kind](own_records.noisy(MACHINE), 2), MACHINE.control
    law = control.feedback, control.reference_delay
    assert mistake(record, *law) is None
    assert mistake(swapped(record), *law) is Mistake.SWAPPED
    assert mistake(replace(record, command=-record.command), *law) is Mistake.TURNED


def test_where_the_replay_leaves_it_open_the_signs_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a user's cascade with a feedforward that is not logged: swapped, it leaves 0.095 of the command where 0.57
    were left, which is less than a tenth but not by far less, and nothing was said."""
    left = iter((0.569, 0.095, 1.0, 0.569, 1.0, 0.095, 0.569, 1.0, 0.095, 1.0))
    monkeypatch.setattr("models.records.feedback_sign._left", lambda *_: next(left))
    law = MACHINE.control.feedback, MACHINE.control.reference_delay
    assert mistake(swapped(LOOPS["of the error"]), *law) is Mistake.EITHER
    assert mistake(LOOPS["of the error"], *law) is None


def test_a_turned_command_shows_at_a_reference_that_stands_still() -> None:
    still = own_records.run(own_records.noisy(MACHINE), NOTHING, 20 * np.sin(np.arange(STROKES.size) / 50), 3)
    law = MACHINE.control.feedback, MACHINE.control.reference_delay
    assert mistake(still, *law) is None
    assert mistake(replace(still, command=-still.command), *law) is Mistake.TURNED
    assert mistake(replace(still, feedforward=-still.feedforward), *law) is Mistake.FEEDFORWARD
    both = replace(still, command=-still.command, feedforward=-still.feedforward)
    assert mistake(both, *law) is Mistake.BOTH  # as where both columns are currents, with a factor of the wrong sign
    (told,) = doubts(both, GIVEN, Facts(pid=law[0], reference_delay=law[1]))
    assert told.startswith("the signs of command and feedforward look turned")


@pytest.mark.parametrize("digits", [6, 8, 10, 12, 15])
def test_a_reference_on_the_grid_of_its_digits_is_not_taken_for_the_position(digits: int) -> None:
    """The reference of a coarse profile lies on a grid, and the position, of another unit's digits, on none."""
    record = mass_under(4e4, 400.0, 10.0, 0.1, 2)
    coarse = np.round(record.reference / 4.2118e-7) * 4.2118e-7
    reference, position = rounded(coarse, digits), rounded(record.position, digits)
    export = replace(record, reference=reference, target=reference, position=position)
    assert not [doubt for doubt in doubts(export, GIVEN, Facts()) if "swapped" in doubt]


def test_nothing_is_said_of_a_command_that_no_feedback_made() -> None:
    record = mass_under(4e4, 400.0, 10.0, 0.1, 3)
    draw = np.random.default_rng(4)
    force = replace(record, command=draw.standard_normal(record.command.size))
    assert not acts_against_the_reference(force)
    assert not acts_against_the_reference(swapped(force))
    assert not acts_against_the_reference(swapped(record.part(0, 100)))


@pytest.mark.skipif(not EMPS.is_dir(), reason="needs the measured records beside the project")
@pytest.mark.parametrize("name", ["DATA_EMPS", "DATA_EMPS_PULSES"])
@pytest.mark.parametrize("digits", [8, 10, 12, 15])
def test_a_measured_axis_exported_with_any_digits_is_not_refused(name: str, digits: int) -> None:
    content = loadmat(EMPS / f"{name}.mat", squeeze_me=True)
    reference, position, command = (rounded(content[key][:12_000], digits) for key in ("qg", "qm", "vir"))
    for feedforward in (0 * command, content.get("pulses_N", 0 * content["vir"])[:12_000]):
        record = Record(1e-3, reference, reference, 35.15 * feedforward, 35.15 * command, position)
        assert not [doubt for doubt in doubts(record, GIVEN, Facts()) if "swapped" in doubt]
    assert acts_against_the_reference(swapped(record))
