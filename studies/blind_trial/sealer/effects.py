"""Effects of the sealed machines, in functional forms of this sealer; out-of-catalogue effects are in outsiders.py.

Each has one size, up to `high` (the end of its typical range), and a shape drawn at random. Forms differ on purpose
from the simplest law to fit: several time scales, harmonics, second order, smooth knees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Shape = Mapping[str, float]
Signal = Callable[[np.random.Generator, int], Array]


@dataclass(frozen=True)
class Change:
    """What an effect changes: fields of Physics, and signals as functions of (rng, samples)."""

    fields: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, Signal] = field(default_factory=dict)


@dataclass(frozen=True)
class Law:
    """One effect: the unit of its size, its range, how its shape is drawn, and the change that it makes.

    middle: where the search for a size begins, seen at a distance of about 40.
    """

    unit: str
    low: float
    middle: float
    high: float
    shape: Callable[[np.random.Generator], dict[str, float]]
    change: Callable[[float, Shape], Change]
    form: str


def plain(_: np.random.Generator) -> dict[str, float]:
    """No shape to draw."""
    return {}


def between(**ranges: tuple[float, float]) -> Callable[[np.random.Generator], dict[str, float]]:
    """Shape parameters drawn evenly in their logarithm, or evenly where a range begins at 0 or below."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        return {
            name: float(rng.uniform(low, high) if low <= 0 else np.exp(rng.uniform(np.log(low), np.log(high))))
            for name, (low, high) in ranges.items()
        }

    return draw


def fields(size_name: str, **names: str) -> Callable[[float, Shape], Change]:
    """A change of fields: the size under one name, every shape parameter under its own or another."""

    def change(size: float, shape: Shape) -> Change:
        return Change({size_name: size, **{names.get(name, name): number for name, number in shape.items()}})

    return change


def _signed(
    size_name: str,
) -> tuple[Callable[[np.random.Generator], dict[str, float]], Callable[[float, Shape], Change]]:
    def shape(rng: np.random.Generator) -> dict[str, float]:
        return {"sign": float(rng.choice([-1, 1]))}

    return shape, lambda size, shape: Change({size_name: size * shape["sign"]})


def _directional(size: float, shape: Shape) -> Change:
    """Either sign."""
    sign = 1.0 if shape["sign"] > 0 else -1.0
    return Change({"directional": sign * size, "turn_speed": shape["turn_speed"]})


TURN: Final = (0.0, 2 * np.pi)


def _late(size: float, _: Shape) -> Change:
    """Now and then (every fifteenth sample or so) a command comes late, by an exponentially distributed time."""

    def late(rng: np.random.Generator, n: int) -> Array:
        return np.minimum(rng.exponential(size, n) * (rng.random(n) < 0.07), 4e-4)

    return Change(signals={"late": late})


def _floor(size: float, shape: Shape) -> Change:
    """A line that breathes, and another beside it."""

    def force(rng: np.random.Generator, n: int) -> Array:
        t = np.arange(n) * 5e-4
        turn = rng.uniform(0, 2 * np.pi, 3)
        swell = 1 + 0.25 * np.sin(2 * np.pi * 0.3 * t + turn[0])
        f = shape["frequency"]
        main = swell * np.sin(2 * np.pi * f * t + turn[1])
        return np.asarray(size * (main + 0.25 * np.sin(2 * np.pi * 1.31 * f * t + turn[2])))

    return Change(signals={"force": force})


def _attached(size: float, shape: Shape) -> Change:
    """A small mass on a spring: size is its share of the table's mass."""
    return Change({"mass": size * 45.3, "mass_omega": 2 * np.pi * shape["frequency"], "mass_zeta": shape["damping"]})


def _other_law(rng: np.random.Generator) -> dict[str, float]:
    return {"which": float(rng.integers(4)), "sign": float(rng.choice([-1, 1]))}


def _controller(size: float, shape: Shape) -> Change:
    """One of four: another kp, kd or filter time by a share, or a reference that waits a sample longer."""
    name = ("kp_off", "kd_off", "tau_off", "later")[int(shape["which"])]
    return Change({name: 1.0 if name == "later" else size * shape["sign"]})


CATALOGUE: Final[Mapping[str, Law]] = {
    "friction_relaxation": Law(
        "1", 0.003, 0.042, 0.3, between(relax_time=(0.08, 0.8)), fields("relaxed"), "three time scales, 16 to 1"
    ),
    "dwell_breakaway": Law(
        "1",
        0.01,
        0.2,
        0.35,
        between(age_time=(0.1, 2.0), age_length=(2e-6, 10e-6)),
        fields("aged"),
        "two time scales, lost by rolling, exponentially in the way",
    ),
    "viscous_friction": Law(
        "N s/m", 0.2, 2.2, 120.0, between(viscous_speed=(0.1, 0.5)), fields("viscous"), "asinh of speed"
    ),
    "stribeck": Law(
        "1",
        0.001,
        0.012,
        0.35,
        between(stribeck_speed=(0.7e-3, 5e-3)),
        fields("stribeck"),
        "1/(1 + |v/v_s|^1.5), on the limits",
    ),
    "directional_friction": Law(
        "1",
        0.0005,
        0.005,
        0.12,
        between(turn_speed=(1e-4, 1e-3), sign=(-1, 1)),
        _directional,
        "as v/(v^2 + v_d^2)^(1/2): none of it at rest",
    ),
    "position_dependent_friction": Law(
        "1",
        0.0002,
        0.0025,
        0.2,
        between(place_length=(4e-3, 50e-3), place_phase=TURN),
        fields("place"),
        "on the limits, with second and third harmonic",
    ),
    "frictional_lag": Law("s", 6e-05, 0.0001, 0.003, plain, fields("friction_lag"), "two lags in series"),
    "friction_drift": Law(
        "1", 0.002, 0.02, 0.3, between(warm_time=(8.0, 40.0)), fields("warm"), "saturating, exponentially in time"
    ),
    "play": Law("m", 1e-08, 1.1e-07, 3e-06, plain, fields("gap"), "three gaps of different widths side by side"),
    "cogging": Law(
        "N",
        0.005,
        0.08,
        5.0,
        between(cogging_pitch=(20e-3, 60e-3), cogging_phase=TURN),
        fields("cogging"),
        "three harmonics",
    ),
    "thrust_ripple": Law(
        "1",
        0.0002,
        0.0025,
        0.06,
        between(ripple_pitch=(20e-3, 60e-3), ripple_phase=TURN),
        fields("ripple"),
        "three harmonics",
    ),
    "gain_asymmetry": Law("1", 0.0001, 0.0011, 0.05, *_signed("asymmetry"), "smooth about zero thrust"),
    "thrust_saturation": Law(
        "1",
        0.0001,
        0.003,
        0.3,
        plain,
        lambda size, _: Change({"knee": 100.0 / size ** (1 / 3)}),
        "u/(1 + |u/u_s|^3)^(1/3); size is (100 N/u_s)^3",
    ),
    "current_loop_lag": Law("s", 5e-05, 0.0002, 0.0005, plain, fields("lag"), "second order, damping 0.8"),
    "timing_jitter": Law(
        "s", 1e-06, 1.3e-05, 0.0003, plain, _late, "exponentially distributed, one command in fifteen"
    ),
    "amplifier_deadband": Law("N", 0.005, 0.05, 0.6, plain, fields("deadband"), "u - w tanh(u/w)"),
    "dac_quantisation": Law(
        "N", 0.01, 0.08, 0.15, between(ladder=(0.1, 0.25)), fields("dac"), "uneven steps: three bits off their weight"
    ),
    "additional_mode": Law(
        "1",
        0.002,
        0.025,
        0.1,
        between(frequency=(105.0, 380.0), damping=(0.008, 0.03)),
        _attached,
        "a mass on a spring at the table, its reaction included",
    ),
    "floor_vibration": Law(
        "N", 0.002, 0.016, 2.0, between(frequency=(3.0, 28.0)), _floor, "a line that breathes and another"
    ),
    "cable_spring": Law("N/m", 1.0, 12.0, 500.0, between(spring_place=(-0.02, 0.05)), fields("spring"), "hardening"),
    "scale_drift": Law(
        "m/s", 1e-08, 2e-07, 3e-07, between(creep_time=(1.0, 6.0)), fields("creep"), "a rate and a creep"
    ),
    "scale_periodic_error": Law(
        "m",
        2e-09,
        3.5e-08,
        2e-07,
        between(grating_period=(4e-6, 40e-6), grating_phase=TURN),
        fields("grating"),
        "three harmonics",
    ),
    "controller_mismatch": Law(
        "1", 0.01, 0.03, 0.1, _other_law, _controller, "gain, filter or delay of the law that ran"
    ),
}
