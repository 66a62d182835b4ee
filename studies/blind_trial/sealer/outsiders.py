"""Out-of-catalogue effects: on these a diagnosis should abstain ("none of these")."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.effects import Change, Law, Shape, between, fields, plain

Array = NDArray[np.float64]


def _rattle(size: float, shape: Shape) -> Change:
    """A part of the load that hits the table at either end of its gap (size: the part's share of the mass)."""
    return Change({"mass": 45.3 * size, "mass_omega": 2 * np.pi * 60.0, "mass_zeta": 0.15, "mass_gap": shape["gap"]})


def _slosh(size: float, shape: Shape) -> Change:
    """A liquid: a pendulum of a few Hz that softens as it swings (size: its share of the mass)."""
    omega = 2 * np.pi * shape["frequency"]
    return Change({"mass": 45.3 * size, "mass_omega": omega, "mass_zeta": 0.05, "mass_cubic": 100.0})


def _stale(size: float, _: Shape) -> Change:
    """The scale is read late by a random time, a new one at each sample."""

    def stale(rng: np.random.Generator, n: int) -> Array:
        return np.asarray(size * rng.random(n) ** 2)

    return Change(signals={"stale": stale})


def _held(size: float, _: Shape) -> Change:
    """Now and then the scale repeats its last reading (size: the share of samples)."""

    def held(rng: np.random.Generator, n: int) -> Array:
        return np.asarray(rng.random(n) < size, float)

    return Change(signals={"held": held})


def _gusts(size: float, _: Shape) -> Change:
    """Pushes at random times, a few a second, each a decaying exponential (air from a fan, a hose that slips)."""

    def force(rng: np.random.Generator, n: int) -> Array:
        kicks = rng.standard_normal(n) * (rng.random(n) < 0.002)
        decay = np.exp(-np.arange(200) / 40.0)
        return np.asarray(size * np.convolve(kicks, decay)[:n])

    return Change(signals={"force": force})


OUTSIDERS: Final[Mapping[str, Law]] = {
    "loose_load_impact": Law("1", 0.002, 0.005, 0.2, between(gap=(1e-6, 2e-5)), _rattle, "backlash with impact"),
    "thermal_thrust_fade": Law(
        "1", 0.0005, 0.002, 0.02, between(fade_time=(2.0, 8.0)), fields("fade"), "with the coil's energy"
    ),
    "lopsided_presliding": Law(
        "1",
        0.005,
        0.015,
        0.3,
        plain,
        fields("lopsided"),
        "stiffness differs by sign of the spring, slip force does not",
    ),
    "acceleration_friction": Law("1", 0.001, 0.008, 0.3, plain, fields("jerky"), "limits grow with |acceleration|"),
    "parametric_resonance": Law(
        "1",
        0.003,
        0.008,
        0.3,
        between(parametric_length=(1e-3, 8e-3)),
        fields("parametric"),
        "first mode's stiffness along x",
    ),
    "reading_delay_jitter": Law("s", 1e-07, 5e-07, 0.0004, plain, _stale, "age of a reading changes at random"),
    "load_slosh": Law("1", 0.002, 0.001, 0.2, between(frequency=(1.0, 4.0)), _slosh, "softening pendulum"),
    "magnet_hysteresis": Law(
        "1",
        0.002,
        0.005,
        0.2,
        between(remanence_force=(5.0, 25.0)),
        fields("remanence"),
        "thrust remembers the command",
    ),
    "reading_dropouts": Law("1", 5e-05, 0.0001, 0.2, plain, _held, "readings repeated at random"),
    "speed_dependent_dead_time": Law(
        "s/(m/s)", 1e-5, 0.0006, 5e-3, plain, fields("slower"), "dead time grows with |v|"
    ),
    "track_bump": Law(
        "N",
        0.05,
        0.27,
        10.0,
        between(bump_place=(4e-3, 14e-3), bump_width=(2e-4, 2e-3)),
        fields("bump"),
        "a force at one place, the same both ways",
    ),
    "scale_bracket_compliance": Law(
        "m/(m/s^2)", 1e-9, 3e-08, 1e-6, plain, fields("bracket"), "reading moves with acceleration"
    ),
    "eddy_zone": Law(
        "N s/m",
        0.5,
        1.2,
        100.0,
        between(eddy_place=(0.02, 0.045), eddy_width=(2e-3, 8e-3)),
        fields("eddy"),
        "drag in a zone",
    ),
    "gusts": Law("N", 0.02, 0.055, 3.0, plain, _gusts, "pushes at random times"),
}
