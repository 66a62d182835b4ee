"""How large a parameter of an effect may be in a machine: its usual range, or the one that the machine's file states.

Usual ranges are counted in what the machine is made of; periods and modes that no file states are looked for further.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from models.effects.parameter import Parameter
from models.effects.priors import REFERENCE, Powers, Range, Units

BY_UNIT: Final[Mapping[str, Powers]] = {
    "N": (("force", 1),),
    "m": (("contact", 1),),
    "s": (("loop", 1),),
    "Hz": (("loop", -1),),
    "1/s": (("loop", -1),),
    "s^2": (("loop", 2),),
    "1/m": (("contact", -1),),
    "1/N": (("force", -1),),
    "m/s": (("contact", 1), ("loop", -1)),
    "N/m": (("force", 1), ("contact", -1)),
    "N s/m": (("force", 1), ("loop", 1), ("contact", -1)),
    "kg": (("mass", 1),),
    "1/kg": (("mass", -1),),
}
"""What sizes of a unit are counted in, where their declaration does not say; those of other units stay as they are."""
# The shortest period that is looked for along the travel has so many in it (a screw of a few turns on a motor of 200
# steps has 500), and the longest one of a scale so many.
MOST_PERIODS, FEWEST_PERIODS = 1200, 15
# Deviations of the reading, in the shortest period that is looked for along the travel: below, where the table is in it
# is hardly known.
MIN_READINGS: Final = 20.0
COARSEST: Final = 128  # steps of the coarsest converter up to the rated thrust: eight bits for both signs
BELOW_CROSSOVER: Final = 0.25  # times the frequency at which the loop crosses over, from which on modes are looked for
MOST_OF_NYQUIST: Final = 0.8  # up to which a frequency is looked for
MOST_SAMPLED: Final = 0.99  # of the same, up to which a mode is in a machine that states its range
STATED_ROOM: Final = 1.5  # times the largest frequency that is stated, up to which a fit may go
DENSEST: Final = 3  # times the points of a grid over the reference's travel, up to which a longer one has a grid


def usual_in(item: Parameter, units: Units) -> Parameter:
    """The parameter with the sizes [SI] that are usual in a machine of these units."""
    if item.role in {"phase", "switch"}:
        return item
    if item.role == "period" and item.periodic_in in {"position", "reading"}:
        return _along(item, units)
    powers = item.counted_in or (BY_UNIT.get(item.unit, ()),)
    if item.unit == "m/s" and item.role == "shape":  # contacts are of one length and the ways of another
        powers = (*powers, (("travel", 1), ("loop", -1)))
    factors = [units.over(REFERENCE, one) for one in powers]
    low, high = item.low * min(factors), item.high * max(factors)
    if len(factors) == 1 and item.unit != "Hz":
        sought = _coarse(item, low, high, units.thrust)
        return replace(item, low=low, high=high, typical=item.typical * factors[0], sought=sought)
    if item.unit == "Hz":
        low, high = _below_nyquist(low, high, units)
    return replace(item, low=low, high=high, typical=math.sqrt(low * high), sought=_rings(item, low, high, units))


def _coarse(item: Parameter, low: float, high: float, thrust: float) -> Range:
    """Where the steps of a converter are looked for, whose usual range is low .. high [N]: up to those of a coarse one,
    however small the friction is beside the rating."""
    return (low, max(high, thrust / COARSEST)) if item.is_step and item.periodic_in == "command" else ()


def _below_nyquist(low: float, high: float, units: Units) -> tuple[float, float]:
    """A range of frequencies [Hz], moved to where a record shows them."""
    most = MOST_OF_NYQUIST / 2 / units.sample
    return min(low, most * low / high), min(high, most)


def _rings(item: Parameter, low: float, high: float, units: Units) -> Range:
    """Where a mode is looked for, whose usual range is low .. high [Hz]: from well below where the loop crosses over,
    where the bed of a heavy axis rocks, up to where the records show it, however slow the loop is."""
    least = BELOW_CROSSOVER / (2 * math.pi * units.loop)
    return (min(low, least), max(high, MOST_OF_NYQUIST / 2 / units.sample)) if item.is_resonance else ()


def _along(item: Parameter, units: Units) -> Parameter:
    """A period along the way or the scale: from what the shorter of two lengths would make the least to what the longer
    would make the most, as magnets and scales go by neither; none beyond the travel, where it would draw any curve."""
    contact, way = units.contact / REFERENCE.contact, units.travel / REFERENCE.travel
    reading = units.reading / REFERENCE.reading
    longest, shortest = (max(contact, reading), reading) if item.periodic_in == "reading" else (way, way)
    low, high = item.low * min(contact, shortest), item.high * longest
    denser = way * (1 / low - 1 / high) / (1 / item.low - 1 / item.high)
    points = max(round(item.points * denser), 2) if item.points and denser <= DENSEST else 0
    return replace(
        item,
        low=low,
        high=high,
        typical=math.sqrt(low * high),
        points=points,
        linear_within=item.linear_within * high / item.high / way,
        sought=_sought(item, low, high, units),
    )


def _sought(item: Parameter, low: float, high: float, units: Units) -> Range:
    """Where a spectrum looks for a period along the way, whose usual range is low .. high [m]: a screw's lead or a
    motor's teeth are shorter than the magnets that a grid of periods is for, and a magnetic scale's pole pairs longer
    than an optical one's lines."""
    if item.periodic_in == "reading":
        return low, max(high, units.travel / FEWEST_PERIODS)
    shortest = max(units.travel / MOST_PERIODS, MIN_READINGS * units.reading)
    return (min(low, shortest) if item.points else low), high


def looked_for(item: Parameter) -> Parameter:
    """The parameter with where it is looked for in the reference table, if it is a period or a frequency."""
    if item.role == "period" and item.periodic_in in {"position", "reading"}:
        return replace(item, sought=_sought(item, item.low, item.high, REFERENCE))
    if item.is_step:
        return replace(item, sought=_coarse(item, item.low, item.high, REFERENCE.thrust))
    return replace(item, sought=_rings(item, item.low, item.high, REFERENCE)) if item.unit == "Hz" else item


def stated(item: Parameter, ends: tuple[float, ...] | None) -> Parameter:
    """The parameter with the sizes [SI] that a machine states; one that may have either sign may still. A mode stays
    below what the controller samples, whatever room a fit gives it."""
    if ends is None:
        return item
    low, high = ends
    sought: Range = ()
    if item.is_resonance and item.sought:
        most = MOST_SAMPLED / MOST_OF_NYQUIST * item.sought[1]
        low, high = low if low < most else most / STATED_ROOM, min(high, most)
        sought = (low, min(STATED_ROOM * high, most))
    typical = (low * high) ** 0.5
    return replace(item, low=-high if item.low < 0 else low, high=high, typical=typical, stated=True, sought=sought)
