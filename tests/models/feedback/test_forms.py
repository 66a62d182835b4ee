"""What a machine file states of a feedback: its filters, its forms, its round trip and its refusals."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import sosfreqz

from design.loop import controller_response
from models.controller import PID
from models.feedback.forms import NO_FILTERS, Cascade, Filters, LowPass, Notch, Section, law_of, nearest_pid, sections
from models.machine import DEFAULT, Machine, MachineError, Provenance, load, parameters, to_json, with_pid
from models.machine_file import to_toml
from tests.models.feedback.axis import CASCADE, FILTERS, TS

TEXT = DEFAULT.read_text(encoding="utf-8")
PID_TABLE = TEXT[TEXT.index("[control.pid]") : TEXT.index("[specification]")]
CASCADE_TABLE = """[control.cascade]
position_gain = { value = "85 1/s", source = "datasheet: the drive's parameters" }
velocity_gain = "4000 N s/m"
integral_time = "12 ms"
"""
IDEAL_TABLE = '[control.pid]\nkp = "1e6 N/m"\nintegral_time = "12 ms"\n'


def machine_with(folder: Path, feedback: str, control: str = "") -> Machine:
    """The default machine with another feedback, and more in [control]."""
    path = folder / "machine.toml"
    text = TEXT.replace(PID_TABLE, f"{feedback}\n").replace("[control]\n", f"[control]\n{control}\n")
    path.write_text(text, encoding="utf-8")
    return load(path)


@pytest.mark.parametrize("depth", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("frequency", [35.0, 140.0, 1500.0])
def test_a_notch_has_its_depth_at_its_frequency_and_leaves_the_rest(frequency: float, depth: float) -> None:
    rows = sections(Filters(notch=(Notch(frequency, 0.3, depth),)), TS)
    _, found = sosfreqz(rows, [0.0, frequency, 0.5 / TS], fs=1 / TS)
    assert np.abs(found) == pytest.approx([1.0, depth, 1.0], abs=1e-9)


def test_filters_are_the_continuous_ones_where_the_sampling_is_fast() -> None:
    filters = Filters(notch=(Notch(140.0, 0.4, 0.1),), low_pass=(LowPass(300.0),))
    frequency = np.array([10.0, 90.0, 140.0, 200.0, 300.0])
    _, found = sosfreqz(sections(filters, 1e-6), frequency, fs=1e6)
    s = 2j * math.pi * frequency
    w, c = 2 * math.pi * 140.0, 2 * math.pi * 300.0
    expected = (s**2 + 2 * 0.1 * 0.4 * w * s + w**2) / (s**2 + 2 * 0.4 * w * s + w**2)
    expected = expected * c**2 / (s**2 + math.sqrt(2) * c * s + c**2)
    assert found == pytest.approx(expected, rel=1e-4)
    assert abs(found[-1] / expected[-1]) == pytest.approx(1, rel=1e-6)  # prewarped


def test_the_filters_act_on_the_feedback_s_loop() -> None:
    omega = np.geomspace(1, 0.99 * math.pi / TS, 50)
    bare, filtered = (law_of(CASCADE, one, 0.0, TS) for one in (NO_FILTERS, FILTERS))
    _, expected = sosfreqz(sections(FILTERS, TS), omega, fs=2 * math.pi / TS)
    ratio = controller_response(filtered, TS, omega) / controller_response(bare, TS, omega)
    assert ratio == pytest.approx(expected, rel=1e-8)


def test_the_nearest_pid_has_the_cascade_s_loop_where_no_speed_is_filtered() -> None:
    omega = np.geomspace(1, 0.99 * math.pi / TS, 50)
    pid = nearest_pid(CASCADE)
    law = controller_response(law_of(CASCADE, NO_FILTERS, 0.0, TS), TS, omega)
    assert controller_response(pid, TS, omega) == pytest.approx(law, rel=1e-9)
    assert (pid.kp, pid.ki, pid.kd) == pytest.approx((4000 * (85 + 1 / 12e-3), 4000 * 85 / 12e-3, 4000))


def test_a_cascade_with_filters_survives_its_machine_file(tmp_path: Path) -> None:
    filters = """
[[control.filters.notch]]
frequency = { value = "140 Hz", source = "datasheet: current set-point filter 1" }
damping = "0.4"
[[control.filters.low_pass]]
frequency = "400 Hz"
[[control.filters.section]]
numerator = [1]
denominator = ["2", 0.1, 0.2]
"""
    machine = machine_with(tmp_path, CASCADE_TABLE + filters, 'anti_windup = "2 ms"')
    control = machine.control
    assert control.cascade == Cascade(85.0, 4000.0, 12e-3)
    assert control.filters == Filters((Notch(140.0, 0.4),), (LowPass(400.0),), (Section((1.0,), (2.0, 0.1, 0.2)),))
    assert control.anti_windup == 2e-3
    assert machine.sources["control.filters.notch.1.frequency"].detail == "current set-point filter 1"
    again = tmp_path / "again.toml"
    again.write_text(to_toml(machine), encoding="utf-8")
    assert load(again) == machine
    assert load(again).sources == machine.sources
    assert "pid" not in to_json(machine)["control"]  # it follows from the cascade
    assert to_json(machine)["control"]["cascade"]["position_gain_per_s"] == 85.0
    names = [one.name for one in parameters(machine)]
    assert "control.cascade.velocity_gain" in names
    assert not [name for name in names if name.startswith("control.pid")]
    assert control.in_words == ("a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms, 3 filters and an anti-windup of 2 ms")


def test_a_value_of_the_cascade_can_be_changed_and_its_pid_follows(tmp_path: Path) -> None:
    machine = machine_with(tmp_path, CASCADE_TABLE)
    changed = machine.with_value("control.cascade.position_gain", 60.0, Provenance("assumed", "a test"))
    assert changed.control.cascade == replace(
        CASCADE, position_gain=60.0, velocity_feedforward=0.0, acceleration_feedforward=0.0
    )
    assert changed.control.pid.ki == pytest.approx(4000 * 60 / 12e-3)
    tuned = with_pid(changed, PID(1e6, 2e7, 3e3, 0.0), "a test")
    assert tuned.control.law is None
    assert not [name for name in tuned.sources if name.startswith("control.cascade")]


def test_a_pid_in_ideal_form_is_the_parallel_one(tmp_path: Path) -> None:
    table = IDEAL_TABLE + 'derivative_time = { value = "3 ms", source = "datasheet: Td" }\nderivative_filter = "0.1 ms"'
    machine = machine_with(tmp_path, table)
    pid = machine.control.pid
    assert (pid.kp, pid.ki, pid.kd) == pytest.approx((1e6, 1e6 / 12e-3, 3e3))
    assert machine.sources["control.pid.kd"] == Provenance(
        "derived", "kp and a derivative_time of 3 ms (datasheet: Td)"
    )
    assert machine_with(tmp_path, IDEAL_TABLE).control.pid == PID(1e6, 1e6 / 12e-3, 0.0, 0.0)  # a PI
    assert machine.control.law is None


def test_set_point_weights_make_a_law(tmp_path: Path) -> None:
    weighted = machine_with(tmp_path, PID_TABLE + "derivative_weight = 0")
    assert weighted.control.pid.derivative_weight == 0
    assert weighted.control.law == law_of(weighted.control.pid, NO_FILTERS, 0.0, weighted.sample_time)
    assert weighted.control.in_words == "a PID with set-point weights of 1 and 0"


SPOILT = {
    "neither": ("", "", r"control\.pid: missing; add it, or control\.cascade"),
    "both": (PID_TABLE + CASCADE_TABLE, "", r"control\.pid: control\.cascade is stated as well.*leave one out"),
    "two forms": (IDEAL_TABLE + 'kd = "3 N s/m"', "", r"control\.pid\.kd: must not stand beside integral_time"),
    "a wrong unit": (IDEAL_TABLE.replace("12 ms", "12 N"), "", r"control\.pid\.integral_time: '12 N' is in N"),
    "a deviation": (
        IDEAL_TABLE.replace('"12 ms"', '{ value = "12 ms", std = "1 ms" }'), "", r"time\.std: is not used here",
    ),
    "no gain": (CASCADE_TABLE.replace("85 1/s", "0 1/s"), "", r"position_gain: 0 1/s must be above 0 1/s"),
    "a typing error": (CASCADE_TABLE + 'velocity_filer = "1 ms"', "", r"did you mean 'velocity_filter'"),
    "beyond Nyquist": (
        CASCADE_TABLE + '[[control.filters.notch]]\nfrequency = "1.2 kHz"\ndamping = 1', "",
        r"filters\.notch\.1\.frequency: 1\.2 kHz is not below the Nyquist frequency 1 kHz",
    ),
    "an unstable section": (
        CASCADE_TABLE + "[[control.filters.section]]\nnumerator = [1]\ndenominator = [1, -1.2]", "",
        r"filters\.section\.1: denominator: the section is unstable",
    ),
    "a section that holds nothing": (
        CASCADE_TABLE + "[[control.filters.section]]\nnumerator = [1, -1]\ndenominator = [1, -0.2]", "",
        r"filters\.section\.1: numerator: a constant does not pass",
    ),
    "many filters": (
        CASCADE_TABLE + '[[control.filters.low_pass]]\nfrequency = "90 Hz"\n' * 21, "", r"21 are more than 20",
    ),
    "a table for a list": (
        CASCADE_TABLE + '[control.filters]\nfrequency = "1 Hz"', "", r"filters\.frequency: unknown; known here: notch",
    ),
    "a fast anti-windup": (CASCADE_TABLE, 'anti_windup = "0.1 ms"', r"anti_windup: 100 µs is below"),
    "nothing winds up": (
        CASCADE_TABLE.replace("12 ms", "0 ms"), 'anti_windup = "1 ms"', r"anti_windup: there is no integral",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SPOILT)
def test_what_cannot_run_is_refused_in_a_line(case: str, tmp_path: Path) -> None:
    feedback, control, said = SPOILT[case]
    with pytest.raises(MachineError, match=said) as refused:
        machine_with(tmp_path, feedback, control)
    assert "\n" not in str(refused.value)
