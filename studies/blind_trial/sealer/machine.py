"""What the compiled loop reads and writes: the true machine, the signals of a run, and what moves in between.

The loop's compiled code is cached by the types of these fields: give a new field its place at the end.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS: Final = 12  # in a sample
POINTS: Final = 4  # logged positions in a sample
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


class Run(NamedTuple):
    """Signals in, (n,) each: reference, feedforward, noise of the scale, lateness of a command [s], age of a reading
    [s], whether a reading is held (1) or taken (0), and a force [N]. z: the elements' start (E,). Written to: reading,
    command (n,), position (n, POINTS) at the fractions 0, 1/POINTS, ... of each sample, energy (1,) [J] lost in
    friction since the record began, start (E,) [m]: the elements then.
    """

    reference: Array
    feedforward: Array
    noise: Array
    late: Array
    stale: Array
    held: Array
    force: Array
    reading: Array
    command: Array
    position: Array
    energy: Array
    start: Array


class Moving(NamedTuple):
    """What the loop carries from step to step.

    y: states (STATES,); k: their rates at the four stages (4, STATES); trial: states at a stage; z: elements (E,);
    plays: contacts behind gaps (3,); slow: relaxed force and its three parts, two parts of the aged share, heat,
    remanent force, factor of warm friction; last: acceleration, friction, amplifier's input, applied command; pid:
    integral, error, derivative, reading; starts, inputs: when each command begins to act [s] and what it is then [N]
    (n,); active: the one that acts (1,).
    """

    y: Array
    k: Array
    trial: Array
    z: Array
    plays: Array
    slow: Array
    last: Array
    pid: Array
    starts: Array
    inputs: Array
    active: NDArray[np.int64]


class Held(NamedTuple):
    """What stays over a step: amplifier's input, a push [N], factor of the slip limits, where the contacts were [m]."""

    u: float
    push: float
    scale: float
    origin: float
