"""A drawn machine as its nominal file states it: plant, friction, scale, controller, and how well each is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.truth import CONTROL
from studies.blind_trial.sealer.nominal import bounded

Array = NDArray[np.float64]

# One standard deviation of a nominal value, relative to that of the mass (for the dead time: in sample times).
FREQUENCY: Final = 0.3
MODE_GAIN: Final = 1.5
DAMPING: Final = 3.0
STIFFNESS: Final = 1.0
LIMIT: Final = 1.0
LATENESS: Final = 1.0  # sample times per unit of the mass's relative deviation
OFFSET: Final = 0.1  # of the friction, per 5 % of the mass


@dataclass(frozen=True)
class Knowledge:
    """One standard deviation of every nominal value: relative, but dead_time [s] and offset [N]; draws are bounded at
    two."""

    mass: float
    mode_gain: float
    frequency: float
    damping: float
    dead_time: float
    offset: float
    friction_level: float
    stiffness: float
    limit: float


def knowledge(share: float, friction: float, sample_time: float) -> Knowledge:
    """What is known of a machine whose mass is known to `share` [1], one standard deviation."""
    return Knowledge(
        share,
        min(MODE_GAIN * share, 0.3),
        min(FREQUENCY * share, 0.05),
        min(DAMPING * share, 0.3),
        min(LATENESS * share, 0.1) * sample_time,
        OFFSET * friction * share / 0.05,
        STIFFNESS * share,
        STIFFNESS * share,
        LIMIT * share,
    )


@dataclass(frozen=True)
class Axis:
    """A machine, its drive, its controller, and how well all is known; SI.

    gain (m,), the rigid body's first, frequency (m,) [Hz], damping (m,); stiffness, limit (N,) of the elements;
    control: by the names of CONTROL; delay: samples by which the reference waits; crossover [Hz] that it was tuned for.
    """

    sample_time: float
    dead_time: float
    gain: Array
    frequency: Array
    damping: Array
    stiffness: Array
    limit: Array
    resolution: float
    noise: float
    control: Mapping[str, float]
    delay: int
    crossover: float
    rated: float
    speed: float
    acceleration: float
    travel: float
    known: Knowledge
    style: str = "PID"
    offset: float = 0.0

    @property
    def mass(self) -> float:
        """The rigid body's [kg]."""
        return float(1.0 / self.gain[0])

    @property
    def friction(self) -> float:
        """Force [N] at which all elements slip."""
        return float(self.stiffness @ self.limit)

    @property
    def reach(self) -> float:
        """The longest presliding displacement [m]."""
        return float(self.limit.max())

    @property
    def read(self) -> float:
        """Deviation of a reading [m], noise and rounding together."""
        return float(np.hypot(self.noise, self.resolution / np.sqrt(12)))

    @property
    def law(self) -> Array:
        """The controller as the integrator reads it."""
        return np.array([self.control.get(name, 0.0) for name in CONTROL])

    def nominal(self, name: str) -> dict[str, Any]:
        """The content of its nominal.json."""
        modes = zip(self.gain, self.frequency, self.damping, strict=True)
        return {
            "name": name,
            "sample_time_s": self.sample_time,
            "dead_time_s": self.dead_time,
            "thrust_constant": 1.0,
            "modes": [{"gain_per_kg": k, "frequency_Hz": f, "damping": z} for k, f, z in modes],
            "friction": {"stiffness_N_per_m": self.stiffness.tolist(), "limit_m": self.limit.tolist()},
            "scale": {"resolution_m": self.resolution, "noise_m": self.noise},
            "controller": {**self._controller(), "reference_delay_samples": self.delay},
            "drive": {
                "rated_thrust_N": self.rated,
                "rated_power_W": self.rated * self.speed,
                "rated_speed_m_per_s": 1.5 * self.speed,
                "current_loop_bandwidth_Hz": 1000.0,
            },
            "specification": self._specification(),
            "tolerance": {
                "mass": self.known.mass,
                "mode_gain": self.known.mode_gain,
                "frequency": self.known.frequency,
                "damping": self.known.damping,
                "dead_time_s": self.known.dead_time,
                "offset_N": self.known.offset,
                "friction_level": self.known.friction_level,
                "stiffness": self.known.stiffness,
                "limit": self.known.limit,
            },
        }

    def _controller(self) -> dict[str, Any]:
        g = self.control
        if g["kind"] == 1.0:
            return {
                "cascade": {
                    "position_gain_per_s": g["kpos"],
                    "velocity_gain_Ns_per_m": g["kvel"],
                    "integral_time_s": g["tn"],
                    "velocity_filter_s": g["tau"],
                    "velocity_feedforward": g["f"],
                    "acceleration_feedforward_kg": g["m"],
                    "proportional_weight": g["b"],
                }
            }
        gains = {
            "kp_N_per_m": g["kp"],
            "ki_N_per_ms": g["ki"],
            "kd_Ns_per_m": g["kd"],
            "derivative_filter_s": g["tau"],
        }
        weights = {"proportional_weight": g["b"], "derivative_weight": g["c"]}
        return gains | {name: weight for name, weight in weights.items() if weight != 1.0}

    def _specification(self) -> dict[str, Any]:
        slowest = min(3.0 / self.crossover, 900 * self.sample_time)  # a machine file takes 1000 samples at most
        return {
            "stroke_m": max(0.2 * self.reach, 20 * self.read),
            "tolerance_m": max(0.005 * self.reach, 5 * self.read),
            "settling_time_s": slowest,
            "reference_settling_time_s": slowest,
            "interval_s": min(10 * slowest, 2000 * self.sample_time),
            "motions": 5,
        }


def shift_of(axis: Axis, rng: np.random.Generator) -> dict[str, Any]:
    """How far the true values are off the nominal ones: one bounded draw for each, within what is known of it."""
    known, modes, contacts = axis.known, axis.gain.size - 1, axis.limit.size
    return {
        "payload_mass": known.mass * bounded(rng)[0],
        "thrust_constant": 0.0,
        "mode_gain": known.mode_gain * bounded(rng, modes),
        "mode_frequency": known.frequency * bounded(rng, modes),
        "mode_damping": known.damping * bounded(rng, modes),
        "presliding_stiffness": known.friction_level * bounded(rng)[0],
        "stiffness_each": known.stiffness * bounded(rng, contacts),
        "friction_level": 0.0,
        "limit_each": known.limit * bounded(rng, contacts),
        "amplifier_offset": known.offset * bounded(rng)[0],
        "dead_time": known.dead_time * bounded(rng)[0] if rng.random() < 0.7 else 0.0,
    }


def beyond(axis: Axis, name: str, rng: np.random.Generator) -> float:
    """A shift of one nominal parameter by 1.5 to 3 times the bound of its draw, either sign."""
    known = axis.known
    bound = {
        "payload_mass": 2 * known.mass,
        "thrust_constant": 2 * known.mass,
        "dead_time": 2 * known.dead_time,
        "mode_frequency": 2 * known.frequency,
        "mode_damping": 2 * known.damping,
        "friction_level": 2 * known.limit,
        "presliding_stiffness": 2 * known.friction_level,
        "amplifier_offset": 2 * known.offset,
    }[name]
    return float(np.clip(rng.choice([-1, 1]) * rng.uniform(1.5, 3.0) * bound, -0.6, None))


def shifted(axis: Axis, shift: Mapping[str, Any]) -> Axis:
    """The true machine. What acts at the thrust's input is in units of the command."""
    thrust = 1.0 + shift["thrust_constant"]
    rigid = thrust / (1.0 + shift["payload_mass"])
    stiffness = (1.0 + shift["presliding_stiffness"]) * (1.0 + np.asarray(shift["stiffness_each"]))
    return replace(
        axis,
        gain=axis.gain * np.concatenate([[rigid], thrust * (1.0 + np.asarray(shift["mode_gain"]))]),
        frequency=axis.frequency * np.concatenate([[1.0], 1.0 + np.asarray(shift["mode_frequency"])]),
        damping=axis.damping * np.concatenate([[1.0], 1.0 + np.asarray(shift["mode_damping"])]),
        stiffness=axis.stiffness * stiffness * (1.0 + shift["friction_level"]) / thrust,
        limit=axis.limit * (1.0 + np.asarray(shift["limit_each"])),
        offset=float(shift["amplifier_offset"]),
        dead_time=max(axis.dead_time + float(shift["dead_time"]), 0.0),
    )
