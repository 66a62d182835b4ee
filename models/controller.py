"""The sampled 2DoF law of Figs. 6 and 13: x_T*, u_ff and u_rf from the target, dead-time compensation, PID."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.effect_feedforward import EffectFeedforward, effect_thrust
from models.effects import catalogue
from models.effects.base import Effect, parameters
from models.feedback.law import Law, law_from_json, law_to_json
from models.friction import Friction, elements, follow
from models.machines.text_file import brief, text_of
from models.quantity import QuantityError, check, cut, declaration, json_name, show, value

Array = NDArray[np.float64]


LATEST: Final = 1000  # samples by which a reference may wait
GAIN: Final = "no axis is stable with a higher gain"
SET_POINT_REASON: Final = "no controller moves a set point more than twice as far as its reference"
GAINS: Final = {
    "kp": "kp_N_per_m",
    "ki": "ki_N_per_ms",
    "kd": "kd_Ns_per_m",
    "derivative_filter": "derivative_filter_s",
}  # as a controller.json names them
WEIGHTS: Final = {name: name for name in ("proportional_weight", "derivative_weight")}  # which it holds unless 1
PATH: Final = "compensator_path_ff"  # as a controller.json names path_ff


class ControllerError(ValueError):
    """A controller file that can't be used; the message is one sentence: what, where, what to do."""


@dataclass(frozen=True)
class PID:
    """C(z) at sample k, with e[k] = x_T*[k - delay] - x[k] and a = tau / (tau + T_s):

    I[k] = I[k-1] + ki T_s e[k];  d[k] = a d[k-1] + (1 - a) (e[k] - e[k-1]) / T_s;  u_fb = kp e + I + kd d.

    With set-point weights other than 1, kp is of b x_T* - x and the derivative of c x_T* - x.

    >>> pos.PID(kp=1e6, ki=5e7, kd=1e4, derivative_filter=1e-4).pole(5e-4)  # a
    0.1666...
    """

    kp: float = value("N/m", "proportional gain", at_least=0, at_most=1e15, because=GAIN)
    ki: float = value("N/(m s)", "integral gain", at_least=0, at_most=1e19, because=GAIN)
    kd: float = value("N s/m", "derivative gain", at_least=0, at_most=1e12, because=GAIN)
    derivative_filter: float = value(
        "s",
        "time constant tau of the derivative's filter",
        at_least=0,
        at_most=100,
        because="it would filter all motion",
    )
    proportional_weight: float = value(
        "1",
        "weight b of the reference in the proportional part",
        at_least=0,
        at_most=2,
        because=SET_POINT_REASON,
        default=1.0,
    )
    derivative_weight: float = value(
        "1",
        "weight c of the reference in the derivative part",
        at_least=0,
        at_most=2,
        because=SET_POINT_REASON,
        default=1.0,
    )

    @property
    def plain(self) -> bool:
        """Whether it is a law of the error alone, the one at the head of the class."""
        return self.proportional_weight == 1 and self.derivative_weight == 1

    def pole(self, sample_time: float) -> float:
        """The pole a = tau / (tau + T_s) [1] of the derivative's filter at a sample time [s]; 0 without a filter."""
        return self.derivative_filter / (self.derivative_filter + sample_time)


Feedback = PID | Law  # what runs: a PID as it stands there, or any other structure as its law


@dataclass(frozen=True)
class Controller:
    """One 2DoF law at one sample time: x_T* = N_ff(z) r, u_ff = D_ff(z) r, u_M = u_fb + u_ff + u_rf.

    n_ff, d_ff: coefficients of z^0, z^-1, ... [m/m] and [N/m]; reference_delay [samples]: the z^-d by which the PID's
    reference waits for the dead time (Smith's method); friction_compensation: the RFM, or None for u_rf = 0; path_ff:
    N_ff [m/m] of the path that its elements follow, or None for x_T* itself, as in the paper; effect_compensation:
    effects that u_rf meets along x_T*, too, or None. law: what runs in place of the PID, where the feedback has another
    structure; the PID then tells no more than the size of its gains. Raises ValueError for a PID with set-point weights
    without the law that they make of it (`models.feedback.forms.law_of`).

    >>> controller
    Controller(T_s = 500 µs, reference 2 samples late, feedforward of 41 samples, with friction compensation)
    >>> controller.without_compensation()
    Controller(T_s = 500 µs, reference 2 samples late, feedforward of 41 samples, without friction compensation)
    """

    sample_time: float
    pid: PID
    reference_delay: int
    n_ff: tuple[float, ...]
    d_ff: tuple[float, ...]
    friction_compensation: Friction | None = None
    effect_compensation: EffectFeedforward | None = None
    law: Law | None = None
    path_ff: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """A PID runs as a law of the error alone, so that weights without their law would be left out unseen."""
        if self.law is None and not self.pid.plain:
            raise ValueError("pid: set-point weights other than 1 make another law of it; state that as `law`, too")

    @property
    def feedback(self) -> Feedback:
        """What makes u_fb [N] of reference and position [m]."""
        return self.law or self.pid

    @property
    def has_integral(self) -> bool:
        """Whether the feedback holds a constant force at rest."""
        return self.pid.ki > 0 if self.law is None else self.law.has_integral

    def with_feedback(self, feedback: Feedback) -> Controller:
        """The same feedforward with another feedback, a law in the form of the error that it is designed for."""
        if isinstance(feedback, Law):
            return replace(self, law=feedback.of_error())
        return replace(self, pid=feedback, law=None)

    def __repr__(self) -> str:
        rfm = "without" if self.friction_compensation is None else "with"
        return (
            f"Controller(T_s = {show(self.sample_time, 's')}, reference {self.reference_delay} samples late, "
            f"feedforward of {len(self.d_ff)} samples, {rfm} friction compensation)"
        )

    def without_compensation(self) -> Controller:
        """The same law with u_rf = 0 (Fig. 6)."""
        return replace(self, friction_compensation=None, effect_compensation=None)


def to_json(controller: Controller, stroke: float, settling_time: float) -> dict[str, Any]:
    """The content of controller.json; the feedforward was designed for stroke [m] and settling_time [s]."""
    pid, rfm, ahead = controller.pid, controller.friction_compensation, controller.effect_compensation
    content: dict[str, Any] = {
        "sample_time_s": controller.sample_time,
        "stroke_m": stroke,
        "settling_time_s": settling_time,
        "n_ff": list(controller.n_ff),
        "d_ff": list(controller.d_ff),
        "reference_delay_samples": controller.reference_delay,
        "pid": {key: getattr(pid, name) for name, key in (GAINS if pid.plain else GAINS | WEIGHTS).items()},
        "friction_compensation": rfm and {"stiffness_N_per_m": list(rfm.stiffness), "limit_m": list(rfm.limit)},
        PATH: list(controller.n_ff if controller.path_ff is None else controller.path_ff),
    }
    if controller.law is not None:
        content["law"] = law_to_json(controller.law)
    if ahead is not None:
        content["effect_compensation"] = {"late_s": ahead.fractional_delay, "effects": _effects_to_json(ahead.effects)}
    return content


def load(path: str | Path) -> Controller:
    """The controller in a controller.json. Raises ControllerError, a sentence, for what is missing or impossible.

    >>> pos.load_controller(folder / "controller.json") == controller
    True
    """
    path = Path(path)
    try:
        content = json.loads(text_of(path))
    except OSError as error:
        raise ControllerError(f"{path}: can't be read ({error.strerror}); give an existing controller.json") from error
    except RecursionError as error:
        raise ControllerError(
            f"{path}: its objects are nested too deeply; give a controller.json that a study wrote"
        ) from error
    except ValueError as error:
        raise ControllerError(
            f"{path}: is not valid JSON ({brief(error)}); give a controller.json that a study wrote"
        ) from error
    try:
        return _from_json(content)
    except KeyError as error:
        raise ControllerError(f"{path}: {cut(error.args[0])[1:-1]} is missing; add it") from error
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise ControllerError(f"{path}: {brief(error)}; give a controller.json that a study wrote") from error


def _from_json(content: Mapping[str, Any]) -> Controller:
    pid, rfm = content["pid"], content["friction_compensation"]
    gains = {name: float(pid[key]) for name, key in GAINS.items()}
    gains |= {name: float(pid[key]) for name, key in WEIGHTS.items() if key in pid}
    sample_time, delay = float(content["sample_time_s"]), int(content["reference_delay_samples"])
    numbers = (*gains.values(), *content["n_ff"], *content["d_ff"])
    if not all(math.isfinite(number) for number in numbers) or min(gains.values()) < 0:
        raise ValueError("a gain or coefficient is negative or not finite")
    for name, gain in gains.items():
        _check(f"pid.{name}", gain, PID)
    if not (math.isfinite(sample_time) and sample_time > 0 and 0 <= delay <= LATEST):
        raise ValueError(f"sample_time_s must be above 0 and reference_delay_samples from 0 to {LATEST}")
    if not content["n_ff"] or not content["d_ff"]:
        raise ValueError("n_ff and d_ff need at least one coefficient each")
    compensation = rfm and elements(rfm["stiffness_N_per_m"], rfm["limit_m"])
    for name in ("stiffness", "limit") if compensation else ():
        for number in getattr(compensation, name):
            _check(f"friction_compensation.{name}", number, Friction)
    known = content.get("effect_compensation")
    ahead = known and EffectFeedforward(_effects_from_json(known["effects"]), float(known["late_s"]))
    if ahead and not 0 <= ahead.fractional_delay < sample_time:
        raise ValueError("effect_compensation.late_s must be at least 0 and below sample_time_s")
    filters = tuple(content["n_ff"]), tuple(content["d_ff"])
    law = law_from_json(content["law"], sample_time) if "law" in content else None
    return Controller(sample_time, PID(**gains), delay, *filters, compensation, ahead, law, _path_from_json(content))


def _path_from_json(content: Mapping[str, Any]) -> tuple[float, ...] | None:
    """N_ff of the compensator's path [m/m]; None where it is that of x_T*, or is not stated."""
    if PATH not in content and "trajectory" in content:  # an older file, which has the path itself
        middle = np.array(content["trajectory"]["middle_m"], float) / float(content["stroke_m"])
        return tuple(np.diff(middle, prepend=0.0).tolist())
    if PATH not in content:
        return None
    path = tuple(float(number) for number in content[PATH])
    if not path or not all(math.isfinite(number) for number in path):
        raise ValueError(f"{PATH} must be a list of finite numbers")
    return None if path == tuple(content["n_ff"]) else path


def _check(path: str, number: float, kind: type) -> None:
    """Raises ValueError if a number (SI) is out of the range that the dataclass's field of that name declares."""
    declared = next(declaration(field) for field in fields(kind) if field.name == path.rpartition(".")[2])
    assert declared is not None
    try:
        check(number, declared)
    except QuantityError as error:
        raise ValueError(f"{path}: {error}") from error


def _effects_to_json(effects: tuple[Effect, ...]) -> dict[str, dict[str, Any]]:
    """Each effect's parameters by name, as results.json has them in `machine.effects`."""
    return {name: _effect_to_json(effect) for name, effect in catalogue.named(effects).items()}


def _effect_to_json(effect: Effect) -> dict[str, Any]:
    """Its parameters, or the table of a measured one, with the units in the names."""
    if not effect.tabulated:
        return {json_name(item.name, item.unit): getattr(effect, item.name) for item in parameters(type(effect))}
    units = {field.name: declared.unit for field in fields(effect) if (declared := declaration(field, effect))}
    return {json_name(name, unit): getattr(effect, name) for name, unit in units.items()}


def _effects_from_json(content: Mapping[str, Mapping[str, Any]]) -> tuple[Effect, ...]:
    known, found = catalogue.readable(), list[Effect]()
    for path, values in content.items():
        name = path.partition(".")[0]
        if name not in known:
            raise ValueError(f"effect_compensation.effects: no effect is named {name!r}")
        if known[name].tabulated:
            found.append(_table_from_json(known[name], values, f"effect_compensation.effects.{path}"))
            continue
        numbers = {item.name: float(values[json_name(item.name, item.unit)]) for item in parameters(known[name])}
        if not all(math.isfinite(number) for number in numbers.values()):
            raise ValueError(f"effect_compensation.effects.{path}: a number is not finite")
        found.append(known[name](**numbers))
    return catalogue.in_order(found)


def _table_from_json(kind: type[Effect], content: Mapping[str, Any], where: str) -> Effect:
    """A measured effect; every number in the range that the class declares [SI]."""
    given: dict[str, Any] = {}
    for field in fields(kind):
        declared = declaration(field, content)
        assert declared is not None
        item = content[json_name(field.name, declared.unit)]
        numbers = item if isinstance(item, list) else [] if isinstance(item, str) else [item]
        for number in numbers:
            _check(f"{where}.{field.name}", float(number), kind)
        given[field.name] = tuple(map(float, item)) if isinstance(item, list) else item
    try:
        return kind(**given)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def compensator_path(controller: Controller, target: ArrayLike) -> Array:
    """The path (n,) [m] that the RFM's elements are led along over the target r (n,) [m], from rest at 0."""
    r = np.asarray(target, float)
    return np.convolve(controller.n_ff if controller.path_ff is None else controller.path_ff, r)[: r.size]


@dataclass(frozen=True)
class References:
    """What the controller knows before the motion, each of shape (n,): x_T* [m], u_ff [N], u_rf [N]."""

    position: Array
    feedforward: Array
    compensation: Array


def references(controller: Controller, target: ArrayLike) -> References:
    """x_T*, u_ff and u_rf over the target r (n,) [m], from rest at r = 0 before its first sample.

    The RFM follows its path from the virgin state, and keeps its history over the whole of r. u_rf holds what the
    effects ask for beside it.
    """
    r = np.asarray(target, float)
    position = np.convolve(controller.n_ff, r)[: r.size]
    feedforward = np.convolve(controller.d_ff, r)[: r.size]
    compensation = np.zeros(r.size)
    rfm, ahead = controller.friction_compensation, controller.effect_compensation
    if rfm is not None:
        force, _ = follow(rfm, np.append(0.0, compensator_path(controller, r)))
        compensation = force[1:]
    if ahead is not None:
        compensation = compensation + effect_thrust(
            ahead, rfm, position, feedforward + compensation, controller.sample_time
        )
    return References(position, feedforward, compensation)
