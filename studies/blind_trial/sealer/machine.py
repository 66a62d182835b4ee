"""The true machine as the compiled loop reads it, and what stays over a step.

The loop's compiled code is cached by the types of these fields: give a new field its place at the end.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS: Final = 12  # in a sample
SLOW: Final = 9  # relaxed force and its three parts, two parts of the aged share, heat, remanent force, warm friction
LAW: Final = 4  # integral, error, derivative, reading
STATES: Final = 12  # three modes, an attached mass, the amplifier's lag, the friction's lag: each a value and its rate


class Physics(NamedTuple):
    """The true machine. Every field from `viscous` on is off by default; units in SI."""

    sample_time: float
    dead_time: float
    gain: Array
    omega: Array
    zeta: Array
    stiffness: Array
    limit: Array
    resolution: float
    kp: float
    ki: float
    kd: float
    tau: float
    reference_delay: int
    offset: float
    viscous: float = 0.0
    viscous_speed: float = 0.1
    stribeck: float = 0.0
    stribeck_speed: float = 0.002
    directional: float = 0.0
    turn_speed: float = 3e-4
    place: float = 0.0
    place_length: float = 0.02
    place_phase: float = 0.0
    warm: float = 0.0
    warm_time: float = 20.0
    relaxed: float = 0.0
    relax_time: float = 0.3
    aged: float = 0.0
    age_time: float = 1.0
    age_length: float = 4e-6
    friction_lag: float = 0.0
    gap: float = 0.0
    cogging: float = 0.0
    cogging_pitch: float = 0.03
    cogging_phase: float = 0.0
    ripple: float = 0.0
    ripple_pitch: float = 0.03
    ripple_phase: float = 0.0
    asymmetry: float = 0.0
    knee: float = 0.0
    lag: float = 0.0
    deadband: float = 0.0
    dac: float = 0.0
    mass: float = 0.0
    mass_omega: float = 1.0
    mass_zeta: float = 0.01
    mass_gap: float = 0.0
    mass_cubic: float = 0.0
    spring: float = 0.0
    spring_place: float = 0.0
    creep: float = 0.0
    creep_time: float = 3.0
    grating: float = 0.0
    grating_period: float = 2e-5
    grating_phase: float = 0.0
    fade: float = 0.0
    fade_time: float = 5.0
    lopsided: float = 0.0
    jerky: float = 0.0
    parametric: float = 0.0
    parametric_length: float = 0.004
    remanence: float = 0.0
    remanence_force: float = 15.0
    bump: float = 0.0
    bump_place: float = 0.03
    bump_width: float = 3e-4
    slower: float = 0.0
    bracket: float = 0.0
    eddy: float = 0.0
    eddy_place: float = 0.03
    eddy_width: float = 0.005
    ladder: float = 0.0


class Held(NamedTuple):
    """What stays over a step: amplifier's input, a push [N], factor of the slip limits, where the contacts were [m]."""

    u: float
    push: float
    scale: float
    origin: float
