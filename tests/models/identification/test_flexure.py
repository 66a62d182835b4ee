"""A stage on flexures: a spring that its file states roughly, and hardly any friction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import chirp

from models.controller import PID
from models.effects.friction_laws import ViscousFriction
from models.effects.structure import CableSpring
from models.friction import elements
from models.identification import modes
from models.identification.force.fit import SPRING
from models.identification.joint.response_records import _fitted
from models.identification.joint.steps import Identified, Settings
from models.identification.modal.fitting import _spanned
from models.identification.modes import DRAG
from models.identification.pipeline import identify
from models.identification.response import FrequencyResponse
from models.identification.unusable import UnusableError
from models.machine import Machine
from models.plant import Mode, Plant
from models.records.files import Loaded
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.identify_machine import own_records
from tests.models.identification.test_springs import STAGE

LIMIT = np.array([2e-6, 10e-6])
TRUE = replace(
    STAGE,
    plant=Plant(187.5e-6, 1.0, (Mode(1 / 1.2, 0.0, 0.0), Mode(0.076, 420.0, 0.012))),
    friction=elements(np.array([5e-6, 5e-6]) / LIMIT, LIMIT),
    scale=replace(STAGE.scale, resolution=5e-9, noise=3e-9),
    drive=replace(STAGE.drive, rated_thrust=72.0, offset=0.0),
    control=replace(STAGE.control, sample_time=125e-6, pid=PID(1.6e5, 1e7, 760.0, 0.15e-3)),
    effects=(CableSpring(15350.0), ViscousFriction(5.4)),
)
FILE = replace(
    TRUE,
    plant=Plant(187.5e-6, 1.0, (Mode(0.8, 0.0, 0.0),)),
    effects=(CableSpring(16400.0), ViscousFriction(4.5)),
)  # fmt: skip


def excited(kind: str) -> Record:
    """A multisine of the axis at rest, which repeats, or a sweep while it goes a millimetre."""
    ts = TRUE.sample_time
    if kind == "sweep":
        force = 1.8 * chirp(np.arange(round(2.5 / ts)) * ts, 15, 2.5, 1400, method="logarithmic", phi=-90)
        force = np.concatenate([np.zeros(round(0.3 / ts)), force])
        return own_records.run(TRUE, np.linspace(-5e-4, 5e-4, force.size), np.asarray(force, float), 1)
    draw, t = np.random.default_rng(0), np.arange(round(1 / ts)) * ts
    lines = np.unique(np.geomspace(3, 1600, 60).round())
    wave = np.sum(0.3 * np.sin(2 * np.pi * np.outer(lines, t) + draw.uniform(0, 7, (lines.size, 1))), axis=0)
    force = np.tile(wave, 4)
    return own_records.run(TRUE, np.zeros(force.size), np.asarray(force, float), 1)


@cache
def found(kind: str) -> Identified:
    return identify(FILE, [Loaded(f"{kind}.csv", "12ab", excited(kind), (), ())], kinds=["excitation"])


@pytest.mark.parametrize("kind", ["multisine", "sweep"])
def test_an_excitation_corrects_the_stated_spring_and_finds_the_plant(kind: str) -> None:
    """The suspension's own frequency, 18 Hz, lies among the multisine's lines. The first was refused ("friction bends
    the whole response"), as was the second, but for what lay above the ramp that the spring takes."""
    answer = found(kind)
    estimate = answer.estimates[f"{kind}.csv"]
    truth = {"rigid body gain": 1 / 1.2, "dead time": 187.5e-6, "mode 2 frequency": 420.0, SPRING: 15350.0, DRAG: 5.4}
    for name, value in truth.items():
        assert abs(estimate.value(name) - value) < 4 * estimate.deviation(name) + 1e-3 * value, name
    assert estimate.deviation(SPRING) < 0.02 * 15350
    spring = next(effect for effect in answer.machine.effects if effect.name == CableSpring.name)
    assert spring.values()[0] == pytest.approx(estimate.value(SPRING), rel=1e-9)


@pytest.mark.parametrize(
    ("freed", "plain", "smooth"), [(1.1, 0.9, True), (50.0, 2.0, False), (50.0, 60.0, True), (50.0, None, True)]
)
def test_lines_that_friction_bends_all_the_same_are_taken_as_on_any_axis(
    freed: float, plain: float | None, smooth: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the chi-squares of the fit as of a smooth axis and as of any, of which the latter may find no line of use."""

    def fit(measured: FrequencyResponse, **_: Any) -> Any:
        if not measured.rolling and plain is None:
            raise UnusableError("friction bends the whole response")
        return SimpleNamespace(chi_square=freed if measured.rolling else plain)

    monkeypatch.setattr(modes, "fit", fit)
    few = np.ones(3)
    measured = FrequencyResponse(few, few.astype(np.complex128), few, few, 1e-4, turned=0.2)
    shown, found, as_smooth = _fitted(Identified(FILE), measured, Settings(None, None, False), smooth=True)
    assert (as_smooth, found.chi_square) == (smooth, freed if smooth else plain)
    assert (shown.rolling, shown.turned) == ((True, 0.0) if smooth else (False, 0.2))


def test_what_gives_its_force_back_without_a_loop_is_no_friction() -> None:
    """It had become 19 N of friction, an element that had never slipped."""
    t = np.arange(round(2.0 / TRUE.sample_time)) * TRUE.sample_time
    path = 1.3e-3 * np.sin(2 * np.pi * t)
    record = own_records.run(TRUE, np.asarray(path, float), np.zeros(t.size), 5)
    without: Machine = replace(FILE, effects=())
    with pytest.raises(RecordError, match=r"without a loop: a spring of 15\.\d+ N/mm holds the axis.* state it"):
        identify(without, [Loaded("loops.csv", "", record, (), ())], kinds=["hysteresis"])
    with pytest.raises(RecordError, match=r"no friction (is seen|element takes)") as said:
        identify(TRUE, [Loaded("loops.csv", "", record, (), ())], kinds=["hysteresis"])
    assert "state it" not in str(said.value)


def test_a_basis_of_more_columns_than_rows_or_of_none() -> None:
    """A slow, long record leaves more late commands than it has lines; where all poles have died out, there is none."""
    columns = np.random.default_rng(1).standard_normal((6, 9))
    basis, weights = _spanned(columns)
    assert basis.shape == (6, 6)
    assert basis == pytest.approx(columns @ weights, abs=1e-9)
    basis, weights = _spanned(np.zeros((6, 0)))
    assert (basis.shape, weights.shape) == ((6, 0), (0, 0))
