"""Slow records: they give the friction's elements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from models.identification.estimate import STRONG
from models.identification.force import by_elements
from models.identification.force.fit import SIGNIFICANT_STDS, SPRING, ForceFit
from models.identification.force.signals import Terms, slow_band
from models.identification.force.stated import along_the_path, left_out
from models.identification.into_machine import (
    Found,
    drag_of,
    lag_of,
    spring_of,
    with_drag,
    with_friction,
    with_offset,
    with_spring,
)
from models.identification.joint.agreement import joint_estimate, on_agreement, on_slip, steps_of, together
from models.identification.joint.longer_ways import Stiffness, surest, way
from models.identification.joint.one_branch import one_branch
from models.identification.joint.steps import (
    ForceStep,
    Identified,
    Settings,
    Step,
    record_of,
    with_step,
)
from models.identification.modal.remarks import ResponseStep
from models.identification.modes import DRAG
from models.identification.unusable import UnusableError
from models.machine import Machine
from models.quantity import listed, show
from models.records.files import Loaded
from models.records.record import Record

AGAINST: Final = 10.0  # times the reduced chi-square of a response, from which on it contradicts what slow loops add
# Times the way in which friction turns round, that loops go on in which a spring is told from it.
MIN_LOOP_WIDTH_RATIO: Final = 2.0


def from_hysteresis(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:
    """The friction elements from a slow record, or from all of them together; mass and dead time as known so far."""
    plant, ts = found.machine.plant, found.machine.sample_time
    dead_time = [std for _, std in found.earlier("dead time")]
    source = Found(loaded, "hysteresis")
    terms = Terms(
        mass=plant.mass,
        drag=drag_of(found.machine),
        effects=along_the_path(found.machine),
        known_delay=plant.dead_time + lag_of(found.machine) + 0.5 * ts,
        known_delay_std=max(dead_time, default=0.0),
        damped=bool(dead_time),
        likely_limit=max(found.machine.friction.limit),
    )
    record = record_of(loaded)
    band = settings.pass_band or slow_band(record)
    fit = by_elements.identify(record, terms, pass_band=band)
    found, terms, fit, on_spring = _with_spring(found, loaded, terms, fit)
    _require_a_loop(fit, spring_of(found.machine))
    fit, dragged, not_dragged = _with_drag(found, record, terms, fit, source)
    slip, spread = fit.slip_force()
    steps = [*steps_of(found, "hysteresis"), Step(kind, loaded, ForceStep(fit))]
    fits = [step.gave.fit for step in steps if isinstance(step.gave, ForceStep)]
    remarks = (
        f"At full slip the friction is {show(slip, 'N')} with a standard deviation of {show(spread, 'N', 2)}.",
        on_damping(fit),
        *([] if not_dragged else [_on_the_drag(terms, fit, dragged)]),
        *on_agreement(steps, ("offset",)),
        *on_slip(steps, "one branch fitted to all, with deviations as wide"),
        *on_spring,
        *not_dragged,
        *_on_memory(fit),
        *on_effects(found.machine),
    )
    e = fit.estimate
    offset = joint_estimate([one.estimate for one in fits], ("offset",))
    of_all = Found(together(steps), "hysteresis")
    machine = with_friction(found.machine, one_branch(fits), of_all)
    machine = with_offset(machine, offset.value("offset"), offset.deviation("offset"), of_all)
    if SPRING in e.names:
        machine = with_spring(machine, (e.value(SPRING), e.deviation(SPRING)), source)
    if fit is dragged:
        machine = with_drag(machine, (e.value(DRAG), e.deviation(DRAG)), None, source)
    return with_step(found, machine, kind, loaded, ForceStep(fit), remarks)


def _require_a_loop(fit: ForceFit, stated: float) -> None:
    """Raises an UnusableError where nothing slips: what gives all of its force back is a spring, and no friction;
    stated: the spring to ground that the machine file has [N/m]."""
    if not (fit.short and len(fit.friction.limit) == 1):
        return
    if stated > 0:
        raise UnusableError("the force comes back the same way beside the stated spring, so that no friction is seen")
    spring = show(fit.friction.stiffness[0], "N/m", 4)
    raise UnusableError(
        f"the force goes with the position and comes back the same way, without a loop: a spring of {spring} holds the "
        f'axis, and no friction is seen; state it, [effects.cable_spring] with stiffness = "{spring}", or record wider '
        "loops"
    )


def _with_spring(
    found: Identified, loaded: Loaded, terms: Terms, fit: ForceFit
) -> tuple[Identified, Terms, ForceFit, tuple[str, ...]]:
    """What is known, the terms and the fit of a record with a spring to ground, where it shows one; and what is said of
    it. A record of a longer way that knows it better gives its stiffness instead, or says that there is none."""
    if spring_of(found.machine) != 0 or not _may_be_a_spring(fit):
        return found, terms, fit, ()
    record, with_it = record_of(loaded), replace(terms, spring=True)
    try:
        sprung = by_elements.identify(record, with_it, pass_band=fit.pass_band)
    except UnusableError:  # beside a spring there is no friction left
        return found, terms, fit, ()
    if not _springs(fit, sprung):
        return found, terms, fit, ()
    here = Stiffness(sprung.estimate.value(SPRING), sprung.estimate.deviation(SPRING), loaded)
    against = _against(found, with_spring(found.machine, (here.value, here.std), Found(loaded, "hysteresis")))
    if against is not None:
        spring = f"a spring to ground of {show(here.value, 'N/m', 3)}, where the friction's curve goes on"
        return found, terms, fit, (_not_taken(spring, against),)
    return _by_longer_ways(found, here, (terms, fit), (with_it, sprung))


def _by_longer_ways(
    found: Identified, here: Stiffness, plain: tuple[Terms, ForceFit], sprung: tuple[Terms, ForceFit]
) -> tuple[Identified, Terms, ForceFit, tuple[str, ...]]:
    """As `_with_spring`, of a record that shows a spring; plain, sprung: its terms and fits without and with one."""
    terms, fit = plain
    known = terms if found.has("response") else replace(terms, mass=None)
    there = surest(found.records, way(here.loaded), known, fit.friction, found.machine.plant.lowest_mode)
    if there is None or there.std >= here.std:
        return found, *sprung, (_on_spring(here),)
    if there.value <= SIGNIFICANT_STDS * there.std:
        return found, terms, fit, (_on_springs(here, there, "it is not taken, as", "shows"),)
    machine = with_spring(found.machine, (there.value, there.std), Found(there.loaded, "dynamics"))
    found, terms = replace(found, machine=machine), replace(terms, effects=along_the_path(machine))
    fit = by_elements.identify(record_of(here.loaded), terms, pass_band=fit.pass_band)
    return found, terms, fit, (_on_springs(here, there, "the machine file has what", "shows:"),)


def _with_drag(
    found: Identified, record: Record, terms: Terms, fit: ForceFit, source: Found
) -> tuple[ForceFit, ForceFit | None, tuple[str, ...]]:
    """The fit of a record with viscous friction, where it shows some; what was tried for it, None where a response gave
    it; and why one is not taken."""
    if _shown_by_a_response(found):
        return fit, None, ()
    dragged = by_elements.identify(record, replace(terms, viscous=True, drag=0.0), pass_band=fit.pass_band)
    if not _drags(fit, dragged):
        return fit, dragged, ()
    value, std = dragged.estimate.value(DRAG), dragged.estimate.deviation(DRAG)
    against = _against(found, with_drag(found.machine, (value, std), None, source))
    if against is None:
        return dragged, dragged, ()
    return fit, dragged, (_not_taken(f"viscous friction of {value:.3g} N s/m", against),)


def _shown_by_a_response(found: Identified) -> bool:
    """Whether a frequency response gave the viscous friction, which it shows far better than a slow record."""
    response = found.last("response")
    return response is not None and DRAG in response.estimate.names


def _may_be_a_spring(plain: ForceFit) -> bool:
    """Whether the longest element keeps still over most of the path, so that a spring to ground may be what it is."""
    return not _wide_beside(plain)


def _wide_beside(fit: ForceFit) -> bool:
    """Whether the path goes on for MIN_LOOP_WIDTH_RATIO times the way in which the friction turns round."""
    return float(np.ptp(fit.path)) >= MIN_LOOP_WIDTH_RATIO * 2 * max(fit.friction.limit)


def _springs(plain: ForceFit, sprung: ForceFit) -> bool:
    """Whether a slow record shows a spring to ground rather than a longer element of friction.

    Over one width of loops, an element that never slips is a spring. So the spring has to be sure, to explain the
    record as well with an element less, or surely better, and to go on over loops that are MIN_LOOP_WIDTH_RATIO times
    as wide as those in which the last element slips: friction that would go on beyond them has elements between.
    """
    value, std = sprung.estimate.value(SPRING), sprung.estimate.deviation(SPRING)
    counts = [len(fit.friction.limit) for fit in (plain, sprung)]
    fallen = plain.criterion[counts[0]] - sprung.criterion[counts[1]]
    better = fallen > (0.0 if counts[1] < counts[0] else STRONG)
    return value > SIGNIFICANT_STDS * std and better and _wide_beside(sprung)


def _against(found: Identified, machine: Machine) -> str | None:
    """The record of a rolling axis whose response is far worse explained by this machine than by what was found so far:
    the tail of a smooth friction curve, or its form, looks like a spring or a drag in slow loops."""
    for step in found.steps:
        if isinstance(step.gave, ResponseStep) and step.gave.measured.rolling:
            least = AGAINST * max(found.misfit(step.gave), 1.0)
            if replace(found, machine=machine).misfit(step.gave) > least:
                return step.loaded.name
    return None


def _not_taken(what: str, against: str) -> str:
    return (
        f"The record alone would show {what}; it is not taken, as the response of {against}, in which the axis rolls, "
        "does not have it."
    )


def _drags(plain: ForceFit, dragged: ForceFit) -> bool:
    """Whether a slow record shows viscous friction: BIC falls by ten, and it is surely above none."""
    fallen = plain.criterion[len(plain.friction.limit)] - dragged.criterion[len(dragged.friction.limit)]
    return fallen > STRONG and dragged.estimate.value(DRAG) > SIGNIFICANT_STDS * dragged.estimate.deviation(DRAG)


def _on_the_drag(terms: Terms, fit: ForceFit, dragged: ForceFit | None) -> str:
    """What is said of viscous friction."""
    return _on_drag(dragged, taken=fit is dragged) if dragged and not terms.drag else _off_drag(terms.drag)


def _off_drag(known: float) -> str:
    """What is said of viscous friction [N s/m] that an earlier record gave, or the machine file states."""
    return f"The viscous friction of {known:.3g} N s/m, which was known before, was taken off and stays."


def _on_drag(dragged: ForceFit, *, taken: bool) -> str:
    """What a slow record says of viscous friction."""
    value, std = (f(DRAG) for f in (dragged.estimate.value, dragged.estimate.deviation))
    if taken:
        return f"Viscous friction is {value:.3g} N s/m with a standard deviation of {std:.2g} N s/m."
    return (
        f"The record does not show viscous friction: by {SIGNIFICANT_STDS:g} standard deviations it is at most "
        f"{max(value, 0.0) + SIGNIFICANT_STDS * std:.2g} N s/m; a fast record shows it."
    )


def on_damping(fit: ForceFit) -> str:
    """What the record says of the elements' damping D_i."""
    if fit.lag is None:
        return (
            "Damping of the elements was not sought: in a slow record it looks like dead time, which no record gave; "
            "add a frequency response."
        )
    time, std = (1e3 * number for number in fit.lag)
    if fit.damped:
        return f"The elements are damped: D = {time:.3g} ms times K, with a standard deviation of {std:.2g} ms."
    speed = float(np.max(np.abs(np.gradient(fit.path, fit.time))))
    most = 1e3 * fit.longest_lag
    if fit.longest_lag * speed > max(fit.friction.limit):
        return "The record neither shows nor bounds damping of the elements: the axis crosses their range too quickly."
    return (
        f"The record does not show damping of the elements: it is too slow, {1e3 * speed:.2g} mm/s at most, to tell "
        f"{f'{time:.2g} ms times K' if time > 0 else 'any'} from none; by {SIGNIFICANT_STDS:g} standard deviations D "
        f"is at most {most:.2g} ms times K, which leads the deflection by {most * speed * 1e3:.2g} µm there."
    )


def _on_spring(spring: Stiffness) -> str:
    """What is said of a spring to ground that no record of a longer way knows better."""
    return (
        f"A force of {spring.said()}, all that the loops go, is in proportion to the position, as that of a spring to "
        "ground is and friction is not; it is entered as the effect cable_spring in the machine file, not as a "
        "friction element. No record of a longer way tells it better: beyond these loops it is not known."
    )


def _on_springs(here: Stiffness, there: Stiffness, so: str, shows: str) -> str:
    """What is said of a spring that a record of a longer way knows better."""
    return (
        f"The record alone would show a spring to ground of {here.said()}; {so} {there.loaded.name}, in which the axis "
        f"goes further, {shows} {there.said()}."
    )


def on_effects(machine: Machine) -> Iterator[str]:
    """Which effects of the machine file a fit of the force takes into account, and which it cannot."""
    taken = [one.name for one in along_the_path(machine)]
    if taken:
        yield f"What {listed(taken)} of the machine file makes of the force was taken off before friction was fitted."
    names = left_out(machine)
    if names:
        yield (
            f"What {listed(names)} of the machine file makes of friction or of the scale was not taken off: the "
            "elements identified hold it, too."
        )


def _on_memory(fit: ForceFit) -> Iterator[str]:
    """What elements may carry from before a slow record."""
    if fit.short:
        span = float(np.ptp(fit.path))
        yield (
            f"The path, {show(span, 'm')} from end to end, is too short for the longest element: the friction may go "
            "on rising beyond it, or a spring to ground pulls, which looks the same there; record slow loops twice as "
            "wide, or state the spring ([effects.cable_spring])."
        )
    if fit.least > 0:
        yield (
            f"The shortest element ends where the search did, at {show(fit.least, 'm', 2)}: the friction may slip "
            "earlier still, which takes a finer scale to see, or shorter presliding limits in the machine file."
        )
    if fit.remembered > 0:
        yield (
            f"Friction may carry up to {show(fit.remembered, 'N', 2)} from before the record, on the mean over its "
            "samples, as part of the offset; the offset's standard deviation covers it."
        )
