"""Options of deadbeat_design besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from studies.options import Options, choice, flag, quantities, quantity

if TYPE_CHECKING:
    from design.deadbeat import Objective


@dataclass(frozen=True, kw_only=True)
class DeadbeatOptions(Options):
    """Requirements on the feedforward, and the objective for its free parameters."""

    settling_time: float | None = quantity(
        "s",
        "TIME",
        'time by which x_T* rests on the target, such as "20 ms"; the time within which the motions are checked to '
        "settle stays the machine file's specification.settling_time "
        "(default: the machine file's specification.reference_settling_time; 20 ms for the default machine)",
    )
    stroke: float | None = quantity(
        "m",
        "LENGTH",
        'stroke of a motion, such as "20 um" '
        "(default: the machine file's specification.stroke; 20 um for the default machine)",
    )
    long_stroke: tuple[float, ...] = quantities(
        "m",
        "LENGTH",
        'stroke of a longer move, such as "5 mm", which goes along a profile through N_ff and D_ff; may be repeated '
        "(default: 50, 250 and 1000 times a specified stroke within the presliding region; 1, 5 and 20 mm for the "
        "default machine)",
        above=0,
        below=1e3,
    )
    objective: Objective = choice(
        "objective for the feedforward's free parameters: least squares of the thrust's differences (default) or of "
        "the thrust, least peak thrust, or least residual vibration when a mode's frequency is off by up to 5 %%",
        ("thrust_difference", "thrust", "peak_thrust", "mode_robustness"),
    )
    thrust_limit: float | None = quantity(
        "N",
        "FORCE",
        'largest |u_ff|, such as "120 N" '
        "(default: the rated thrust less T_fc, which friction may need; 133.5 N for the default machine)",
    )
    overshoot: float | None = quantity(
        "1", "RATIO", 'largest overshoot of x_T* over the stroke, such as "0.05"', at_least=0
    )
    monotone: bool = flag("x_T* must not move backwards")
