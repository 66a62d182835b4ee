"""The forms of the catalogue's effects on friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.forms import (
    EITHER,
    TURN,
    Draw,
    Form,
    Units,
    drag,
    fields,
    none,
    pitch,
    reach,
    share,
    times,
)

Array = NDArray[np.float64]


def _on_rest(name: str, size: tuple[float, float, float], form: float, text: str) -> Form:
    def ranges(units: Units) -> Mapping[str, Draw]:
        if name == "relax":
            plain = {"relax_time": (0.05, 0.6)}
            return plain if form == 1.0 else {**plain, "relax_length": (0.05 * units.reach, 0.5 * units.reach)}
        return {"age_time": (0.08, 1.0), "age_length": (0.03 * units.reach, 0.3 * units.reach)}

    effect = {"relax": "friction_relaxation", "age": "dwell_breakaway"}[name]
    return Form(effect, text, "1", share(*size), ranges, fields(name, form))


def _stribeck_ranges(units: Units) -> Mapping[str, Draw]:
    return {
        "stribeck_speed": (units.speed / 200, units.speed / 15),
        "stribeck_length": (0.05 * units.reach, 0.5 * units.reach),
    }


def _direction_ranges(units: Units) -> Mapping[str, Draw]:
    return {"direction_speed": (units.speed / 1000, units.speed / 40), "sign": EITHER}


def _place_ranges(units: Units) -> Mapping[str, Draw]:
    return {"place_length": pitch(units), "place_phase": TURN}


def _lags(units: Units) -> tuple[float, float, float]:
    tick, crossover = units.axis.sample_time, units.axis.crossover
    return min(0.1 * tick, 2e-3 / crossover), 5e-3 / crossover, 0.3 / crossover


FRICTION: Final = (
    _on_rest("relax", (0.002, 0.05, 0.5), 1.0, "five time scales, 256 to 1"),
    _on_rest("relax", (0.002, 0.05, 0.5), 2.0, "at rest, ever slower; slip loads it again"),
    _on_rest("age", (0.004, 0.1, 0.8), 1.0, "two time scales, lost exponentially over the way"),
    _on_rest("age", (0.001, 0.03, 0.3), 2.0, "logarithm of the contacts' age (Dieterich 1979)"),
    Form(
        "viscous_friction",
        "asinh of the speed",
        "N s/m",
        times(drag, 1e-4, 0.02, 3.0),
        lambda units: {"drag_speed": (0.1 * units.speed, 0.6 * units.speed)},
        fields("drag", 1.0),
    ),
    Form(
        "viscous_friction",
        "speed and its square",
        "N s/m",
        times(drag, 1e-4, 0.02, 3.0),
        lambda units: {"drag_speed": (0.3 * units.speed, 2.0 * units.speed)},
        fields("drag", 2.0),
    ),
    Form("stribeck", "1/(1 + |v/v_s|^1.5)", "1", share(0.001, 0.02, 0.6), _stribeck_ranges, fields("stribeck", 1.0)),
    Form(
        "stribeck",
        "generalised Maxwell slip: limits follow exp(-|v/v_s|) over a way (Lampaert et al. 2003)",
        "1",
        share(0.001, 0.02, 0.6),
        _stribeck_ranges,
        fields("stribeck", 2.0),
    ),
    Form(
        "directional_friction",
        "force times 1 + a v/(v^2 + v_d^2)^(1/2)",
        "1",
        share(0.0005, 0.01, 0.4),
        _direction_ranges,
        fields("direction", 1.0),
    ),
    Form(
        "directional_friction",
        # Not another slip limit each way: that moves each contact's middle, and is an offset of the amplifier.
        "limits times 1 + a tanh(v/v_d)",
        "1",
        share(0.0005, 0.01, 0.4),
        _direction_ranges,
        fields("direction", 2.0),
    ),
    Form(
        "position_dependent_friction",
        "limits with three harmonics",
        "1",
        share(0.0003, 0.006, 0.4),
        _place_ranges,
        fields("place", 1.0),
    ),
    Form(
        "position_dependent_friction",
        "force with rounded steps",
        "1",
        share(0.0003, 0.006, 0.4),
        _place_ranges,
        fields("place", 2.0),
    ),
    Form(
        "frictional_lag",
        "two lags in series",
        "s",
        _lags,
        none,
        fields("lag", 1.0),
    ),
    Form(
        "frictional_lag",
        "one lag, shorter at speed",
        "s",
        _lags,
        lambda units: {"lag_speed": (units.speed / 20, units.speed)},
        fields("lag", 2.0),
    ),
    Form(
        "friction_drift",
        "saturating exponentially",
        "1",
        share(0.002, 0.03, 0.6),
        lambda units: {"warm_time": (0.2 * units.lasts, 1.5 * units.lasts)},
        fields("warm", 1.0),
    ),
    Form(
        "friction_drift",
        "two bodies that warm",
        "1",
        share(0.002, 0.03, 0.6),
        lambda units: {"warm_time": (0.1 * units.lasts, 0.5 * units.lasts), "sign": EITHER},
        fields("warm", 2.0),
    ),
    Form("play", "three clearances side by side", "m", times(reach, 3e-4, 0.01, 0.3), none, fields("gap", 1.0)),
    Form("play", "a clearance before half the contacts", "m", times(reach, 3e-4, 0.02, 0.3), none, fields("gap", 2.0)),
)
