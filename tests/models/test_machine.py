"""Machine files: what the paper publishes is in the default one, and every mistake gets its sentence."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.controller import PID, references
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging
from models.friction import branch
from models.machine import (
    DEFAULT,
    SOURCES,
    Machine,
    MachineError,
    Provenance,
    Scale,
    Tolerance,
    load,
    parameters,
    to_json,
    with_derived_presliding,
    with_pid,
)
from models.machine_file import to_toml
from models.plant import Mode, Plant

TEXT = DEFAULT.read_text(encoding="utf-8")


def changed(folder: Path, old: str, new: str) -> Path:
    """A copy of the default machine file with the first match of a regular expression replaced."""
    text, count = re.subn(old, new, TEXT, count=1)
    assert count == 1
    path = folder / "machine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def without(folder: Path, table: str) -> Path:
    """A copy of the default machine file without one table."""
    before, _, rest = TEXT.partition(f"[{table}]")
    _, _, after = rest.partition("\n[")
    path = folder / "machine.toml"
    path.write_text(before + ("[" + after if after else ""), encoding="utf-8")
    return path


def test_the_default_machine_is_the_published_one() -> None:
    machine = load()
    assert machine.drive.rated_thrust == 150
    assert machine.drive.rated_power == 1000
    assert machine.drive.rated_speed == 2.4
    assert machine.drive.current_loop_bandwidth == 750
    assert machine.scale.resolution == 1e-7
    assert machine.sample_time == 5e-4
    assert [mode.frequency for mode in machine.plant.modes] == [0, 38, 81]
    assert machine.control.reference_delay == 2
    assert machine.control.compensator_elements == 5
    assert len(machine.friction.limit) == 10
    assert machine.presliding.coulomb_force == 16.5
    assert (machine.presliding.stiffness_1, machine.presliding.stiffness_2) == (8e5, 1e5)
    wanted = machine.specification
    assert (wanted.stroke, wanted.tolerance, wanted.settling_time) == (20e-6, 2e-6, 25e-3)
    assert (wanted.interval, wanted.reference_settling_time, wanted.motions) == (0.5, 20e-3, 5)


def test_the_elements_agree_with_the_published_curve() -> None:
    """T_fc, 800 N/mm over the first 20 um, 100 N/mm beyond, up to about 2 x 100 um, each to the 3 % of the set."""
    machine = load()
    end = 2 * max(machine.friction.limit)
    climbed = branch(machine.friction, [20e-6, end, 1e-3])
    assert 80e-6 < end / 2 < 120e-6
    assert climbed[0] / 20e-6 == pytest.approx(8e5, rel=0.03)
    assert (climbed[1] - climbed[0]) / (end - 20e-6) == pytest.approx(1e5, rel=0.03)
    assert climbed[2] == pytest.approx(2 * 16.5, rel=1e-3)
    assert "N/mm" in machine.sources["presliding.stiffness_1"].note


def test_every_value_has_a_source() -> None:
    found = parameters(load())
    assert len(found) > 30
    for parameter in found:
        assert parameter.provenance.kind in SOURCES, parameter.name
        assert parameter.provenance.detail, parameter.name


def test_the_machine_in_results_has_the_agreed_names() -> None:
    machine = to_json(load())
    assert set(machine) >= {"name", "sample_time_s", "plant", "friction", "drive", "scale"}
    assert set(machine["plant"]) == {"dead_time_s", "thrust_constant", "modes"}
    assert set(machine["plant"]["modes"][0]) == {"gain_per_kg", "frequency_Hz", "damping"}
    assert set(machine["friction"]) == {"stiffness_N_per_m", "limit_m", "damping_Ns_per_m"}
    assert machine["drive"]["rated_thrust_N"] == 150
    assert machine["scale"]["resolution_m"] == 1e-7


ELEMENTS = r"compensator_elements = .*"


@pytest.mark.parametrize("entry", ['"auto"', '{ value = "auto", source = "assumed: chosen by the study" }'])
def test_the_number_of_compensator_elements_may_be_left_to_the_study(entry: str, tmp_path: Path) -> None:
    machine = load(changed(tmp_path, ELEMENTS, f"compensator_elements = {entry}"))
    assert machine.control.compensator_elements == "auto"
    assert to_json(machine)["control"]["compensator_elements"] == "auto"
    row = next(one for one in parameters(machine) if one.name == "control.compensator_elements")
    assert row.number == "auto"
    assert row.provenance.kind == "assumed"
    text = to_toml(machine)
    assert 'compensator_elements = { value = "auto", source = "assumed: ' in text
    copy = tmp_path / "copy.toml"
    copy.write_text(text, encoding="utf-8")
    assert load(copy) == machine
    assert to_toml(load(copy)) == text


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('"Auto"', """'Auto' must be a whole number; write one without quotes and unit, such as 2, or "auto\""""),
        ('"7"', """'7' must be a whole number; write one without quotes and unit, such as 2, or "auto\""""),
        ("2.5", """2.5 must be a whole number; write one without quotes and unit, such as 2, or "auto\""""),
        ('["auto"]', """['auto'] must be a whole number; write one without quotes and unit, such as 2, or "auto\""""),
        ("0", "0 must be at least 1"),
        ("101", "101 must be below 101"),
    ],
)
def test_any_other_word_for_the_number_of_elements_is_refused(entry: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(MachineError) as refused:
        load(changed(tmp_path, ELEMENTS, f"compensator_elements = {entry}"))
    assert str(refused.value).endswith(f"control.compensator_elements: {said}")
    with pytest.raises(MachineError, match=r"reference_delay: \'auto\' must be a whole number; .*such as 2$"):
        load(changed(tmp_path, r"reference_delay = .*", 'reference_delay = "auto"'))


def test_facts_that_a_file_leaves_out_follow_from_its_elements(tmp_path: Path) -> None:
    machine = load(without(tmp_path, "presliding"))
    assert machine.presliding.coulomb_force == machine.friction.coulomb_force
    assert machine.presliding.stiffness_1 == pytest.approx(8e5, rel=0.03)
    assert machine.sources["presliding.boundary"].kind == "derived"
    assert load(without(tmp_path, "published")).published is None


def test_a_value_without_a_source_counts_as_assumed(tmp_path: Path) -> None:
    machine = load(changed(tmp_path, '{ value = "150 N", source = "paper: II.A" }', '"150 N"'))
    assert machine.sources["drive.rated_thrust"].kind == "assumed"


def test_an_offset_that_no_file_states_is_none_and_is_not_listed(tmp_path: Path) -> None:
    assert load().drive.offset == 0
    assert "offset_N" not in to_json(load())["drive"]
    stated = load(changed(tmp_path, r"\[drive\]", '[drive]\noffset = { value = "-3 N", source = "datasheet: 4" }'))
    assert stated.drive.offset == to_json(stated)["drive"]["offset_N"] == -3
    rows = {row.name: row.provenance.kind for row in parameters(stated)}
    assert rows["drive.offset"] == "datasheet"
    assert len(rows) == len(parameters(load())) + 1


def test_how_well_a_value_is_known_can_be_stated(tmp_path: Path) -> None:
    """Some of them; what the file leaves out is as usual, and no file has to state any."""
    stated = load(changed(tmp_path, r"\[scale\]", '[tolerance]\noffset = "3 N"\nmass = 0.03\n\n[scale]'))
    assert stated.tolerance == Tolerance(offset=3.0, mass=0.03)
    assert {"offset_N": 3.0, "mass": 0.03}.items() <= to_json(stated)["tolerance"].items()
    assert "tolerance" not in to_json(load())
    more = {row.name for row in parameters(stated)} - {row.name for row in parameters(load())}
    assert more == {"tolerance.offset", "tolerance.mass"}
    again = tmp_path / "again.toml"
    again.write_text(to_toml(stated), encoding="utf-8")
    assert load(again) == stated
    assert "[tolerance]" not in to_toml(load())


def test_what_is_usual_is_so_for_an_axis_of_this_size() -> None:
    """The paper's table keeps 0.2 N and 20 us; of a galvo these were its rated torque, and its whole sample time."""
    table = load()
    assert (table.tolerances.offset, table.tolerances.dead_time) == (0.2, 2e-5)
    small = replace(
        table,
        drive=replace(table.drive, rated_thrust=0.2),
        friction=replace(table.friction, stiffness=tuple(1e-5 * k for k in table.friction.stiffness)),
        control=replace(table.control, sample_time=2e-5),
    )
    assert small.tolerances.offset == pytest.approx(0.05 * small.friction.coulomb_force)
    assert small.tolerances.dead_time == pytest.approx(8e-7)
    stated = replace(small, tolerance=Tolerance(offset=0.01, dead_time=1e-6))
    assert stated.tolerances == stated.tolerance


def test_a_tolerance_that_is_stated_to_be_the_usual_one_keeps_its_source(tmp_path: Path) -> None:
    text = '[tolerance]\noffset = { value = "0.2 N", source = "datasheet: 4" }\n\n[scale]'
    stated = load(changed(tmp_path, r"\[scale\]", text))
    assert 'source = "datasheet: 4"' in to_toml(stated)
    assert [row.number for row in parameters(stated) if row.name == "tolerance.offset"] == [0.2]


MODE = '[[plant.modes]]\ngain = "0.001 1/kg"\nfrequency = "100 Hz"\ndamping = "0.02"\n'


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (r"\[scale\]", '[tolerance]\noffset = "0 N"\n\n[scale]', r"tolerance\.offset: .*above 0"),
        (r"\[scale\]", "[tolerance]\nmass = 1.5\n\n[scale]", r"tolerance\.mass: .*below 1"),
        (r"\[scale\]", '[tolerance]\nofset = "1 N"\n\n[scale]', r"tolerance\.ofset: unknown; did you mean 'offset'"),
        ('"800 N/mm"', '"800 kg"', r"presliding\.stiffness_1: '800 kg' is in kg, but this is a quantity in N/m"),
        ('"150 N"', '"150"', r"drive\.rated_thrust: '150' has no unit"),
        ("rated_thrust =", "rated_trust =", r"drive\.rated_trust: unknown; did you mean 'rated_thrust'\?"),
        (r"\[drive\]", '[drive]\noffset = "150 N"', r"drive\.offset: the drive can't hold 150 N within drive\.rated"),
        (
            r"\[scale\]",
            '[[record]]\nfiles = "a.csv"\n\n[scale]',
            r"record: .*tables \[\[record\]\] for .* --mapping gives",
        ),
        (r"\[drive\]", "[driver]", r"driver: unknown; did you mean 'drive'\?"),
        ("dead_time = { value", "dead_time = { valu", r"plant\.dead_time\.valu: unknown; did you"),
        ('(38 Hz.*\ndamping = { value =) "', r'\1 "-', r"plant\.modes\.2\.damping: -0\.\d+ must be at least 0"),
        ('"38 Hz"', '"1.2 kHz"', r"plant\.modes\.2\.frequency: 1200 Hz is not below the Nyquist frequency 1000 Hz"),
        ('"38 Hz"', '"0 Hz"', r"plant\.modes: 2 rigid-body modes; exactly one needs"),
        ('"16.5 N"', '"nan N"', r"presliding\.coulomb_force: 'nan N' is not a finite number"),
        ('"16.5 N"', '"18 N"', r"friction: the elements slip at 16\.5 N together, presliding\.coulomb_force says 18 N"),
        (r'(stiffness = { value = \[)"[^"]*", ', r"\1", r"friction: .* as many stiffnesses as limits"),
        ("reference_delay = { value = 2", 'reference_delay = { value = "2 ms"', r"control\.reference_delay: .* whole"),
        ('"paper: II.D" }\ntolerance', '"hearsay" }\ntolerance', r"specification\.stroke: source 'hearsay'"),
        ('"38 Hz"', '"3 dB"', r"plant\.modes\.2\.frequency: '3 dB' is in dB, but this is a quantity in Hz"),
        (
            r'(# the rigid body\ngain = { value =) "[^"]*"',
            r'\1 "0 1/kg"',
            r"plant\.modes\.1\.gain: 0 1/kg must be above",
        ),
        (
            r'(# the rigid body\ngain = { value =) "[^"]*"',
            r'\1 "1e999999999 1/kg"',
            r"too large for a number|not a finite",
        ),
        ('(38 Hz.*\ndamping = { value =) "[^"]*"', r'\1 "1.5"', r"plant\.modes\.2\.damping: 1\.5 must be below 1"),
        (
            'interval = { value = "0.5 s"',
            'interval = { value = "22 ms"',
            r"specification: .* have to follow each other",
        ),
        ('"500 us"', '"2 us"', r"more than 100000 samples of control\.sample_time"),
        ('"500 us"', '"1 ns"', r"control\.sample_time: 1 ns must be at least 1 µs: controllers of axes"),
        (r"\[drive\]", "[drive", r"is not valid TOML"),
        (r"\[drive\]", "a = " + 5000 * "[" + 5000 * "]" + "\n[drive]", r"nested too deeply"),
        (r"\[drive\]", "a = " + 5000 * "9" + "\n[drive]", r"is not valid TOML"),
        ("motions = { value = 5", f"motions = {{ value = {10**400}", r"motions: inf must be below 101"),
        ("motions = { value = 5", "motions = { value = 1", r"motions: 1 must be at least 2"),
        ("motions = { value = 5", "motions = { value = nan", r"motions: nan must be a whole number"),
        (
            'stroke = { value = "20 um"',
            'stroke = { value = "1e308 um"',
            r"stroke: 1e\+293 Gm must be at most 100 m: no axis",
        ),
        ('stroke = { value = "20 um"', 'stroke = { value = "1e-320 um"', r"stroke: .* must be (above|at least)"),
        ('"38 Hz"', '"3.8e-5 Hz"', r"modes\.2\.frequency: 3\.8e-05 Hz is slower than 0\.1 Hz"),
        ('"0.00053517 1/kg"', '"535 1/kg"', r"modes\.3\.gain: 535 1/kg is 2\.\d+e\+04 times the rigid body's"),
        ('"0.00053517 1/kg"', '"1e-11 1/kg"', r"modes\.3\.gain: .* times the rigid body's"),
        ('thrust_constant = { value = "1"', 'thrust_constant = { value = "1e-9"', r"plant: a mass of .* is not from"),
        (r"\[presliding\]", 200 * MODE + "[presliding]", r"plant\.modes: 203 are more than 20, which would take"),
        ('interval = { value = "0.5 s"', 'interval = { value = "50 s"', r"motions to and fro .* 1000000 samples, more"),
        (r"(stiffness = { value = )\[[^]]*\]", r'\1["0 N/mm"' + 9 * ', "0 N/mm"' + "]", r"friction: no element has"),
        (r"(stiffness = { value = )\[[^]]*\]", r'\1["1 N/m"' + 900 * ', "1 N/m"' + "]", r"901 numbers are more than"),
        ('"500 us"', '"' + 5000 * "5" + ' fathoms"', r"sample_time: '5{50,60}.{10,25}fathoms'"),
        (r"\[drive\]", "[drive]\n" + 5000 * "x" + " = 1", r"^.{0,400}$"),
        ('name = "', 'name = "' + 300 * "x", r"name: 'x+ \.\.\. .* is longer than 200 characters"),
        (r"\[\[plant.modes\]\] # the rigid body", "[plant.modes]", r"is not valid TOML"),
    ],
)
def test_a_mistake_is_said_with_its_place(tmp_path: Path, old: str, new: str, says: str) -> None:
    with pytest.raises(MachineError, match=says) as error:
        load(changed(tmp_path, old, new))
    assert "machine.toml" in str(error.value)


def test_only_a_vibration_modes_gain_may_be_negative(tmp_path: Path) -> None:
    path = changed(tmp_path, '"0.00053517 1/kg"', '"-0.00053517 1/kg"')
    machine = load(path)
    assert machine.plant.modes[2].gain == -0.00053517
    path.write_text(to_toml(machine), encoding="utf-8")
    assert load(path) == machine
    rigid = r'(# the rigid body\ngain = { value =) "'
    with pytest.raises(MachineError, match=r"plant\.modes\.1\.gain: -0\.\d+ 1/kg must be above 0"):
        load(changed(tmp_path, rigid, r'\1 "-'))
    with pytest.raises(MachineError, match=r"plant\.modes\.1\.gain: -0\.02 1/kg must be above 0"):
        machine.with_value("plant.modes.1.gain", -0.02, Provenance("assumed", ""))


def test_a_missing_value_is_said_with_its_meaning_and_unit(tmp_path: Path) -> None:
    line = next(line for line in TEXT.splitlines() if line.startswith("dead_time"))
    with pytest.raises(MachineError, match=r"plant\.dead_time: missing; add it, equivalent dead time L, in s"):
        load(changed(tmp_path, re.escape(line) + "\n", ""))


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="can't be read"):
        load(tmp_path / "nowhere.toml")


def test_a_scale_without_stated_noise_is_assumed_to_have_some() -> None:
    silent, stated = Scale(1e-7, 0.0), Scale(1e-7, 2e-8)
    assert silent.deviation == pytest.approx(3e-8)
    assert silent.noisy() == Scale(1e-7, silent.deviation)
    assert stated.deviation == 2e-8
    assert stated.noisy() == stated


def test_feedback_alone_follows_its_target_with_the_pid_in_place() -> None:
    machine = load()
    alone = machine.feedback_only()
    target = np.linspace(0.0, 1e-5, 50)
    known = references(alone, target)
    assert known.position == pytest.approx(target)
    assert not np.any(known.feedforward)
    assert not np.any(known.compensation)
    assert (alone.pid, alone.reference_delay) == (machine.control.pid, machine.control.reference_delay)
    assert machine.feedback_only(7).reference_delay == 7


FOUND = Provenance("identified", "frequency response", "", "sweep.csv", "12ab", 2e-5)


def test_a_value_is_changed_together_with_its_source() -> None:
    machine = load()
    found = machine.with_value("plant.modes.1.gain", 0.05, FOUND)
    assert found.plant.modes[0].gain == 0.05
    assert found.sources["plant.modes.1.gain"] == FOUND
    assert found.plant.modes[1:] == machine.plant.modes[1:]
    assert {name for name in found.sources if found.sources[name] != machine.sources[name]} == {"plant.modes.1.gain"}
    cogging, drag = Cogging(1.0, 0.03, 0.0), ViscousFriction(40.0)
    rough = replace(machine, effects=(cogging, drag, replace(cogging, pitch=0.01)))
    again = rough.with_value("effects.cogging.2.pitch", 0.02, FOUND).with_value(
        "effects.viscous_friction.coefficient", 30.0, FOUND
    )
    assert [again.effects[0], again.effects[1:]] == [cogging, (ViscousFriction(30.0), replace(cogging, pitch=0.02))]
    (row,) = (row for row in parameters(again) if row.name == "effects.cogging.2.pitch")
    assert row.provenance == FOUND


@pytest.mark.parametrize("name", ["plant.modes.4.gain", "plant.mode", "plant.modes.1", "name", "effects.cogging.pitch"])
def test_a_value_that_a_machine_has_not_is_said(name: str) -> None:
    with pytest.raises(MachineError, match=f"^{name}: "):
        load().with_value(name, 1.0, FOUND)


def test_a_value_out_of_its_range_is_said() -> None:
    with pytest.raises(MachineError, match=r"plant\.dead_time: -1 s must be at least 0 s"):
        load().with_value("plant.dead_time", -1.0, FOUND)


def test_a_part_is_changed_together_with_its_sources() -> None:
    machine = load()
    plant = Plant(1e-3, 1.0, (Mode(0.02, 0.0, 0.0),))
    found = machine.with_part("plant", plant, {"modes.1.gain": FOUND})
    assert found.plant == plant
    assert {name: one for name, one in found.sources.items() if name.startswith("plant.")} == {
        "plant.modes.1.gain": FOUND
    }
    rows = {row.name: row.provenance for row in parameters(found)}
    assert rows["plant.dead_time"] == Provenance("assumed", "set in a program")
    tuned = with_pid(machine, PID(1.0, 2.0, 3.0, 4.0), "a rule")
    assert tuned.control.pid == PID(1.0, 2.0, 3.0, 4.0)
    assert tuned.sources["control.pid.kp"] == Provenance("derived", "a rule")


def test_a_machine_made_in_a_program_has_the_curve_of_its_elements() -> None:
    machine = load()
    made = Machine(
        "made", machine.drive, machine.scale, machine.plant, machine.friction, machine.control, machine.specification
    )
    assert made.presliding.coulomb_force == machine.friction.coulomb_force
    stroke = machine.specification.stroke
    assert made.presliding.stiffness_1 == pytest.approx(float(branch(machine.friction, stroke)) / stroke)
    assert with_derived_presliding(machine).presliding == made.presliding
    assert to_json(made)["presliding"]["boundary_m"] == stroke
