"""All numbers of the law as a drive runs it, from a controller and what its file says beside it.

The feedforward's polynomials become responses to a step of the target, so that the law only needs the changes of the
target and loses no digits far from 0: with c[k] = r[k] - r[k-1] and M one less than the longest polynomial's length,

    x_T*[k] = r[k-M] + sum over j < M of S_j c[k-j],   S_j = n_0 + ... + n_j,

and likewise u_ff with d_j and the compensator's path with its own. N_ff(1) = 1 and D_ff(1) = 0 make it the same.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from models.controller import PID, Controller, ControllerError, References, load, references
from models.deployment.learning_numbers import Learning, learning_numbers
from models.effect_feedforward import NOWHERE, effect_thrust
from models.feedback.law import POSITION, REFERENCE, Law

Row = tuple[float, ...]

COEFFICIENT_ROUNDING: Final = 1e-6  # by which N_ff(1) may differ from 1, and D_ff(1) from 0 in its largest coefficient
STEEPEST: Final = 10 / math.sqrt(3)  # largest second derivative of the wipe's profile 10 s^3 - 15 s^4 + 6 s^5
MAX_MOTION_SAMPLES: Final = 1_000_000  # samples of a wipe, or of a plan
TALL: Final = 10_000  # coefficients of a polynomial


@dataclass(frozen=True)
class WipeMotion:
    """Out by `distance` [m] and back, each way in `count` samples and followed by `still` samples at rest.

    amplitude [N]: u_ff is it times 60 s - 180 s^2 + 120 s^3.
    """

    distance: float
    count: int
    still: int
    amplitude: float


@dataclass(frozen=True)
class Coefficients:
    """The numbers of the law; SI. See `models.deployment.running_law` for what is computed with them.

    position, path [m/m] and thrust [N/m], M each: the responses of x_T*, of the compensator's path and of u_ff to a
    step of the target. tracking [1]: the share of what the limit cuts off the command that a PID's integral gives back
    in a sample; 0 for none, and for a law, which has its own. start [N]: what the integral holds where nothing else is
    known. plan (k,) [N]: thrust to be added from a motion's first sample on. learning: how the axis learns, if it does.
    """

    sample_time: float
    stroke: float
    position: Row
    path: Row
    thrust: Row
    delay: int
    pid: PID
    law: Law | None
    stiffness: Row
    limit: Row
    thrust_limit: float
    tracking: float
    start: float
    wipe: WipeMotion | None = None
    plan: Row = ()
    learning: Learning | None = None

    @property
    def memory(self) -> int:
        """Targets that the law has to remember [-]."""
        return len(self.position) + self.delay + 1


def step_responses(controller: Controller, least: int = 2) -> tuple[Row, Row, Row]:
    """S_j of x_T*, of the compensator's path [m/m] and of u_ff [N/m], of at least so many polynomials' coefficients.
    Raises ValueError for a feedforward that does not end at rest on its target."""
    path_ff = controller.n_ff if controller.path_ff is None else controller.path_ff
    longest = max(len(controller.n_ff), len(controller.d_ff), len(path_ff), least)
    sums = [
        list(accumulate([*row, *[0.0] * (longest - len(row))])) for row in (controller.n_ff, path_ff, controller.d_ff)
    ]
    largest = max(*map(abs, controller.d_ff), 1e-300)
    if (
        abs(sums[0][-1] - 1) > COEFFICIENT_ROUNDING
        or abs(sums[1][-1] - 1) > COEFFICIENT_ROUNDING
        or abs(sums[2][-1]) > COEFFICIENT_ROUNDING * largest
    ):
        raise ValueError("the feedforward must end at rest on its target: the sum of n_ff must be 1 and that of d_ff 0")
    if longest > TALL:
        raise ValueError(f"n_ff and d_ff may have at most {TALL} coefficients")
    position, path, thrust = (tuple(row[:-1]) for row in sums)
    return position, path, thrust


def coefficients(
    controller: Controller,
    stroke: float,
    thrust_limit: float,
    *,
    start: float = 0.0,
    anti_windup: float = 0.0,
    wipe: WipeMotion | None = None,
    plan: Row = (),
    learning: Learning | None = None,
) -> Coefficients:
    """The numbers of a controller's law, all SI. anti_windup: a PID's time constant, 0: none.

    Raises ValueError, a sentence, for a controller that no drive can run as it stands.
    """
    law, pid, rfm = controller.law, controller.pid, controller.friction_compensation
    if law is not None and (
        any(row[REFERENCE] != -row[POSITION] for row in law.b) or law.d[REFERENCE] != -law.d[POSITION]
    ):
        raise ValueError("the law must take its reference as it takes the position; give one that a study wrote")
    least = 2 if learning is None else len(learning.early) + 1  # x_T* may end later for a longer dead time
    return Coefficients(
        controller.sample_time,
        stroke,
        *step_responses(controller, least),
        delay=controller.reference_delay,
        pid=pid,
        law=law,
        stiffness=() if rfm is None else rfm.stiffness,
        limit=() if rfm is None else rfm.limit,
        thrust_limit=thrust_limit,
        tracking=controller.sample_time / anti_windup if anti_windup > 0 and law is None and pid.ki > 0 else 0.0,
        start=start,
        wipe=wipe,
        plan=plan,
        learning=learning,
    )


def deployment_to_json(thrust_limit: float, resolution: float, offset: float) -> dict[str, Any]:
    """What a drive needs beyond models.controller.to_json: the rated thrust [N], the scale's step [m], and the constant
    force [N] that the integral holds before anything else is known."""
    return {
        "thrust_limit_N": thrust_limit,
        "scale_resolution_m": resolution,
        "start": {"thrust_N": offset},
    }


def load_coefficients(path: Path, thrust_limit: float, start: float, anti_windup: float = 0.0) -> Coefficients:
    """The numbers [SI] of a controller.json; thrust_limit, start [N]: where an older file does not say.

    anti_windup: as of `coefficients`. Raises ControllerError, a sentence.
    """
    controller = load(path)
    content = json.loads(path.read_text(encoding="utf-8"))
    try:
        known, learning = _beyond(content, controller), _learning(content, controller)
        limit = _number(content, "thrust_limit_N", thrust_limit, above=0.0)
        held = _number(content.get("start", {}), "thrust_N", start)
        stroke = _number(content, "stroke_m", None, above=0.0)
        return coefficients(controller, stroke, limit, start=held, anti_windup=anti_windup, learning=learning, **known)
    except KeyError as error:
        raise ControllerError(f"{path}: {error.args[0]!r} is missing; add it") from error
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise ControllerError(f"{path}: {error}") from error


def _beyond(content: Mapping[str, Any], controller: Controller) -> dict[str, Any]:
    """The wipe and the plan of a controller.json."""
    known: dict[str, Any] = {}
    if "wipe" in content:
        known["wipe"] = wipe_motion(content["wipe"], controller.sample_time)
    planned = (content.get("effect_compensation") or {}).get("plan")
    if planned is not None:
        known["plan"] = _numbers(planned, "thrust_N")
        if len(known["plan"]) > MAX_MOTION_SAMPLES:
            raise ValueError(
                f"effect_compensation.plan has more than {MAX_MOTION_SAMPLES} samples; plan a shorter sequence"
            )
    return known


def _learning(content: Mapping[str, Any], controller: Controller) -> Learning | None:
    """The learning of a controller.json that has a compensator to teach and a wipe to begin with."""
    if controller.friction_compensation is None or "wipe" not in content:
        return None
    return learning_numbers(content.get("learning", {}), controller.sample_time)


def wipe_motion(content: Mapping[str, Any], sample_time: float) -> WipeMotion:
    """The wipe of a controller.json at a sample time [s]. Raises ValueError, a sentence, or KeyError."""
    names = ("distance_m", "duration_s", "rest_s", "peak_thrust_N")
    distance, duration, rest, peak = (_number(content, name, None, above=-1e-300) for name in names)
    count, still = round(duration / sample_time), round(rest / sample_time)
    if not 1 <= count <= MAX_MOTION_SAMPLES or still > MAX_MOTION_SAMPLES:
        raise ValueError(f"wipe: duration_s must be from 1 to {MAX_MOTION_SAMPLES} samples, and rest_s at most as long")
    return WipeMotion(distance, count, still, peak / STEEPEST)


def _number(content: Mapping[str, Any], name: str, otherwise: float | None, *, above: float = -math.inf) -> float:
    if otherwise is None and name not in content:
        raise KeyError(name)
    number = float(content.get(name, otherwise))
    if not (math.isfinite(number) and number > above):
        raise ValueError(f"{name} must be a finite number" + (" above 0" if above == 0 else ""))
    return number


def _numbers(content: Mapping[str, Any], name: str) -> Row:
    numbers = tuple(float(number) for number in content[name])
    if not numbers or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"{name} must be a list of finite numbers")
    return numbers


def planned(controller: Controller, target: ArrayLike, past: ArrayLike = NOWHERE) -> Row:
    """The thrust [N] that `effect_compensation` asks for beside the compensator's elements, over a target (n,) [m] from
    rest at 0 and after a `past` (m,) [m], see `effect_thrust`: it looks ahead, so that a drive has to play it as a
    table."""
    ahead = controller.effect_compensation
    if ahead is None:
        return ()
    bare: References = references(replace(controller, effect_compensation=None), target)
    thrust, friction = bare.feedforward + bare.compensation, controller.friction_compensation
    return tuple(
        effect_thrust(ahead, friction, bare.position, thrust, controller.sample_time, np.asarray(past)).tolist()
    )
