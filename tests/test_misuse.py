"""What a notebook hands over by mistake is refused in a sentence, and not computed with."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import positioning as pos
from models.records.checks import DoubtfulError
from tests.diagnosis.tables import recorded, short, table

MACHINE = pos.load_machine()
RIGID = table()
(RECORD,) = recorded(RIGID, (short(RIGID),), seed=1, wrong=0.0)
CONTROLLER = MACHINE.feedback_only()
TARGET = pos.feeding_sequence(20e-6, 2, 0.05, MACHINE.sample_time)


def simulated(**options: Any) -> object:
    return pos.simulate(MACHINE, CONTROLLER, **{"target": TARGET, **options})


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"target": np.append(TARGET, np.nan)}, "target: must be a row of finite numbers"),
        ({"target": TARGET[:, None]}, "target: must be a row of finite numbers of shape (n,)"),
        ({"target": 20e-6}, "target: must be a row"),
        ({"substeps": 1.5}, "substeps: must be a whole number from 1 on, not 1.5"),
        ({"substeps": 0}, "substeps: must be a whole number from 1 on, not 0"),
        ({"origin": np.nan}, "origin: must be a finite place"),
        ({"initial_friction": np.full(10, np.nan)}, "initial_friction: must be the displacements of 10 elements"),
        ({"initial_friction": 20 * np.array(MACHINE.friction.limit)}, "none far beyond its limit"),
        ({"initial_friction": [0.0]}, "initial_friction: must be the displacements of 10 elements"),
    ],
)
def test_nothing_impossible_is_simulated(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        simulated(**options)


def test_whole_numbers_of_any_type_are_substeps() -> None:
    one, other = (pos.simulate(MACHINE, CONTROLLER, TARGET, substeps=count) for count in (10, np.int64(10)))  # type: ignore[arg-type]
    assert np.array_equal(one.position, other.position)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"settling_time": 48.0}, "a settling time of 48 s is 96000 samples"),
        ({"constraints": lambda: pos.Constraints(overshoot=-0.1)}, "the overshoot must be at least 0"),
        ({"constraints": lambda: pos.Constraints(thrust=0.0)}, "which moves nothing"),
    ],
)
def test_a_deadbeat_that_nothing_can_be_is_refused_at_once(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(pos.DesignError, match=sentence):
        pos.design_deadbeat(MACHINE, **{name: one() if callable(one) else one for name, one in options.items()})


@pytest.mark.parametrize(("sample_time", "stroke"), [(-5e-4, 20e-6), (0.0, 20e-6), (5e-4, -20e-6), (5e-4, np.inf)])
def test_no_settling_time_is_negative(sample_time: float, stroke: float) -> None:
    with pytest.raises(pos.DesignError):
        pos.shortest_settling_time(MACHINE.plant, sample_time, stroke, pos.Constraints())


def test_a_deadbeat_of_another_sample_time_is_not_assembled() -> None:
    slower = replace(MACHINE, control=replace(MACHINE.control, sample_time=1e-3))
    with pytest.raises(
        ValueError, match="designed for samples of 500 µs, and the machine's controller runs every 1 ms"
    ):
        pos.assemble(slower, pos.design_deadbeat(MACHINE, settling_time=25e-3))


def test_a_machine_is_judged_by_what_there_is() -> None:
    with pytest.raises(ValueError, match="reading 'scal' is unknown; choose one of position, scale"):
        pos.validate(MACHINE, CONTROLLER, reading="scal")  # type: ignore[arg-type]


@pytest.mark.parametrize("stroke", [0.0, np.nan, np.inf])
def test_a_stroke_goes_somewhere(stroke: float) -> None:
    with pytest.raises(ValueError, match="stroke: must be a way other than 0"):
        pos.validate(MACHINE, CONTROLLER, stroke=stroke)


@pytest.mark.parametrize(
    "given", [{"payload": -2.0}, {"friction_force": -1.0}, {"mass": np.nan}, {"frequency": [0.1, -1.5]}]
)
def test_no_machine_varies_to_one_that_cannot_be(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be a relative error above -1"):
        pos.Variation(**given)


def test_lists_and_arrays_are_one_error_for_each() -> None:
    errors = (0.0, 0.1, -0.1)
    first, *others = (
        pos.varied(MACHINE, pos.Variation(frequency=given))  # type: ignore[arg-type]
        for given in (errors, list(errors), np.array(errors))
    )
    assert all(one == first for one in others)


def test_records_are_equal_to_themselves() -> None:
    assert [RECORD, RECORD].index(RECORD) == 0
    assert replace(RECORD) != RECORD


Change = Callable[[pos.Record], pos.Record]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda one: replace(one, command=one.command[:-5]), "record 1: its signals must have equally many samples"),
        (lambda one: replace(one, position=np.where(np.arange(one.position.size) == 7, np.nan, one.position)),
         "record 1: its position is no finite number at sample 7"),
        (lambda one: replace(one, command=list(one.command)), "record 1: its command is no row of numbers"),
        (lambda one: replace(one, sample_time=0.5), "record 1: has a sample every 500 ms, one of 1000 of the"),
        (lambda one: replace(one, sample_time=0.7 * one.sample_time), "record 1: is sampled every 350 µs"),
        (lambda one: one.part(0, 10), "10 samples are too short for a diagnosis"),
        (lambda one: one.part(0, 0), "record 1: its signals must have equally many samples, at least one"),
    ],
)  # fmt: skip
def test_what_is_no_record_of_the_machine_is_not_diagnosed(change: Change, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        pos.diagnose(RIGID, [change(RECORD)], trusted=True)


def test_a_record_in_another_unit_is_doubted() -> None:
    """A confident name had come of it, and a file with a hundred times the friction."""
    away = {name: 1e3 * getattr(RECORD, name) for name in ("target", "reference", "position")}
    with pytest.raises(DoubtfulError, match="record 1: "):
        pos.diagnose(RIGID, [replace(RECORD, **away)])


def test_an_axis_that_rests_is_not_diagnosed() -> None:
    nothing = np.zeros(2000)
    with pytest.raises(DoubtfulError, match="nothing moves"):
        pos.diagnose(RIGID, [pos.Record(RIGID.sample_time, *[nothing] * 5)])


@pytest.mark.parametrize(
    ("names", "sentence"),
    [(["coging"], "did you mean cogging?"), ("cogging", 'disabled: must be a list of names; give ["cogging"]')],
)
def test_an_effect_that_is_not_looked_for_cannot_be_disabled(names: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        pos.diagnose(RIGID, [RECORD], disabled=names)


@pytest.mark.parametrize("records", [RECORD, ["log.csv"]])
def test_records_are_a_list_of_them(records: Any) -> None:
    with pytest.raises(ValueError, match="records: must be a list of Records"):
        pos.diagnose(RIGID, records)


def test_the_machine_of_a_diagnosis_comes_before_its_records() -> None:
    with pytest.raises(ValueError, match="machine: must be a Machine, before the records; read it with load_machine"):
        pos.diagnose([RECORD], RIGID)  # type: ignore[arg-type]


def test_a_machine_that_no_file_can_state_is_not_diagnosed() -> None:
    """Said before the fits, not by the file that would be handed over after them."""
    twice = replace(RIGID, plant=replace(RIGID.plant, modes=(*RIGID.plant.modes, RIGID.plant.modes[0])))
    with pytest.raises(ValueError, match=f"^{re.escape(RIGID.name)}: plant"):
        pos.diagnose(twice, [RECORD])


@pytest.mark.parametrize(
    ("records", "options", "sentence"),
    [
        ("file.csv", {}, "records: must be a list of files; give ['file.csv']"),
        (["file.csv"], {"pass_band": -3.0}, "pass_band: must be above 0 Hz"),
        (["file.csv"], {"modes": -1}, "modes: must be at least 0"),
    ],
)
def test_an_identification_has_files(records: Any, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        pos.identify(RIGID, records, **options)


def test_a_file_is_read_as_the_machine_has_it(tmp_path: Path) -> None:
    """In millimetres, of a machine that moves micrometres."""
    path, names = tmp_path / "log.csv", ("target", "reference", "feedforward", "command", "position")
    time = RECORD.sample_time * np.arange(RECORD.position.size)
    units = {"target": "m", "reference": "m", "feedforward": "N", "command": "N", "position": "m"}
    scaled = [getattr(RECORD, name) * (1e3 if units[name] == "m" else 1.0) for name in names]
    head = ",".join(["time_s", *(f"{name}_{units[name]}" for name in names)])
    np.savetxt(path, np.column_stack([time, *scaled]), delimiter=",", header=head, comments="")
    assert pos.read_record(path).position.size == RECORD.position.size
    with pytest.raises(ValueError, match="the position's unit is wrong"):
        pos.read_record(path, machine=RIGID)
    with pytest.raises(ValueError, match="columns: must be Columns"):
        pos.read_record(path, {"time": "t"})  # type: ignore[arg-type]


def test_a_command_that_is_no_study_is_called_that() -> None:
    with pytest.raises(AttributeError, match=r"run python -m studies\.new_machine"):
        _ = pos.studies.new_machine


def test_a_validation_is_plotted_and_a_response_has_the_shape_of_its_frequencies() -> None:
    validation = pos.validate(MACHINE, CONTROLLER, periods=2)
    assert [axes.get_ylabel() for axes in pos.plot(validation).axes] == ["position [µm]", "command [N]"]
    one, grid = (pos.frequency_response(MACHINE.plant, omega) for omega in (110.0, [[110.0, 200.0]]))
    assert one.shape == ()
    assert grid.shape == (1, 2)
    assert one == grid[0, 0]
