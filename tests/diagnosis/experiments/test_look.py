"""What the next record is to confirm: the names of a look, or what came nearest to one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from diagnosis.experiments.look import _tried
from diagnosis.which.stage import Proposal
from models.effects.friction_laws import Stribeck, ViscousFriction
from models.machine import load

PRIORS = load().priors
DRAG, CURVE = ViscousFriction(20.0), Stribeck.typical(PRIORS)


def stage(*proposals: Proposal, inside: tuple[Any, ...] = ()) -> Any:
    fitted = SimpleNamespace(candidate=SimpleNamespace(added_effects=list(inside)))
    return SimpleNamespace(fitted=fitted, scanned=proposals)


def test_names_are_tried_with_their_laws_in_the_model() -> None:
    assert _tried((DRAG.name,), stage(inside=(DRAG, CURVE))) == ((DRAG.name,), (DRAG,))
    assert _tried(("controller_mismatch",), stage()) == (("controller_mismatch",), ())


def test_without_a_name_what_is_in_the_model_is_tried_and_else_the_best_proposal() -> None:
    """By its gain over its own threshold, not by the gain."""
    assert _tried((), stage(inside=(CURVE,))) == ((CURVE.name,), (CURVE,))
    strong = Proposal(CURVE.name, 30.0, 60.0, effect=CURVE)
    near = Proposal(DRAG.name, 18.0, 20.0, effect=DRAG)
    assert _tried((), stage(strong, near)) == ((DRAG.name,), (DRAG,))
    assert _tried((), stage()) == ((), ())
    assert _tried((), stage(Proposal(DRAG.name, -3.0, 20.0, effect=DRAG))) == ((), ())
