"""What the compiled loop of a drawn machine reads and writes: its true parameters, the signals of a run, its states.

Whatever a case may change stands in one array of coefficients, each at the place that its name has in NAMES. All are 0
without an effect; a `..._form` says which of several functional forms applies.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POINTS: Final = 4  # logged positions in a sample
ATTACHED: Final = 9  # states behind those of the modes: attached mass, current, friction's lag, one more mode
SLOW: Final = 18  # states that move once a step

NAMES: Final = (
    "step",
    "relax_form",
    "relax",
    "relax_time",
    "relax_length",
    "age_form",
    "age",
    "age_time",
    "age_length",
    "drag_form",
    "drag",
    "drag_speed",
    "stribeck_form",
    "stribeck",
    "stribeck_speed",
    "stribeck_length",
    "direction_form",
    "direction",
    "direction_speed",
    "place_form",
    "place",
    "place_length",
    "place_phase",
    "lag_form",
    "lag",
    "lag_speed",
    "warm_form",
    "warm",
    "warm_time",
    "gap_form",
    "gap",
    "cog_form",
    "cog",
    "cog_pitch",
    "cog_phase",
    "ripple_form",
    "ripple",
    "ripple_pitch",
    "ripple_phase",
    "travel",
    "asymmetry_form",
    "asymmetry",
    "asymmetry_force",
    "knee_form",
    "knee",
    "current_form",
    "current",
    "deadband_form",
    "deadband",
    "dac_form",
    "dac",
    "mass_form",
    "mass",
    "mass_omega",
    "mass_zeta",
    "mass_gap",
    "mass_cubic",
    "spring_form",
    "spring",
    "spring_place",
    "spring_length",
    "creep_form",
    "creep",
    "creep_time",
    "grating_form",
    "grating",
    "grating_period",
    "grating_phase",
    "odd_form",
    "odd",
    "odd_length",
    "odd_force",
    "load",
    "load_force",
    "fade",
    "fade_time",
    "fade_force",
    "remanence",
    "remanence_force",
    "bump",
    "bump_place",
    "bump_width",
    "slower",
    "bracket",
    "eddy",
    "eddy_place",
    "eddy_width",
    "selfheat",
    "selfheat_time",
    "selfheat_power",
)
PLACE: Final = {name: i for i, name in enumerate(NAMES)}

CONTROL: Final = ("kind", "kp", "ki", "kd", "tau", "b", "c", "kpos", "kvel", "tn", "f", "m")
"""A PID with set-point weights b and c (kind 0), or a P/PI cascade (kind 1); SI."""


class Truth(NamedTuple):
    """The true machine, in SI. Modes: gain (m,), omega (m,), zeta (m,); elements: stiffness (E,), limit (E,)."""

    sample_time: float
    dead_time: float
    gain: Array
    omega: Array
    zeta: Array
    stiffness: Array
    limit: Array
    resolution: float
    control: Array
    delay: int
    offset: float
    steps: int
    c: Array


class Signals(NamedTuple):
    """In, (n,) each: reference, feedforward, noise of the scale, lateness of a command [s], age of a reading [s],
    whether a reading is held, a force [N]. Written to: reading [m], command [N], and position (n, POINTS) [m]; start:
    the elements (E,) [m] when the record begins.
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
    start: Array


class Motion(NamedTuple):
    """What moves from step to step: y: modes and attachments; k: their rates at four stages; trial: at one stage; z:
    elements (E,); gaps (3,); slow (SLOW,); last: acceleration, friction, input, applied command; law: the controller's
    states; starts, inputs (n,): when each command begins to act [s], and what it is then [N]; active (1,).
    """

    y: Array
    k: Array
    trial: Array
    z: Array
    gaps: Array
    slow: Array
    last: Array
    law: Array
    starts: Array
    inputs: Array
    active: NDArray[np.int64]
