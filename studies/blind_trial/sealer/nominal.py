"""The nominal table, which the answering process knows, and how far the true one deviates from it."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FILE: Final = Path(__file__).with_name("nominal.json")

# One standard deviation of every nominal value; draws are bounded at two.
MASS = 0.01
LOAD = 0.05
LOAD_SHARE = 0.2  # of the load mass in the rigid body's
THRUST = 0.01
FREQUENCY = 0.004
DAMPING = 0.1
STIFFNESS_EACH = 0.03
STIFFNESS_ALL = 0.03
LIMIT = 0.03
OFFSET = 0.1  # [N]
LATENESS: Final = 25e-6  # bound of the dead time's error [s]
NOISE: Final = 30e-9  # white, before rounding, one standard deviation [m]


@dataclass(frozen=True)
class Table:
    """A machine and its controller. modes: gain (m,) [1/kg], frequency (m,) [Hz], damping (m,); friction: stiffness
    (N,) [N/m], limit (N,) [m]; dead_time, sample_time [s]; offset: constant force [N]; gains: kp, ki, kd, tau.
    """

    sample_time: float
    dead_time: float
    gain: Array
    frequency: Array
    damping: Array
    stiffness: Array
    limit: Array
    resolution: float
    gains: tuple[float, float, float, float]
    reference_delay: int
    offset: float = 0.0


def load(path: Path = FILE) -> Table:
    """The table of a nominal.json; the thrust constant is taken into the modes' gains."""
    raw: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    modes, friction, pid = raw["modes"], raw["friction"], raw["controller"]
    return Table(
        raw["sample_time_s"],
        raw["dead_time_s"],
        np.array([mode["gain_per_kg"] for mode in modes]) * raw["thrust_constant"],
        np.array([mode["frequency_Hz"] for mode in modes]),
        np.array([mode["damping"] for mode in modes]),
        np.array(friction["stiffness_N_per_m"]),
        np.array(friction["limit_m"]),
        raw["scale"]["resolution_m"],
        (pid["kp_N_per_m"], pid["ki_N_per_ms"], pid["kd_Ns_per_m"], pid["derivative_filter_s"]),
        pid["reference_delay_samples"],
    )


def bounded(rng: np.random.Generator, count: int = 1) -> Array:
    """Standard normal draws (count,), each drawn again until it is within two standard deviations."""
    draws = rng.standard_normal(count)
    while np.any(far := np.abs(draws) > 2.0):
        draws[far] = rng.standard_normal(int(far.sum()))
    return draws


def shift_of(rng: np.random.Generator) -> dict[str, Any]:
    """How far the true values are off, relative unless said: one draw for every nominal value."""
    modes, contacts = 3, 10
    return {
        "thrust_constant": THRUST * bounded(rng)[0],
        "body_mass": MASS * bounded(rng)[0],
        "payload_mass": LOAD * bounded(rng)[0],
        "mode_gain": MASS * bounded(rng, modes - 1),
        "mode_frequency": FREQUENCY * bounded(rng, modes - 1),
        "mode_damping": DAMPING * bounded(rng, modes - 1),
        "presliding_stiffness": STIFFNESS_ALL * bounded(rng)[0],
        "stiffness_each": STIFFNESS_EACH * bounded(rng, contacts),
        "friction_level": 0.0,
        "limit_each": LIMIT * bounded(rng, contacts),
        "amplifier_offset": OFFSET * bounded(rng)[0],  # [N]
        "dead_time": LATENESS * rng.uniform(-1, 1) if rng.random() < 0.6 else 0.0,  # [s]
    }


def beyond(name: str, rng: np.random.Generator) -> float:
    """A shift of one nominal parameter that is more than its tolerance: 1.5 to 3 times the bound, either sign."""
    bound = {
        "payload_mass": 2 * LOAD,
        "thrust_constant": 2 * THRUST,
        "dead_time": LATENESS,
        "mode_frequency": 2 * FREQUENCY,
        "mode_damping": 2 * DAMPING,
        "friction_level": 2 * LIMIT,
        "presliding_stiffness": 2 * STIFFNESS_ALL,
        "amplifier_offset": 2 * OFFSET,
    }[name]
    return float(rng.choice([-1, 1]) * rng.uniform(1.5, 3.0) * bound)


def shifted(table: Table, shift: dict[str, Any]) -> Table:
    """The true table. friction_level turns the friction force of every displacement, limits staying where they are."""
    rigid = (1 + shift["thrust_constant"]) / (
        (1 + shift["body_mass"]) * (1 - LOAD_SHARE) + LOAD_SHARE * (1 + shift["payload_mass"])
    )
    flexible = (1 + shift["thrust_constant"]) * (1 + np.asarray(shift["mode_gain"]))
    force = (1 + shift["presliding_stiffness"]) * (1 + np.asarray(shift["stiffness_each"]))
    # what acts at the thrust's input is in units of the command: the thrust constant must not turn the friction's force
    return replace(
        table,
        gain=table.gain * np.concatenate([[rigid], flexible]),
        frequency=table.frequency * np.concatenate([[1.0], 1 + np.asarray(shift["mode_frequency"])]),
        damping=table.damping * np.concatenate([[1.0], 1 + np.asarray(shift["mode_damping"])]),
        stiffness=table.stiffness * force * (1 + shift["friction_level"]) / (1 + shift["thrust_constant"]),
        limit=table.limit * (1 + np.asarray(shift["limit_each"])),
        offset=shift["amplifier_offset"],
        dead_time=table.dead_time + shift["dead_time"],
    )
