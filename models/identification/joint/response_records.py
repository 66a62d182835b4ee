"""Frequency responses and excitations: they give the plant."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from models.effects.structure import CableSpring
from models.identification import modes, response
from models.identification.estimate import LOOSE
from models.identification.force.fit import SPRING
from models.identification.force.stated import along_the_path
from models.identification.into_machine import Found, spring_of, with_response, with_spring
from models.identification.joint.agreement import SIGMAS, spanned, together
from models.identification.joint.steps import Identified, Settings, Step, with_step
from models.identification.modal.remarks import (
    ResponseStep,
    bent,
    on_disagreement,
    on_left_out,
    on_one_alone,
    on_response,
    refuted,
)
from models.identification.response import FrequencyResponse
from models.identification.unusable import UnusableError
from models.machine import Machine
from models.quantity import listed, show
from models.records.checks import is_at_rate, noise_gain
from models.records.files import Loaded
from models.records.record import Record
from models.simulation.effect_kernel import touched

NO_SPRING: Final = (
    "No spring to ground is entered in the machine file: {why}. Cogging and the weight of what turns look like a "
    "spring where a sweep is; motions over the whole travel tell what pulls (gap_diagnosis)."
)
LEAST_SPREAD: Final = 0.3  # of the stiffest, by which springs differ that are none of the axis but of the place
FALLS: Final = (-2.5, -1.5)  # of a response over the frequency, both as logarithms: that of a mass is -2
ALONG: Final = 0.9  # cosine of the phase from which on a position is along with its command, and no mass' answer to it
AS_BENT: Final = 2.0  # times the least share of samples in which an axis moved backwards: it bends hardly more

# Reduced chi-square from which on friction may bend what the file says it does not.
MAX_FRICTIONLESS_CHI_SQUARE: Final = 3.0
MIN_FRICTION_SHARE: Final = 0.01  # of the command's deviation: less friction than that bends no line
MIN_UNLOGGED_SHARE: Final = 0.02  # of the command's deviation, from which on what a log lacks of it may move the plant
# Times the controller's sample time: a log further apart has not all of its samples.
MAX_SAMPLE_TIME_RATIO: Final = 1.01


def from_response(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:
    """P_l from a measured frequency response, or from an excitation; from all of them together if there are several."""
    content = loaded.content
    smooth = isinstance(content, Record) and _hardly_rubs(found.machine, content)
    if isinstance(content, Record):
        measured = _measured(found.machine, content, sprung=smooth and spring_of(found.machine) > 0)
        level = float(np.std(content.feedforward))
    else:
        measured, level = replace(content, rolling=content.rolling or settings.rolled), None
    _check_sign(measured)
    measured, fit, smooth = _fitted(found, measured, settings, smooth=smooth)
    spring = _spring(found, smooth=smooth)
    _check_excited(fit, measured)
    step = ResponseStep(measured, fit, level=level)
    earlier = [one for one in found.steps if isinstance(one.gave, ResponseStep)]
    remarks, source, best = [*on_response(fit, measured)], Found(loaded, "response"), fit
    apart: tuple[float, ...] = ()
    if isinstance(content, Record):
        remarks += on_what_is_between(found.machine, content)
    if earlier:
        every = [*earlier, Step(kind, loaded, step)]
        used = _not_refuted([one for one in every if not bent(_gave(one).measured)] or _least_bent(every))
        fits = [_gave(one) for one in used]
        if apart := _springs_apart(fits):
            fits = [_without_spring(found.machine, one, settings) for one in used]
            spring = modes.Spring(0.0, sought=False)
        joint, names = _together(fits, settings, spring), [one.loaded.name for one in used]
        best = spanned(joint, fits)
        step = replace(step, together=best)
        remarks += [*on_disagreement(names, fits), *on_one_alone(names, fits, joint.estimate)]
        remarks += on_left_out([(one.loaded.name, _gave(one)) for one in every if one not in used])
        source = Found(together(used), "response")
    known = found.machine if not _showed_spring(found) else with_spring(found.machine, None, source)
    local = _on_local_spring(known, best, apart)
    machine = with_response(known, best, source, sprung=not local)
    if apart and not local:
        machine = with_spring(machine, (float(np.mean(apart)), float(np.ptp(apart)) / 2), source)
    return with_step(found, machine, kind, loaded, step, [*remarks, *local])


def _measured(machine: Machine, record: Record, *, sprung: bool = False) -> FrequencyResponse:
    """The response that an excitation shows, whose commands are held for the controller's sample time."""
    measured, held = response.measured(record, sprung=sprung), machine.sample_time
    return replace(measured, hold=held) if record.sample_time > MAX_SAMPLE_TIME_RATIO * held else measured


def _springs_apart(fits: Sequence[ResponseStep]) -> tuple[float, ...]:
    """The springs to ground that responses show [N/m], where they surely differ; else nothing."""
    shown = [(one.fit.spring, one.estimate.deviation(SPRING)) for one in fits if SPRING in one.estimate.names]
    shown += [(0.0, 0.0) for one in fits if one.fit.spring == 0 and one.measured.rolling]  # others look for none
    differ = any(abs(a - b) > SIGMAS * math.hypot(s, t) for (a, s), (b, t) in itertools.combinations(shown, 2))
    return tuple(value for value, _ in shown) if differ else ()


def _without_spring(machine: Machine, step: Step, settings: Settings) -> ResponseStep:
    """What a record gives whose commands are less by what the spring that it shows takes of them."""
    gave, record = _gave(step), step.loaded.content
    if gave.fit.spring == 0 or not isinstance(record, Record):
        return gave
    t = record.sample_time * np.arange(record.position.size)
    pulls = gave.fit.spring * np.interp(t + gave.fit.plant.dead_time + gave.fit.lag, t, record.position)
    measured = _measured(machine, replace(record, command=record.command - pulls))
    fit = modes.fit(measured, count=settings.modes, spring=modes.Spring(0.0, sought=False))
    return replace(gave, measured=measured, fit=fit)


def _on_local_spring(machine: Machine, fit: modes.Fit, apart: Sequence[float]) -> list[str]:
    """Why what pulls at the axis in proportion to the way, in the plant of all responses, or in each of those that are
    far apart [N/m], is none of the springs to ground in the machine file; nothing where it may be one."""
    if apart and np.ptp(apart) > LEAST_SPREAD * max(apart):
        return [NO_SPRING.format(why=f"the responses show {listed([show(one, 'N/m', 3) for one in apart])}")]
    if not apart and SPRING not in fit.estimate.names:
        return []
    pulling = [one for one in along_the_path(machine) if "force" in touched(one) and one.spring_to_ground() == 0]
    if not pulling:
        return []
    named = listed(sorted({one.name.replace("_", " ") for one in pulling}))
    return [NO_SPRING.format(why=f"it has {named}, which may pull so within a sweep's travel")]


def on_what_is_between(machine: Machine, record: Record) -> list[str]:
    """That a log without all samples lacks much of the command: what the scale's noise makes of it changes each time
    that the controller runs, and the response takes it for what is held."""
    every = round(record.sample_time / machine.sample_time)
    noise = noise_gain(machine.control.feedback, machine.sample_time) * machine.scale.noisy().reading_deviation
    spread, fed_back = float(np.std(record.command)), float(np.std(record.command - record.feedforward))
    # Without a feedback, nothing of it is fed back either.
    if is_at_rate(record, machine.sample_time) or min(noise, fed_back) < MIN_UNLOGGED_SHARE * spread:
        return []
    return [
        f"has one of {every} samples of the controller, and the scale's noise makes {show(noise, 'N', 2)} (rms) of the "
        "command between two logged samples: dead time, lag and gains may be off by many of the deviations stated "
        "here; log all samples, for a shorter time"
    ]


def _fitted(
    found: Identified, measured: FrequencyResponse, settings: Settings, *, smooth: bool
) -> tuple[FrequencyResponse, modes.Fit, bool]:
    """The response and its fit, as of an axis whose friction bends no line where the file says so and the lines do not
    say otherwise; and whether it is one."""
    as_it_is = partial(modes.fit, count=settings.modes, spring=_spring(found, smooth=False))
    if not smooth:
        return measured, as_it_is(measured), False
    freed = replace(measured, rolling=True, turned=0.0)
    fit = modes.fit(freed, count=settings.modes, spring=_spring(found, smooth=True))
    if fit.chi_square > MAX_FRICTIONLESS_CHI_SQUARE:
        with suppress(UnusableError):
            if (plain := as_it_is(measured)).chi_square < fit.chi_square:
                return measured, plain, False
    return freed, fit, True


def _least_bent(steps: Sequence[Step]) -> list[Step]:
    """Of responses that are all bent, those of axes that went backwards hardly longer than the one that did least."""
    least = min(_gave(one).measured.turned for one in steps)
    return [one for one in steps if _gave(one).measured.turned <= AS_BENT * least]


def _not_refuted(steps: Sequence[Step]) -> list[Step]:
    """Of several responses those that some plant fits, where there are any: what no rigid body with modes fits, as of
    an axis one side of which turned, would move the plant of the others by far more than their deviations."""
    return [one for one in steps if not refuted(_gave(one))] or list(steps)


def _hardly_rubs(machine: Machine, record: Record) -> bool:
    """Whether the friction that the machine file states bends no line, as on flexures or on air."""
    return machine.friction.coulomb_force < MIN_FRICTION_SHARE * float(np.std(record.command))


def _spring(found: Identified, *, smooth: bool) -> modes.Spring:
    """The spring to ground that the machine file states, which stays as it is, or that an earlier identification wrote
    into it, which a response may correct; as one of a smooth axis does, whose friction cannot pass for a spring."""
    stiffness = spring_of(found.machine)
    if _showed_spring(found):
        return modes.Spring(stiffness if smooth else 0.0)
    source = found.machine.sources.get(f"effects.{CableSpring.name}.stiffness")
    return modes.Spring(stiffness, stiffness == 0 or smooth or (source is not None and source.kind == "identified"))


def _showed_spring(found: Identified) -> bool:
    """Whether the machine's spring is that of an earlier response, so that the fit of all is to find it anew."""
    earlier = found.last("response")
    fit = None if not isinstance(earlier, ResponseStep) else earlier.together or earlier.fit
    return fit is not None and SPRING in fit.estimate.names


def _together(steps: Sequence[ResponseStep], settings: Settings, spring: modes.Spring) -> modes.Fit:
    """One plant from all of these responses."""
    if len(steps) == 1:
        return steps[0].fit
    return modes.fit_together(
        [one.measured for one in steps], [one.fit.used for one in steps], count=settings.modes, spring=spring
    )


def _gave(step: Step) -> ResponseStep:
    assert isinstance(step.gave, ResponseStep)
    return step.gave


def _check_excited(fit: modes.Fit, measured: FrequencyResponse) -> None:
    """Raises ValueError where the response leaves mass [kg] or dead time [s] open: the phase of its highest line by a
    radian."""
    gain, gain_std, late_std = (
        *(fit.estimate.values[0], fit.estimate.deviations[0]),
        fit.estimate.deviation("dead time"),
    )
    top = float(np.max(measured.frequency[fit.used]))
    if gain_std < LOOSE * gain and 2 * np.pi * top * late_std < 1:
        return
    raise ValueError(
        f"does not excite the axis: from {measured.frequency[0]:.3g} to {top:.3g} Hz it leaves the mass uncertain by "
        f"{100 * gain_std / gain:.2g} % and the dead time by {1e3 * late_std:.2g} ms; excite with more force, over two "
        "octaves or more, or name another kind"
    )


def _check_sign(measured: FrequencyResponse) -> None:
    """Raises ValueError for a mass that goes against its command at the lower half of the lines, by octaves. What
    sticks, or a spring holds, goes along with its command, too, but falls less; behind a resonance it falls more."""
    f, answer = measured.frequency, measured.response
    low = f < math.sqrt(f[0] * f[-1])
    if np.count_nonzero(low) < modes.FEWEST_LINES:
        return
    fall = np.polyfit(np.log(f[low]), np.log(np.abs(answer[low])), 1)[0]
    if FALLS[0] < fall < FALLS[1] and np.median(np.cos(np.angle(answer[low]))) > ALONG:
        raise ValueError(
            "moves the axis against its command: the sign of the command looks turned, or that of position and "
            'reference; turn it by "NAME * -1"'
        )
