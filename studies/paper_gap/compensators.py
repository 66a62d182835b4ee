"""Designs of the compensator RFM that the paper's words allow: N is printed, where its elements lie is not.

Section V.A gives N = 5 and says that the RFM expresses the comprehensive slopes of the friction in both regions. It
does not say which limits X_mi the elements have, nor over which part of the curve they are fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.friction_compensation import simplify, with_force
from models.controller import Controller
from models.friction import Friction, branch, fit_elements
from models.machine import Machine

Array = NDArray[np.float64]

CURVE_POINTS: Final = 400  # of the curve that is fitted


@dataclass(frozen=True)
class Design:
    """How an RFM is made of a friction; the default is this project's own design.

    count: elements; None: as many as the machine file says. spacing, points: exponents of the limits' and of the fitted
    distances' steps, 0 for even ratios, 1 for even steps. smallest, largest: the RFM's limits at the ends, relative to
    the friction's. end: the longest fitted distance, relative to twice the friction's largest limit. slopes: the weight
    of the two published slopes, drawn as straight lines, beside the friction's curve.
    """

    count: int | None = None
    spacing: float = 0.0
    smallest: float = 1.0
    largest: float = 1.0
    points: float = 0.0
    end: float = 1.0
    slopes: float = 0.0


def compensator(machine: Machine, friction: Friction, design: Design) -> Friction:
    """The RFM for a friction, by a design; its T_fc is the friction's."""
    limits, count = with_force(friction).limit, design.count or number(machine)
    low, high = min(limits), max(limits)
    x = spaced(design.smallest * low, design.largest * high, count, design.spacing)
    s = spaced(low / 2, 2 * high * design.end, CURVE_POINTS, design.points)
    force = (1 - design.slopes) * branch(friction, s) + design.slopes * two_slopes(machine, s)
    return fit_elements(x, s, force, friction.coulomb_force)


def spaced(low: float, high: float, count: int, exponent: float) -> Array:
    """Numbers (count,) from low to high whose powers are evenly spaced: in even ratios for 0, in even steps for 1."""
    if count == 1:
        return np.array([high])
    if exponent < 1e-6:
        return np.geomspace(low, high, count)
    return np.asarray(np.linspace(low**exponent, high**exponent, count) ** (1 / exponent))


def two_slopes(machine: Machine, distance: Array) -> Array:
    """The force climbed [N] behind a reversal by the two published slopes alone, up to 2 T_fc."""
    facts = machine.presliding
    corner = facts.boundary * facts.stiffness_1
    climbed = np.where(
        distance < facts.boundary,
        facts.stiffness_1 * distance,
        corner + facts.stiffness_2 * (distance - facts.boundary),
    )
    return np.minimum(climbed, 2 * facts.coulomb_force)


def number(machine: Machine) -> int:
    """The RFM's elements by the machine file."""
    count = machine.control.compensator_elements
    assert count != "auto"  # the study has put a number in its place
    return count


def with_compensator(controller: Controller, rfm: Friction) -> Controller:
    """The controller with another RFM."""
    return replace(controller, friction_compensation=rfm)


def slope_error(machine: Machine, rfm: Friction) -> float:
    """The larger relative error [1] of the RFM's comprehensive slopes in Regions 1 and 2, beside the friction's own."""
    facts, friction = machine.presliding, machine.friction
    ends = np.array([0.0, facts.boundary, 2 * max(friction.limit)])
    its, own = (np.diff(branch(one, ends)) for one in (rfm, friction))
    return float(np.max(np.abs(its / own - 1)))


@dataclass(frozen=True)
class Named:
    """A design with a name of its own, for the table of designs."""

    name: str
    design: Design | None  # None: this project's own, with as many elements as the friction has


def named(machine: Machine) -> tuple[Named, ...]:
    """The designs that are simulated on every table."""
    count = number(machine)
    others = tuple(
        Named(f"even ratios, N = {other}", Design(other)) for other in (count - 2, count - 1, count + 1, count + 3)
    )
    return (
        Named("even ratios (this project's)", Design()),
        *(one for one in others if one.design and one.design.count and one.design.count > 0),
        Named("the friction's own elements", None),
        Named("even ratios, fitted at even distances", Design(points=1.0)),
        Named("even ratios, fitted to the two slopes", Design(slopes=1.0)),
        Named("even ratios, from 5 times the smallest limit", Design(smallest=5.0)),
        Named("steps of even square roots", Design(spacing=0.5)),
        Named("even steps", Design(spacing=1.0)),
        Named("even steps, fitted at even distances", Design(spacing=1.0, points=1.0)),
        Named("even steps, fitted to the two slopes", Design(spacing=1.0, slopes=1.0)),
        Named(f"even steps, N = {2 * count}", Design(2 * count, spacing=1.0)),
    )


def of_name(machine: Machine, one: Named) -> Friction:
    """The RFM of a named design."""
    friction = machine.friction
    if one.design is None:
        return simplify(friction, len(with_force(friction).limit))
    return compensator(machine, friction, one.design)
