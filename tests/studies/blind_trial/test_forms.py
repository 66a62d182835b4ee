"""No effect of the sealer has the form of its catalogue entry: fitted to it, the entry leaves a visible residual."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from models.effects.base import Place, T, V, X
from models.effects.catalogue import every, looked_for
from studies.blind_trial.sealer import nominal, simulate
from studies.blind_trial.sealer.effects import CATALOGUE
from studies.blind_trial.sealer.machine import Physics
from studies.blind_trial.sealer.physics import amplifier, limit_scale, outside, reading_of, settle_slow, thrust_of

Array = NDArray[np.float64]
TABLE = nominal.load()
SEEN = 0.01  # of the effect's rms that its catalogue entry must leave


@dataclass(frozen=True)
class Curve:
    """An effect without memory in both programs: what it changes along one coordinate.

    fields: of the sealed machine; sealed: its value there, `none` where there is no effect; entry: the catalogue's
    parameters at which the forms would be one if they were shared; along: the coordinate, an index of `now`, or none
    where the hook's own value is the coordinate; laws: the catalogue's further parameters, switches, as they may be.
    """

    fields: Mapping[str, float]
    sealed: Callable[[Physics, float], float]
    at: Array
    entry: Sequence[float]
    place: str
    along: int | None
    none: float | None = 0.0
    sign: float = 1.0
    laws: Sequence[Sequence[float]] = ((),)


def after(p: Physics, t: float) -> float:
    """Factor of friction at the time t [s]."""
    slow = np.zeros(9)
    settle_slow(p, slow, 1e-4, 0.0, 0.0, 0.0, 0.0, t)
    return float(slow[8])


SPEEDS = np.linspace(-0.5, 0.5, 201)
SLOW = np.linspace(-8e-3, 8e-3, 201)
PLACES = np.linspace(0.0, 0.06, 301)
FORCES = np.linspace(-100.0, 100.0, 401)
SMALL = np.linspace(-1.0, 1.0, 2001)
TIMES = np.linspace(0.01, 15.0, 151)
NONE = np.zeros(9)

CURVES = {
    "viscous_friction": Curve(
        {"viscous": 50.0, "viscous_speed": 0.3}, lambda p, v: outside(p, 0.0, v), SPEEDS, (50.0,), "friction", V
    ),
    "stribeck": Curve(
        {"stribeck": 0.2, "stribeck_speed": 2e-3},
        lambda p, v: limit_scale(p, 0.0, v, 0.0, NONE),
        SLOW,
        (0.2, 2e-3),
        "limit",
        V,
        none=1.0,
    ),
    "position_dependent_friction": Curve(
        {"place": 0.1, "place_length": 0.02, "place_phase": 1.0},
        lambda p, x: limit_scale(p, x, 0.0, 0.0, NONE),
        PLACES,
        (0.1, 0.02, 1.0),
        "friction",
        X,
        none=1.0,
    ),
    "friction_drift": Curve({"warm": 0.2, "warm_time": 20.0}, after, TIMES, (0.01,), "friction", T, none=1.0),
    "cogging": Curve(
        {"cogging": 3.0, "cogging_pitch": 0.03, "cogging_phase": 1.0},
        lambda p, x: thrust_of(p, 0.0, x, 0.0, 0.0),
        PLACES,
        (3.0, 0.03, 1.0),
        "force",
        X,
    ),
    "thrust_ripple": Curve(
        {"ripple": 0.05, "ripple_pitch": 0.03, "ripple_phase": 1.0},
        lambda p, x: thrust_of(p, 10.0, x, 0.0, 0.0),
        PLACES,
        (0.05, 0.03, 1.0),
        "thrust",
        X,
        none=10.0,
    ),
    "gain_asymmetry": Curve(
        {"asymmetry": 0.03}, lambda p, u: thrust_of(p, u, 0.0, 0.0, 0.0), FORCES / 5, (0.03,), "thrust", None, none=None
    ),
    "thrust_saturation": Curve(
        {"knee": 200.0}, lambda p, u: thrust_of(p, u, 0.0, 0.0, 0.0), FORCES, (0.05,), "thrust", None, none=None
    ),
    "amplifier_deadband": Curve({"deadband": 0.3}, amplifier, SMALL, (0.3,), "command", None, none=None),
    "dac_quantisation": Curve(
        {"dac": 0.05, "ladder": 0.1},
        amplifier,
        SMALL,
        (0.05,),
        "command",
        None,
        none=None,
        laws=((0.0,), (1.0,), (2.0,)),
    ),
    "cable_spring": Curve(
        {"spring": 300.0, "spring_place": 0.0},
        lambda p, x: outside(p, x, 0.0),
        PLACES,
        (300.0,),
        "force",
        X,
        sign=-1.0,
    ),
    "scale_drift": Curve(
        {"creep": 2e-7, "creep_time": 3.0}, lambda p, t: reading_of(p, 0.0, 0.0, t), TIMES, (2e-7,), "reading", T
    ),
    "scale_periodic_error": Curve(
        {"grating": 1e-7, "grating_period": 2e-5, "grating_phase": 1.0},
        lambda p, x: reading_of(p, x, 0.0, 0.0),
        PLACES / 600,
        (1e-7, 2e-5, 1.0),
        "reading",
        None,
        none=None,
    ),
}


def left(name: str, curve: Curve) -> float:
    """The share of the sealed effect's rms that its catalogue entry, fitted, does not explain."""
    machine = simulate.physics_of(TABLE, curve.fields)
    before = curve.at if curve.none is None else np.full(curve.at.size, curve.none)
    change = curve.sign * (np.array([curve.sealed(machine, float(x)) for x in curve.at]) - before)
    hook: Callable[..., float] = every()[name].hooks[Place[curve.place.upper()]]
    memory, contact = np.zeros(4), np.zeros((3, 1))

    def misfit(scale: Array, law: Sequence[float]) -> float:
        p, now, total = np.array([*(curve.entry * scale), *law]), np.zeros(8), 0.0
        for x, value, wanted in zip(curve.at, before, change, strict=True):
            if curve.along is not None:
                now[curve.along] = x
            total += (hook(value, p, now, memory, contact) - value - wanted) ** 2
        return float(np.sqrt(total / np.sum(change**2)))

    start, fine = np.ones(len(curve.entry)), {"xatol": 1e-6, "fatol": 1e-9}
    return min(float(minimize(misfit, start, (law,), method="Nelder-Mead", options=fine).fun) for law in curve.laws)


@pytest.mark.parametrize("name", sorted(CURVES))
def test_the_catalogue_does_not_hold_the_form_of_a_sealed_effect(name: str) -> None:
    assert SEEN < left(name, CURVES[name]) < 0.9


def test_a_shared_form_would_be_found() -> None:
    """Steps of one height: the catalogue's."""
    even = Curve({"dac": 0.05}, amplifier, SMALL, (0.05,), "command", None, none=None, laws=((0.0,), (1.0,), (2.0,)))
    assert left("dac_quantisation", even) < 1e-6


def test_every_sealed_effect_without_memory_is_looked_at() -> None:
    """Except two that are not curves: the floor's is a random signal, the controller's one of four changes."""
    plain = {name for name in CATALOGUE if every()[name].hooks and not every()[name].typical().memory(10)}
    assert plain == set(CURVES) | {"floor_vibration", "controller_mismatch"}


def test_all_of_the_catalogue_is_sealed_but_what_no_size_shows() -> None:
    """And but for where the friction acts, for which no sealer has a form yet; the guide says so."""
    where_it_acts = {"noncollocated_friction", "friction_driven_mode", "load_side_friction"}
    assert set(looked_for()) - set(CATALOGUE) == {"scale_gain_error", *where_it_acts}
