"""The experiment that tells the kinds apart: the same sequence, with the compensator exchanged twice.

First for one with all the elements that the designer's friction has, so that nothing is left of the compensator's
design; then for one with the elements of the table's friction, identified anew on the day. A dispersion that falls at
the first exchange was the compensator's design, one that falls at the second a wrong friction, one that stays something
else: another parameter, or an effect that the model lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any, Final

from design.friction_compensation import simplify, with_force
from models.friction import Friction
from studies.paper_gap.candidates import COMPENSATOR, Candidate, Table
from studies.paper_gap.compensators import with_compensator
from studies.paper_gap.explore import Draw, rest
from studies.paper_gap.pattern import CONVERGED, by_scale, outcome_of

FALLEN: Final = 0.5  # A dispersion below this share of the published one counts as fallen.
FRICTION: Final = "friction"
OTHER: Final = "other"
FRICTIONS: Final = (
    "friction_level",
    "presliding_length",
    "wrong_friction",
    "identified_level",
    "identified_length",
    "identified_friction",
)


def exchanged(
    tables: Sequence[Table], draws: Sequence[Draw], published: float, pool: Executor | None
) -> dict[str, Any]:
    """3 sigma [m] of each draw in place, behind the first and behind the second exchange, what that says, and how often
    it is right. published [m]: the dispersion that is to be explained."""
    mapped = (pool.map if pool else map)(_exchanged, ((tables[one.table], one) for one in draws))
    rows = [
        {
            "name": one.case.name,
            "way": one.case.way,
            "cause": cause(one.case.candidate(), one.case.name),
            "dispersions_m": [one.outcome.dispersion, *sigma],
            "says": says(sigma, FALLEN * published),
        }
        for one, sigma in zip(draws, mapped, strict=True)
    ]
    return {"fallen": FALLEN, "rows": rows, "right": sum(row["cause"] == row["says"] for row in rows), "of": len(rows)}


def cause(candidate: Candidate, name: str) -> str:
    """What the exchange should say of a candidate: COMPENSATOR, FRICTION or OTHER."""
    if candidate.kind == COMPENSATOR:
        return COMPENSATOR
    return FRICTION if name in FRICTIONS else OTHER


def says(dispersions: Sequence[float], limit: float) -> str:
    """What the dispersions [m] behind the two exchanges say."""
    first, second = dispersions
    return COMPENSATOR if first < limit else (FRICTION if second < limit else OTHER)


def _exchanged(given: tuple[Table, Draw]) -> list[float]:
    """3 sigma [m] behind the two exchanges."""
    (machine, controller), one = given
    candidate = one.case.candidate()
    true, _ = candidate.put((machine, controller), one.values)
    found = []
    for friction in (candidate.believed(machine, one.values), true.friction):
        law = with_compensator(controller, _all_elements(friction))
        found.append(outcome_of(by_scale(true, law, rest(machine, one.point), CONVERGED)).dispersion)
    return found


def _all_elements(friction: Friction) -> Friction:
    return simplify(friction, len(with_force(friction).limit))
