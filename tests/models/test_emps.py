"""The measured EMPS record: its authors' published figures to the printed digits, and what our friction adds.

The record has no licence and is no part of the project: without it beside the project these tests skip.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, cheby1, sosfiltfilt

from models.identification.force.by_elements import identify
from models.identification.force.signals import Terms
from models.identification.inverse_dynamics import regress
from models.machine import Machine
from models.machine import load as load_machine
from models.records.files import load
from models.records.record import Record, cut
from models.simulation.effect_kernel import Path, replay
from studies.command import DONE, main
from studies.identify_machine.__main__ import STUDY

DATA = File(__file__).parents[3] / "shared" / "data" / "emps" / "DATA_EMPS.mat"
MACHINE = File(__file__).parents[2] / "models" / "machines" / "emps.toml"


def test_the_machine_file_is_complete() -> None:
    machine = load_machine(MACHINE)
    assert machine.friction.coulomb_force == pytest.approx(20.3935, rel=1e-6)
    assert 1 / machine.plant.modes[0].gain == pytest.approx(95.1089, rel=1e-4)
    assert [effect.values().tolist() for effect in machine.effects] == [[203.5034]]
    assert machine.drive.offset == -3.1648
    assert machine.record is not None
    assert machine.record.source("command").factor == pytest.approx(35.1507, rel=1e-5)


@pytest.fixture(scope="module")
def record() -> Record:
    """The measured record through the machine file's mapping."""
    if not DATA.is_file():
        pytest.skip("needs DATA_EMPS.mat beside the project")
    machine = load_machine(MACHINE)
    content = load(DATA, machine.record, sample_time=machine.sample_time, mass=95.0, limit=351.5).content
    assert isinstance(content, Record)
    return content


def test_the_published_figures_come_out_to_the_printed_digits(record: Record) -> None:
    found = regress(record, cutoff=100.0)
    assert [f"{value:.4f}" for value in found.estimate.values] == ["95.1089", "203.5034", "20.3935", "-3.1648"]
    assert f"{100 * found.error():.4f}" == "4.0834"
    assert f"{100 * regress(record, cutoff=100.0, by_direction=True).error():.4f}" == "3.1117"


def test_the_projects_friction_does_better_where_it_was_not_fitted(record: Record) -> None:
    half = 0.5 * record.position.size * record.sample_time
    published = regress(record, cutoff=100.0, by_direction=True, fit_until=half)
    likely = max(load_machine(MACHINE).friction.limit)
    terms = Terms(viscous=True, by_direction=True, bent=True, delay=True, likely_limit=likely)
    ours = identify(record, terms, pass_band=40.0, fit_until=half)
    judged = ~published.used & (published.time <= ours.time[-1])
    left = (published.measured - published.modelled)[judged]
    theirs = float(np.linalg.norm(left) / np.linalg.norm(published.measured[judged]))
    assert ours.error(used=False) < 0.85 * theirs
    assert ours.estimate.value("mass") == pytest.approx(95.1, rel=0.01)


def test_it_is_cut_into_its_strokes(record: Record) -> None:
    found = cut(record)
    assert len(found) == 8
    assert [motion.direction for motion in found] == [1, -1] * 4


def test_the_study_writes_a_machine_file_of_it_that_is_as_good_as_the_fit(tmp_path: File, record: Record) -> None:
    arguments = [str(DATA), "--machine", str(MACHINE), "--output", str(tmp_path)]
    assert main(STUDY, arguments) == DONE
    machine = load_machine(tmp_path / "identified.toml")
    assert machine.sources["plant.modes.1.gain"].kind == "identified"
    assert machine.sources["friction.limit"].sha256.startswith("6cf6814ae146")
    assert [effect.name for effect in machine.effects] == ["viscous_friction", "directional_friction"]
    assert machine.effects[0].values()[0] == pytest.approx(203.5, rel=0.02)
    for name in ("effects.viscous_friction.coefficient", "drive.offset"):
        assert machine.sources[name].sha256.startswith("6cf6814ae146")
    content = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["results"]
    ladder = content["dynamics"]["ladder"]
    assert {file.stem for file in (tmp_path / "figures").iterdir()} == {"dynamics", "friction"}
    rows = {row["name"]: row for row in content["parameters"]}
    assert rows["drive.offset"]["record"].endswith("DATA_EMPS.mat")
    assert rows["drive.offset"]["std"] == pytest.approx(0.455, abs=0.01)
    assert machine.tolerances.offset == pytest.approx(351.5 / 750)  # the usual one: the record's is no larger
    assert len(rows["friction.limit"]["std"]) == len(rows["friction.limit"]["number"]) == 2
    fit, written = ladder[3]["held_out"], ladder[-1]["held_out"]
    assert fit < written < 1.01 * fit
    assert _held_out(machine, record) == pytest.approx(written, rel=0.05)
    nothing_held = replace(machine, drive=replace(machine.drive, offset=0.0))
    assert _held_out(nothing_held, record) > 1.2 * fit  # so that the offset is what is judged here


def _held_out(machine: Machine, record: Record) -> float:
    """The force error of a machine file along the measured path, by the simulator's own replay of it, over the force:
    second half of the record, as far as 40 Hz."""
    n, ts, parts = record.position.size, record.sample_time, 4
    path = sosfiltfilt(butter(4, 5.6 * 40 * 2 * ts, output="sos"), record.position)
    course = CubicSpline(np.arange(n) * ts, path)
    middles = (np.arange(n)[:, None] + (np.arange(parts) + 0.5) / parts) * ts + machine.plant.dead_time
    along = Path(ts, course(middles), course(middles, 1), path, record.command)
    friction = replay(machine.friction, machine.effects, along, 0.0).friction
    force = np.mean(course(middles, 2) / machine.plant.modes[0].gain + friction, axis=1) + machine.drive.offset
    low = cheby1(8, 0.05, 40 * 2 * ts, output="sos")
    measured, left = (sosfiltfilt(low, signal)[n // 2 : -100] for signal in (record.command, record.command - force))
    return float(np.linalg.norm(left) / np.linalg.norm(measured))
