"""The true parameters of a drawn machine as its compiled loop reads them.

Whatever a case may change stands in one array of coefficients, each at the place that its name has in NAMES. All are 0
without an effect; a `..._form` says which of several functional forms applies.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ATTACHED: Final = 9  # states behind those of the modes: attached mass, current, friction's lag, one more mode
SLOW: Final = 18  # states that move once a step
LAW: Final = 6  # states of the controller, the last of them its reading

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
