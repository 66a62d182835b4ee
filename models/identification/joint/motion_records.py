"""Motions: they judge what the other records gave, and give what is missing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification import motion
from models.identification.estimate import LOOSE, Estimate
from models.identification.force.fit import SIGNIFICANT_STDS
from models.identification.into_machine import (
    Found,
    with_damping_of_motion,
    with_offset,
    with_scaled_friction,
    with_scaled_plant,
)
from models.identification.joint.agreement import SIGMAS
from models.identification.joint.steps import Difference, Identified, MotionStep, Settings, record_of, with_step
from models.identification.unusable import UnusableError
from models.quantity import show
from models.records.checks import is_at_rate, replay
from models.records.files import Loaded
from models.records.record import Record

Array = NDArray[np.float64]

NOT_ITS_OWN: Final = 0.5  # share of the command's changes that the stated feedback leaves, where another one ran


def from_motion(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:  # noqa: ARG001
    """Prediction-error fit with the controller replayed; what no other record gave goes into the machine."""
    record = record_of(loaded)
    if not is_at_rate(record, found.machine.sample_time):
        every = found.machine.sample_time / record.sample_time
        advice = "log all of its samples" if every < 1 else f"take one row of {every:.4g}"
        raise UnusableError(
            f"has a sample every {show(record.sample_time, 's')}, where the controller, which is replayed on motions, "
            f"runs every {show(found.machine.sample_time, 's')}; {advice}"
        )
    try:
        fit = motion.identify(record, found.machine, friction_covariance=_shape(found))
    except UnusableError as error:
        raise UnusableError(f"{error}; {_advice(found, record)}") from error
    differences = tuple(_differences(found, fit.estimate))
    remarks = [
        f"The motion record shows a {one.name} that differs by {100 * one.size:+.2g} % from the other record, "
        f"{abs(one.size / one.std):.1f} standard deviations: noise does not explain it, the model's form may."
        for one in differences
        if abs(one.size) > SIGMAS * one.std
    ]
    machine, source, e = found.machine, Found(loaded, "motion"), fit.estimate
    before = [step.gave.estimate for step in found.steps if isinstance(step.gave, MotionStep)]
    if not found.has("response", "dynamics") and _surest(e, before, "mass"):
        machine = with_scaled_plant(machine, fit, source)
    if not found.has("hysteresis", "dynamics"):
        if all(e.deviation("offset") < one.deviation("offset") for one in before):
            machine = with_offset(machine, e.value("offset"), e.deviation("offset"), source)
        if _surest(e, before, "friction level", "presliding length"):
            machine = with_scaled_friction(machine, fit, source)
    known = found.slow.lag if found.slow else None
    if known is None or fit.lag[1] <= known[1]:  # else the slow record knows the damping better
        machine = with_damping_of_motion(machine, fit, source)
    return with_step(found, machine, kind, loaded, MotionStep(fit, differences), [*remarks, *_on_motion(fit)])


def _surest(estimate: Estimate, before: Sequence[Estimate], *names: str) -> bool:
    """Whether a motion record shows factors [1] at all, and no motion record before shows them better. A level of the
    friction that is loose may be a negative one, which no machine file takes."""

    def openness(one: Estimate) -> float:
        return max(one.deviation(name) / max(one.value(name), 1e-300) for name in names)

    return openness(estimate) < min([LOOSE, *map(openness, before)])


def _advice(found: Identified, record: Record) -> str:
    """What to do about motions that no machine close to the known one reproduces: first what replays them, then what is
    known of the machine."""
    changes = np.diff(record.command)
    made = np.diff(replay(record, found.machine.control.feedback, found.machine.control.reference_delay))
    left = float(np.std(changes - made)) / max(float(np.std(changes)), 1e-300)
    if not left < NOT_ITS_OWN:  # nor is it so of nan
        return (
            "the feedback in [control] does not make the logged command of reference and position "
            f"({100 * left:.3g} % of its changes remain); correct it, the reference delay or the columns"
        )
    if found.has("response", "excitation") and found.slow:
        return (
            "check the sign and unit of the command and the payload against those of the other records; where these "
            "are right, the loop with the machine as they gave it may be unstable while its friction sticks, which "
            "deadbeat_design tells"
        )
    return (
        "check the sign and unit of the command, or add a frequency response and slow loops, which need no values near "
        "the true ones"
    )


def _shape(found: Identified) -> Array | None:
    """Covariance (2 N, 2 N) of stiffnesses [N/m] and limits [m], as the last slow record knows them."""
    if found.slow is None:
        return None
    last = slice(-2 * len(found.slow.friction.limit), None)
    return found.slow.estimate.covariance[last, last]


def _differences(found: Identified, estimate: Estimate) -> Iterator[Difference]:
    """How far the motion record departs from what the others said."""
    gains, delays = found.earlier("rigid body gain"), found.earlier("dead time")
    if gains:
        (gain, gain_std), (delay, delay_std), ts = gains[-1], delays[-1], found.machine.sample_time
        spread = math.hypot(estimate.deviation("mass"), gain_std / gain)
        yield Difference("mass", estimate.value("mass") - 1, spread)
        spread = math.hypot(estimate.deviation("dead time"), delay_std) / ts
        yield Difference("dead time", (estimate.value("dead time") - delay) / ts, spread)
    if found.slow:
        slip, slip_std = found.slow.slip_force()
        spread = math.hypot(estimate.deviation("friction level"), slip_std / slip)
        yield Difference("friction level", estimate.value("friction level") - 1, spread)


def _on_motion(fit: motion.MotionFit) -> Iterator[str]:
    """What the motion record says of damping, and of what friction remembered when it began."""
    yield (
        "The deviations from motions hold beside what the fit takes as known: modes and the friction's shape, each off "
        "by the deviation that the machine file states for it, or tolerates."
    )
    time, std = (1e3 * number for number in fit.lag)
    if fit.damped:
        yield f"Motions show damped elements: D = {time:.3g} ms times K, with a standard deviation of {std:.2g} ms."
    else:
        yield (
            f"Motions show no damping of the elements: by {SIGNIFICANT_STDS:g} standard deviations D is at most "
            f"{max(time, 0.0) + SIGNIFICANT_STDS * std:.2g} ms times K."
        )
    count, size = fit.carried
    if count:
        yield (
            f"{count} of the elements {'is' if count == 1 else 'are'} longer than half the motion record's first way: "
            f"a force from before, {show(size, 'N', 2)} at most, may stay in {'it' if count == 1 else 'them'} "
            "throughout and then counts as part of the offset."
        )
