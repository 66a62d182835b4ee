"""All laws of the catalogue's effects that are sealed on drawn machines, by effect."""

from __future__ import annotations

from typing import Final

from studies.blind_trial.sealer.machines.forms import Form
from studies.blind_trial.sealer.machines.friction_forms import FRICTION
from studies.blind_trial.sealer.machines.other_forms import OTHERS

LAWS: Final = (*FRICTION, *OTHERS)
EFFECTS: Final = tuple(dict.fromkeys(form.effect for form in LAWS))


def laws_of(effect: str) -> tuple[Form, ...]:
    """The forms of one effect."""
    return tuple(form for form in LAWS if form.effect == effect)
