"""What a study is asked is data: the same from the command line and from Python, with the same bounds."""

from __future__ import annotations

import dataclasses
import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import positioning as pos
from design.deadbeat import Objective as DeadbeatObjective
from design.pid.goal import Objective as PidObjective
from design.trajectory.history_aware import Objective as TrajectoryObjective
from design.trajectory.robust import Objective as CommonObjective
from models.machine import DEFAULT, load
from studies.catalogue import every
from studies.command import parser_of, plain
from studies.deadbeat_design.options import DeadbeatOptions
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.options import BadInputError, Options
from studies.pid_tradeoff.options import TradeoffOptions
from studies.response_variation.options import VariationOptions
from studies.trajectory_optimisation.options import TrajectoryOptions


@pytest.mark.parametrize("name", sorted(every()))
def test_a_command_without_options_asks_what_python_asks_without_any(name: str) -> None:
    """So a default that is typed as text is the one that is declared in SI."""
    study = every()[name]
    assert study.options(**vars(parser_of(study).parse_args([]))) == study.options()


@pytest.mark.parametrize("name", sorted(every()))
def test_every_option_is_declared_and_explained(name: str) -> None:
    said = parser_of(every()[name]).format_help()
    for field in dataclasses.fields(every()[name].options):
        option = field.metadata["option"]
        assert len(option.keywords["help"]) > 10
        assert (field.name.upper() if option.positional else f"--{field.name.rstrip('_').replace('_', '-')}") in said


def test_the_objectives_are_those_of_the_designs() -> None:
    def known(options: type[Options], name: str = "objective") -> set[str]:
        (field,) = (field for field in dataclasses.fields(options) if field.name == name)
        return set(field.metadata["option"].keywords["choices"])

    assert known(DeadbeatOptions) == set(get_args(DeadbeatObjective))
    assert known(TradeoffOptions) == set(get_args(PidObjective))
    assert known(TrajectoryOptions) == set(get_args(TrajectoryObjective)) - {"tracking"}  # its end is free
    assert known(TrajectoryOptions, "common_objective") == set(get_args(CommonObjective))


def test_a_quantity_is_an_si_number_or_text_with_a_unit() -> None:
    for stroke in (2e-5, np.float64(2e-5), "20 um"):
        assert DeadbeatOptions(stroke=stroke).stroke == 2e-5  # type: ignore[arg-type]
    assert DiagnosisOptions(record="moves.csv").record == (Path("moves.csv"),)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "options", "says"),
    [
        (DeadbeatOptions, {"stroke": "20 kg"}, "--stroke: '20 kg' is in kg, but this is a quantity in m"),
        (DeadbeatOptions, {"stroke": [2e-5]}, "--stroke: .* must be a number in m"),
        (DeadbeatOptions, {"stroke": float("nan")}, "--stroke: nan is not a finite number"),
        (DeadbeatOptions, {"overshoot": -0.1}, "--overshoot: -0.1 must be at least 0"),
        (DeadbeatOptions, {"objective": "beauty"}, "--objective: 'beauty' is unknown; choose one of thrust_difference"),
        (DeadbeatOptions, {"monotone": "yes"}, "--monotone: 'yes' must be True or False"),
        (DeadbeatOptions, {"seed": -1}, "--seed: -1 must be a whole number from 0 on"),
        (DeadbeatOptions, {"seed": 0.5}, "--seed: 0.5 must be a whole number from 0 on"),
        (VariationOptions, {"members": 161}, "--members: 161 must be a whole number from 2 to 160"),
        (TradeoffOptions, {"ms": 1}, "--ms: 1 must be above 1"),
    ],
)
def test_what_cannot_be_is_said_as_on_the_command_line(kind: Any, options: dict[str, Any], says: str) -> None:
    with pytest.raises(BadInputError, match=says):
        kind(**options)


def test_a_study_called_from_python_answers_as_its_command_does(quick_run: Callable[[str], tuple[Path, int]]) -> None:
    folder, _ = quick_run("deadbeat_design")
    told: list[float] = []
    answer = pos.studies.deadbeat_design(load(), quick=True, progress=lambda share, _: told.append(share))
    written = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert plain(answer.results) == written["results"]
    assert [check.value for check in answer.checks] == [check["value"] for check in written["checks"]]
    assert told == sorted(told)
    assert told
    assert repr(answer).startswith("Answer(7 of 7 checks hold; results: as_known, beyond, bode, ")
    assert "\n" not in repr(answer)


def test_a_machine_is_given_as_it_is_or_by_its_file() -> None:
    with pytest.raises(BadInputError, match="the shortest that can is"):
        pos.studies.deadbeat_design(str(DEFAULT), settling_time=15e-3)
    with pytest.raises(BadInputError, match=r"nowhere.toml: can't be read"):
        pos.studies.deadbeat_design("nowhere.toml")
    with pytest.raises(TypeError, match="settling"):
        pos.studies.deadbeat_design(load(), settling=15e-3)


def test_a_notebook_completes_the_studies_and_their_options() -> None:
    assert "deadbeat_design" in dir(pos.studies)
    assert "deadbeat_design" in repr(pos.studies)
    assert {"machine", "settling_time", "stroke", "seed"} <= set(
        inspect.signature(pos.studies.deadbeat_design).parameters
    )
    with pytest.raises(AttributeError, match="there is no study 'deadbeat'; there are "):
        _ = pos.studies.deadbeat
