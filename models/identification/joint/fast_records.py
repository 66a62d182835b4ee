"""Fast records: inverse dynamics gives mass, delay, friction, and what depends on direction and speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from models.identification.estimate import LOOSE, Estimate, combined
from models.identification.force import by_elements
from models.identification.force.fit import ForceFit
from models.identification.force.signals import Terms, fast_band, reversals
from models.identification.force.stated import along_the_path
from models.identification.into_machine import (
    Found,
    Holdable,
    holdable,
    lag_of,
    with_drag,
    with_friction,
    with_inertia,
    with_offset,
)
from models.identification.joint.agreement import (
    CAUSES,
    SIGMAS,
    joint_estimate,
    joint_force,
    on_agreement,
    on_slip,
    steps_of,
    together,
    vagueness,
)
from models.identification.joint.slow_records import on_damping, on_effects
from models.identification.joint.steps import ForceStep, Identified, Settings, Step, record_of, with_step
from models.identification.modes import DRAG
from models.quantity import show
from models.records.files import Loaded
from models.records.record import Record

BY_DIRECTION: Final = Terms(viscous=True, by_direction=True)
# What is said where slip forces disagree.
KEPT_ELEMENTS_REASON: Final = "the elements of the record that knows it best, not a mean of both"
DYNAMICS: Final = replace(BY_DIRECTION, delay=True, damped=True)  # what is identified of a fast record


def from_dynamics(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:
    """Inverse dynamics of a fast record, fitted to its first half; what no other record gave goes into the machine.

    Of several fast records mass, delay, drag, asymmetry and offset are the means by their deviations, and the elements
    those of the record that knows the slip force best. The drag is also the mean with a frequency response's, if a slow
    record gave the elements, and the offset with that of slow records and motions. Friction that grows with speed and
    the offset go together: where fast records show different forms of it, both are that record's.
    """
    record = record_of(loaded)
    if reversals(record.position).size == 0:
        excited = (
            "name its kind excitation" if np.any(record.feedforward) else "map its column, --column feedforward=..."
        )
        raise ValueError(
            "never turns round: in one direction friction is no other than an offset; record strokes there and back, "
            f"or {excited} if a sweep or a multisine acts while it rolls"
        )
    band = settings.pass_band or fast_band(record, found.machine.plant.lowest_mode)
    likely = found.machine.plant.dead_time + lag_of(found.machine) + 0.5 * record.sample_time
    longest, effects = max(found.machine.friction.limit), along_the_path(found.machine)
    terms = replace(DYNAMICS, effects=effects, likely_delay=likely, likely_limit=longest)
    fit = by_elements.identify(record, terms, pass_band=band, fit_until=half_of(record))
    if not fit.estimate.deviation("mass") < LOOSE * abs(fit.estimate.value("mass")):
        raise ValueError(
            f"does not excite the axis: its mass, {fit.estimate.value('mass'):.3g} kg, has a standard deviation of "
            f"{fit.estimate.deviation('mass'):.2g} kg; record faster strokes, or name its kind hysteresis"
        )
    steps = [*steps_of(found, "dynamics"), Step(kind, loaded, ForceStep(fit, holdable(fit)))]
    fits = [step.gave.fit for step in steps if isinstance(step.gave, ForceStep)]
    used, best = steps, min(range(len(fits)), key=lambda i: vagueness(fits[i]))
    source = Found(together(steps), "dynamics")
    machine, remarks = found.machine, [*on_agreement(steps, ("mass", "delay")), *on_slip(steps, KEPT_ELEMENTS_REASON)]
    if found.has("response"):
        remarks += _on_plant(found, fit)
    else:
        inertia = joint_estimate([one.estimate for one in fits], ("mass", "delay"))
        machine = with_inertia(machine, inertia, source)
        remarks += _on_delay(inertia, machine.sample_time)
    if not found.has("hysteresis"):
        machine = with_friction(machine, fits[best], Found(steps[best].loaded, "dynamics"))
    helds = [step.gave.held for step in steps if isinstance(step.gave, ForceStep) and step.gave.held is not None]
    held, joint = joint_force(helds, best)
    if not joint:
        used, source = [steps[best]], Found(steps[best].loaded, "dynamics")
    if found.has("hysteresis") or held.drag is None:  # else these records' elements go with their own drag
        drag, by_response = _with_the_response(found, held.drag)
        remarks += by_response
    else:
        drag = held.drag
    if drag is not None or held.asymmetry is not None:
        machine = with_drag(machine, drag, held.asymmetry, _source_of(drag, held.drag, found, source))
    offset, by_others = _with_the_records_before(found, held.offset)
    remarks += by_others
    machine = with_offset(machine, *offset, Found(together([*_telling_offset(found), *used]), "dynamics"))
    step = ForceStep(fit, holdable(fit))
    return with_step(
        found,
        machine,
        kind,
        loaded,
        step,
        (_on_offset(helds[-1]), on_damping(fit), *remarks, *on_effects(found.machine)),
    )


def _on_plant(found: Identified, fit: ForceFit) -> Iterator[str]:
    """Where a fast record disagrees with the frequency response, whose values the machine file has."""
    (gain, gain_std), (dead, dead_std) = (found.earlier(name)[-1] for name in ("rigid body gain", "dead time"))
    late = dead + lag_of(found.machine) + 0.5 * found.machine.sample_time
    for name, unit, known in (("mass", "kg", (1 / gain, gain_std / gain**2)), ("delay", "s", (late, dead_std))):
        here = fit.estimate.value(name), fit.estimate.deviation(name)
        apart = combined([known, here])[2]
        if apart > SIGMAS:
            yield (
                f"This record's {name}, {show(here[0], unit)}, differs from the frequency response's, "
                f"{show(known[0], unit)}, by {apart:.1f} standard deviations ({CAUSES[name]}); the machine file has "
                "the latter."
            )


def _source_of(
    drag: tuple[float, float] | None, held: tuple[float, float] | None, found: Identified, dynamics: Found
) -> Found:
    """Where the viscous friction is from: the fast records, or the frequency response that it was kept of."""
    response = [step for step in found.steps if step.result == "response"]
    if drag is None or held is not None or not response:
        return dynamics
    return Found(response[-1].loaded, "response")


def _with_the_response(
    found: Identified, held: tuple[float, float] | None
) -> tuple[tuple[float, float] | None, list[str]]:
    """The viscous friction [N s/m] of fast records (None: they show none) and of a frequency response together, with
    its standard deviation, and that the two disagree. The elements' own friction goes with the drag of strokes; a
    response that was measured while the axis rolled shows it by itself."""
    response = found.last("response")
    if response is None or DRAG not in response.estimate.names:
        return held, []
    known = response.estimate.value(DRAG), response.estimate.deviation(DRAG)
    if held is None:
        return known, []
    return _both(
        ("viscous friction", "N s/m"),
        (held, "the fast records"),
        (known, "the frequency response"),
        "friction that is not in proportion to the speed, or elements that make up for a drag",
    )


def _with_the_records_before(found: Identified, held: tuple[float, float]) -> tuple[tuple[float, float], list[str]]:
    """The offset [N] of fast records and of slow ones and motions together, with its standard deviation, and that they
    disagree: strokes that hardly leave presliding may tell it to several newtons."""
    before = [step.gave.estimate for step in _telling_offset(found)]
    if not before:
        return held, []
    known = joint_estimate(before, ("offset",))
    return _both(
        ("offset", "N"),
        (held, "the fast records"),
        ((known.value("offset"), known.deviation("offset")), "the records before them"),
        CAUSES["offset"],
    )


def _telling_offset(found: Identified) -> list[Step]:
    """The slow records and motions so far."""
    return [*steps_of(found, "hysteresis"), *steps_of(found, "motion")]


def _both(
    of: tuple[str, str], here: tuple[tuple[float, float], str], there: tuple[tuple[float, float], str], cause: str
) -> tuple[tuple[float, float], list[str]]:
    """One value, with its standard deviation, of two that are found in different ways, and that they disagree. of: its
    name and unit; here, there: value and deviation [that unit], and of which records; cause: of a disagreement."""
    (name, unit), ((one, whose), (other, whose_other)) = of, (here, there)
    value, std, apart = combined([other, one])
    if apart <= SIGMAS:
        return (value, std), []
    said, said_other = (f"{show(size, unit, 3)} ± {show(spread, unit, 2)}" for size, spread in (one, other))
    return (value, std), [
        f"The {name} of {whose}, {said}, and that of {whose_other}, {said_other}, differ by {apart:.1f} standard "
        f"deviations ({cause}); the machine file has their mean, with a deviation as wide."
    ]


def _on_delay(inertia: Estimate, sample_time: float) -> Iterator[str]:
    """The delay with the hold, and that a dead time below none was clipped."""
    delay, std = inertia.value("delay"), inertia.deviation("delay")
    yield (
        f"From a command to the middle of its action it takes {1e3 * delay:.3g} ms with a standard deviation of "
        f"{1e3 * std:.2g} ms, half a sample of hold included."
    )
    if delay < 0.5 * sample_time:
        yield (
            f"The fitted dead time was negative ({show(delay - 0.5 * sample_time, 's')}) and was set to 0: the "
            "position is logged before its command, or friction bends the force where it is fast."
        )


def half_of(record: Record) -> float:
    """The time [s] up to which a fast record is fitted; the rest of it judges."""
    return 0.5 * record.position.size * record.sample_time


def _on_offset(held: Holdable) -> str:
    """What a fast record says of a constant force."""
    value, std = show(held.offset[0], "N", 3), show(held.offset[1], "N", 2)
    if held.asymmetry is None:
        return f"A constant force of {value} is held beside friction, with a standard deviation of {std}."
    share, way = 100 * abs(held.asymmetry[0]), "larger" if held.asymmetry[0] > 0 else "smaller"
    return (
        f"The machine file has friction by direction as a share of the force, {share:.2g} % {way} forwards than the "
        f"mean, and beside it an offset of {value} with a standard deviation of {std}; the offset above is "
        "what goes with viscous friction of its own for each direction."
    )
