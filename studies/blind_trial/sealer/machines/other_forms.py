"""The forms of the catalogue's effects on motor, structure, scale and protocol."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.forms import (
    EITHER,
    TURN,
    Draw,
    Form,
    Shape,
    Units,
    fields,
    friction,
    lines,
    mass,
    none,
    pitch,
    rate,
    reading,
    share,
    slope,
    tick,
    times,
)
from studies.blind_trial.sealer.machines.simulation import Change

Array = NDArray[np.float64]

EITHER_WAY: Final = {"sign": EITHER}


def _mismatch(text: str, change: Callable[[float, Shape, Units], Change], *, signed: bool = False) -> Form:
    """One way in which the law that ran differs from the stated one."""
    return Form(
        "controller_mismatch", text, "1", share(0.01, 0.03, 0.1), lambda _: EITHER_WAY if signed else {}, change
    )


def _knee(form: float) -> Callable[[float, Shape, Units], Change]:
    """size: (peak command / knee)^3."""
    return lambda size, _, units: Change({"knee_form": form, "knee": units.peak / size ** (1 / 3)})


def _late(size: float, _: Shape, units: Units) -> Change:
    """One command in fifteen is late, by a time from an exponential distribution."""
    most = 0.95 * units.axis.sample_time

    def late(rng: np.random.Generator, n: int) -> Array:
        return np.minimum(rng.exponential(size, n) * (rng.random(n) < 0.07), most)

    return Change(signals={"late": late})


def _bursts(size: float, _: Shape, units: Units) -> Change:
    """For a few samples at a time every command is late, by a time evenly distributed."""
    most = 0.95 * units.axis.sample_time

    def late(rng: np.random.Generator, n: int) -> Array:
        busy = np.convolve(rng.random(n) < 0.008, np.ones(12), "full")[:n] > 0
        return np.minimum(size * 2 * rng.random(n) * busy, most)

    return Change(signals={"late": late})


def _breathing(size: float, shape: Shape, units: Units) -> Change:
    """A line whose amplitude swells, and another beside it."""

    def force(rng: np.random.Generator, n: int) -> Array:
        t, turn = np.arange(n) * units.axis.sample_time, rng.uniform(0, 2 * np.pi, 3)
        swell = 1 + 0.3 * np.sin(2 * np.pi * 0.27 * t + turn[0])
        main = swell * np.sin(2 * np.pi * shape["frequency"] * t + turn[1])
        return np.asarray(size * (main + 0.3 * np.sin(2 * np.pi * 1.37 * shape["frequency"] * t + turn[2])))

    return Change(signals={"force": force})


def _narrow(size: float, shape: Shape, units: Units) -> Change:
    """Noise through a resonance of the floor, whose phase wanders within seconds."""

    def force(rng: np.random.Generator, n: int) -> Array:
        w, ts = 2 * np.pi * shape["frequency"], units.axis.sample_time
        keep = np.exp(-0.01 * w * ts)
        row = np.asarray(
            scipy.signal.lfilter([1.0], [1.0, -2 * keep * np.cos(w * ts), keep**2], rng.standard_normal(n + 4000))
        )
        row = row[4000:]
        return np.asarray(size * row / max(float(row.std()), 1e-300))

    return Change(signals={"force": force})


def _attached(size: float, shape: Shape, _: Units) -> Change:
    """A mass on a spring at the table, its reaction included."""
    omega = 2 * np.pi * shape["frequency"]
    return Change({"mass_form": 1.0, "mass": size, "mass_omega": omega, "mass_zeta": shape["damping"]})


def _hardening(size: float, shape: Shape, units: Units) -> Change:
    """One more mode, of either sign; its spring is stiffer by a fifth where it swings furthest."""
    omega = 2 * np.pi * shape["frequency"]
    swing = units.peak * size / units.axis.mass / omega**2
    sign = -1.0 if shape["sign"] < -0.3 else 1.0
    fields = {"mass_omega": omega, "mass_zeta": shape["damping"], "mass_cubic": 0.2 / swing**2}
    return Change({"mass_form": 2.0, "mass": sign * size / units.axis.mass, **fields})


def _lags(units: Units) -> tuple[float, float, float]:
    """The shortest that the integrator takes, one that shifts the phase at the crossover by a degree, a long one."""
    tick, crossover = units.axis.sample_time, units.axis.crossover
    return min(0.1 * tick, 1e-3 / crossover), 3e-3 / crossover, 0.05 / crossover


def _resonances(units: Units) -> Mapping[str, Draw]:
    low = max(3 * units.axis.crossover, 60.0)
    return {"frequency": (low, max(min(450.0, 0.3 / units.axis.sample_time), 1.2 * low)), "damping": (0.006, 0.04)}


def _gain_off(size: float, shape: Shape, units: Units) -> Change:
    """The proportional gain, or that of the speed, differs by a share."""
    name = "kvel" if units.axis.control["kind"] == 1.0 else "kp"
    return Change(control={name: units.axis.control[name] * (1.0 + np.sign(shape["sign"]) * size)})


def _rate_off(size: float, shape: Shape, units: Units) -> Change:
    """The derivative gain, or that of the position, differs by a share."""
    name = "kpos" if units.axis.control["kind"] == 1.0 else "kd"
    return Change(control={name: units.axis.control[name] * (1.0 + np.sign(shape["sign"]) * size)})


def _filter_off(size: float, _: Shape, units: Units) -> Change:
    """A filter of the derivative, or of the measured speed, that nobody stated."""
    return Change(control={"tau": units.axis.control["tau"] + size * 2.0 / (2 * np.pi * units.axis.crossover)})


def _waits(size: float, shape: Shape, units: Units) -> Change:
    """The reference waits a sample longer."""
    del size, shape, units
    return Change(later=1)


def _along(
    name: str, effect: str, unit: str, sizes: Callable[[Units], tuple[float, float, float]], form: float
) -> Form:
    text = {1.0: "three harmonics", 2.0: "peaks that grow along the travel"}[form]

    def ranges(units: Units) -> Mapping[str, Draw]:
        return {f"{name}_pitch": pitch(units), f"{name}_phase": TURN}

    return Form(effect, text, unit, sizes, ranges, fields(name, form))


OTHERS: Final = (
    _along("cog", "cogging", "N", times(friction, 1e-4, 0.004, 1.5), 1.0),
    _along("cog", "cogging", "N", times(friction, 1e-4, 0.004, 1.5), 2.0),
    _along("ripple", "thrust_ripple", "1", share(2e-4, 0.005, 0.25), 1.0),
    _along("ripple", "thrust_ripple", "1", share(2e-4, 0.005, 0.25), 2.0),
    Form(
        "gain_asymmetry",
        "gain by tanh of the thrust",
        "1",
        share(1e-4, 0.004, 0.2),
        lambda units: {"asymmetry_force": (0.02 * units.peak, 0.2 * units.peak), "sign": EITHER},
        fields("asymmetry", 1.0),
    ),
    Form(
        "gain_asymmetry",
        "a hyperbola through zero thrust",
        "1",
        share(1e-4, 0.004, 0.2),
        lambda units: {"asymmetry_force": (0.02 * units.peak, 0.2 * units.peak), "sign": EITHER},
        fields("asymmetry", 2.0),
    ),
    Form("thrust_saturation", "u/(1 + |u/u_s|^3)^(1/3)", "1", share(1e-4, 0.02, 1.0), none, _knee(1.0)),
    Form("thrust_saturation", "arctangent", "1", share(1e-4, 0.01, 0.5), none, _knee(2.0)),
    Form(
        "current_loop_lag",
        "second order, damping 0.7",
        "s",
        _lags,
        none,
        fields("current", 1.0),
    ),
    Form(
        "current_loop_lag",
        "three equal lags in series",
        "s",
        _lags,
        none,
        fields("current", 2.0),
    ),
    Form("timing_jitter", "one in fifteen, exponentially", "s", times(tick, 0.002, 0.05, 0.9), none, _late),
    Form("timing_jitter", "in bursts", "s", times(tick, 0.002, 0.05, 0.9), none, _bursts),
    Form(
        "amplifier_deadband",
        "u - w tanh(u/w)",
        "N",
        times(friction, 1e-4, 5e-3, 0.4),
        none,
        fields("deadband", 1.0),
    ),
    Form(
        "amplifier_deadband",
        "with the tail of an arctangent",
        "N",
        times(friction, 1e-4, 5e-3, 0.4),
        none,
        fields("deadband", 2.0),
    ),
    Form("dac_quantisation", "bits off their weight", "N", times(friction, 3e-4, 0.01, 0.2), none, fields("dac", 1.0)),
    Form(
        "dac_quantisation",
        "rounded away from zero",
        "N",
        times(friction, 3e-4, 0.01, 0.2),
        none,
        fields("dac", 2.0),
    ),
    Form("additional_mode", "a mass on a spring", "kg", times(mass, 5e-4, 0.02, 0.25), _resonances, _attached),
    Form(
        "additional_mode",
        "a mode of either sign, its spring hardening",
        "1",
        share(5e-4, 0.02, 0.4),
        lambda units: {**_resonances(units), "sign": EITHER},
        _hardening,
    ),
    Form(
        "floor_vibration",
        "a line that breathes and another",
        "N",
        times(friction, 1e-5, 2e-3, 0.5),
        lambda _: {"frequency": (2.5, 28.0)},
        _breathing,
    ),
    Form(
        "floor_vibration",
        "noise through a resonance",
        "N",
        times(friction, 1e-5, 2e-3, 0.5),
        lambda _: {"frequency": (2.5, 28.0)},
        _narrow,
    ),
    Form(
        "cable_spring",
        "hardening",
        "N/m",
        times(slope, 1e-3, 0.02, 4.0),
        lambda units: {
            "spring_place": (-0.3 * units.span, 1.3 * units.span),
            "spring_length": (units.span, 3 * units.span),
        },
        fields("spring", 1.0),
    ),
    Form(
        "cable_spring",
        "one-sided, rounded",
        "N/m",
        times(slope, 1e-3, 0.04, 6.0),
        lambda units: {
            "spring_place": (0.0, 0.6 * units.span),
            "spring_length": (0.1 * units.span, 0.4 * units.span),
        },
        fields("spring", 2.0),
    ),
    Form(
        "scale_drift",
        "a rate and a creep",
        "m/s",
        times(rate, 0.05, 5.0, 2e3),
        lambda units: {"creep_time": (0.03 * units.lasts, 0.3 * units.lasts)},
        fields("creep", 1.0),
    ),
    Form(
        "scale_drift",
        "two bodies that warm",
        "m/s",
        times(rate, 0.05, 5.0, 5e3),
        lambda units: {"creep_time": (0.05 * units.lasts, 0.3 * units.lasts), "sign": EITHER},
        fields("creep", 2.0),
    ),
    Form(
        "scale_periodic_error",
        "three harmonics",
        "m",
        times(reading, 0.03, 0.5, 30.0),
        lambda units: {"grating_period": lines(units), "grating_phase": TURN},
        fields("grating", 1.0),
    ),
    Form(
        "scale_periodic_error",
        "an ellipse off its centre (Heydemann 1981)",
        "m",
        times(reading, 0.03, 0.5, 30.0),
        lambda units: {"grating_period": lines(units), "grating_phase": TURN},
        fields("grating", 2.0),
    ),
    _mismatch("the proportional gain", _gain_off, signed=True),
    _mismatch("the gain of the rate", _rate_off, signed=True),
    _mismatch("a filter", _filter_off),
    _mismatch("a reference that waits longer", _waits),
)
