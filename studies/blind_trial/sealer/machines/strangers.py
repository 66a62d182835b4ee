"""Laws outside the catalogue, some of them published: on these a diagnosis should abstain and tell the coordinate."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.forms import Form, Shape, Units, times
from studies.blind_trial.sealer.machines.simulation import Change

Array = NDArray[np.float64]


def _hysteresis(form: float, name: str, text: str) -> Form:
    """A share of the friction force that is another hysteresis, as stiff and as strong as the elements it replaces."""

    def change(size: float, _: Shape, units: Units) -> Change:
        length = units.friction / float(units.axis.stiffness.sum())
        return Change({"odd_form": form, "odd": size, "odd_length": 2 * length, "odd_force": units.friction})

    return Form(name, text, "1", lambda _: (0.005, 0.1, 0.9), lambda _: {}, change, ("since_reversal", "position"))


def _load(size: float, _: Shape, units: Units) -> Change:
    """Slip limits grow with the thrust, as where the motor's force presses on the guide."""
    return Change({"load": size, "load_force": units.peak})


def _fade(size: float, shape: Shape, units: Units) -> Change:
    return Change({"fade": size, "fade_time": shape["time"], "fade_force": 0.4 * units.peak})


def _rattle(size: float, shape: Shape, _: Units) -> Change:
    """A part of the load that hits the table at either end of its gap."""
    omega = 2 * np.pi * shape["frequency"]
    return Change({"mass_form": 1.0, "mass": size, "mass_omega": omega, "mass_zeta": 0.15, "mass_gap": shape["gap"]})


def _slosh(size: float, shape: Shape, units: Units) -> Change:
    """A liquid: a pendulum that softens as it swings."""
    omega = 2 * np.pi * shape["frequency"]
    fields = {"mass_omega": omega, "mass_zeta": 0.05, "mass_cubic": 4.0 / units.span**2}
    return Change({"mass_form": 1.0, "mass": size, **fields})


def _remanence(size: float, shape: Shape, _: Units) -> Change:
    return Change({"remanence": size, "remanence_force": shape["force"]})


def _stale(size: float, _: Shape, __: Units) -> Change:
    """The scale is read late by a random time, a new one at each sample."""

    def stale(rng: np.random.Generator, n: int) -> Array:
        return np.asarray(size * rng.random(n) ** 2)

    return Change(signals={"stale": stale})


def _held(size: float, _: Shape, __: Units) -> Change:
    """Now and then the scale repeats its last reading."""

    def held(rng: np.random.Generator, n: int) -> Array:
        return np.asarray(rng.random(n) < size, float)

    return Change(signals={"held": held})


def _gusts(size: float, _: Shape, units: Units) -> Change:
    """Pushes at random times, a few a second, each a decaying exponential."""

    def force(rng: np.random.Generator, n: int) -> Array:
        ts = units.axis.sample_time
        kicks = rng.standard_normal(n) * (rng.random(n) < 4.0 * ts)
        decay = np.exp(-np.arange(int(0.1 / ts)) * ts / 0.02)
        return np.asarray(size * np.convolve(kicks, decay)[:n])

    return Change(signals={"force": force})


def _selfheat(size: float, shape: Shape, units: Units) -> Change:
    """Friction falls as it warms the guide, which warms what carries it: two bodies."""
    power = 0.1 * units.friction * units.speed
    return Change({"selfheat": size, "selfheat_time": shape["time"], "selfheat_power": power})


STRANGERS: Final = (
    _hysteresis(1.0, "dahl_friction", "a share of the friction is Dahl's (1968)"),
    _hysteresis(2.0, "bouc_wen_friction", "a share of the friction is Bouc's and Wen's (1976)"),
    _hysteresis(3.0, "elasto_plastic_friction", "a share of the friction is elasto-plastic (Dupont et al. 2002)"),
    Form(
        "load_dependent_friction",
        "limits grow with the thrust",
        "1",
        lambda _: (0.001, 0.05, 2.0),
        lambda _: {},
        _load,
        ("command", "acceleration", "velocity_sign"),
    ),
    Form(
        "frictional_heating",
        "friction falls with what it dissipates, two bodies",
        "1",
        lambda _: (0.003, 0.05, 0.7),
        lambda units: {"time": (0.03 * units.lasts, 0.2 * units.lasts)},
        _selfheat,
        ("time", "time_in_motion", "velocity", "dwell"),
    ),
    Form(
        "thermal_thrust_fade",
        "thrust falls with the coil's energy",
        "1",
        lambda _: (0.0005, 0.01, 0.3),
        lambda units: {"time": (0.05 * units.lasts, 0.3 * units.lasts)},
        _fade,
        ("command", "time", "acceleration", "time_in_motion"),
    ),
    Form(
        "loose_load_impact",
        "clearance with impact",
        "kg",
        times(lambda units: units.axis.mass, 0.001, 0.01, 0.3),
        lambda units: {"gap": (0.05 * units.reach, units.reach), "frequency": (40.0, 90.0)},
        _rattle,
        ("acceleration", "command", "since_reversal", "time_in_motion"),
    ),
    Form(
        "load_slosh",
        "a pendulum that softens",
        "kg",
        times(lambda units: units.axis.mass, 3e-4, 3e-3, 0.3),
        lambda _: {"frequency": (1.0, 4.0)},
        _slosh,
        ("time", "time_in_motion", "dwell", "acceleration"),
    ),
    Form(
        "magnet_hysteresis",
        "thrust remembers the command",
        "1",
        lambda _: (0.0005, 0.01, 0.3),
        lambda units: {"force": (0.05 * units.peak, 0.4 * units.peak)},
        _remanence,
        ("command", "acceleration", "since_reversal"),
    ),
    Form(
        "speed_dependent_dead_time",
        "dead time grows with |v|",
        "s/(m/s)",
        times(lambda units: units.axis.sample_time / units.speed, 1e-3, 0.1, 2.0),
        lambda _: {},
        lambda size, _, __: Change({"slower": size}),
        ("velocity", "acceleration", "command"),
    ),
    Form(
        "track_bump",
        "a force at one place, the same both ways",
        "N",
        times(lambda units: units.friction, 3e-4, 0.03, 3.0),
        lambda units: {
            "bump_place": (0.15 * units.span, 0.6 * units.span),
            "bump_width": (0.01 * units.span, 0.06 * units.span),
        },
        lambda size, shape, _: Change({"bump": size, **shape}),
        ("position",),
    ),
    Form(
        "scale_bracket_compliance",
        "the reading moves with the acceleration",
        "m/(m/s^2)",
        times(lambda units: units.axis.read / units.axis.acceleration, 0.05, 1.0, 100.0),
        lambda _: {},
        lambda size, _, __: Change({"bracket": size}),
        ("acceleration", "command"),
    ),
    Form(
        "eddy_zone",
        "drag in a zone",
        "N s/m",
        times(lambda units: units.friction / units.speed, 1e-3, 0.05, 5.0),
        lambda units: {
            "eddy_place": (0.2 * units.span, 0.7 * units.span),
            "eddy_width": (0.05 * units.span, 0.15 * units.span),
        },
        lambda size, shape, _: Change({"eddy": size, **shape}),
        ("position", "velocity"),
    ),
    Form(
        "gusts",
        "pushes at random times",
        "N",
        times(lambda units: units.friction, 1e-4, 5e-3, 0.5),
        lambda _: {},
        _gusts,
        ("time",),
    ),
    Form(
        "reading_delay_jitter",
        "the age of a reading changes at random",
        "s",
        times(lambda units: units.axis.sample_time, 1e-4, 5e-3, 0.9),
        lambda _: {},
        _stale,
        ("velocity",),
    ),
    Form(
        "reading_dropouts",
        "readings repeated at random",
        "1",
        lambda _: (2e-5, 5e-4, 0.1),
        lambda _: {},
        _held,
        ("velocity", "time"),
    ),
)
