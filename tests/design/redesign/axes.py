"""Axes for the tests of the redesign: the default table with short intervals, and one like it that is known wrongly."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from models.machine import Machine, load
from models.variation import Variation, varied

_DEFAULT: Final = load()
KNOWN: Final[Machine] = replace(
    _DEFAULT,
    scale=_DEFAULT.scale.noisy(),
    published=None,
    specification=replace(_DEFAULT.specification, interval=0.15, tolerance=0.5e-6),
)
"""What the machine file says."""
TRUE: Final[Machine] = varied(KNOWN, Variation(payload=0.06, friction_force=0.2, dead_time=1e-4))
"""What the axis is."""
