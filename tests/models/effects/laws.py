"""Every effect at its typical size, those of two laws by both."""

from __future__ import annotations

from dataclasses import replace

from models.effects.base import Effect, parameters
from models.effects.catalogue import every


def laws() -> dict[str, Effect]:
    """By name; the other law of an effect with a switch goes by the switch's name behind its own."""
    found: dict[str, Effect] = {}
    for name, kind in every().items():
        found[name] = kind.typical()
        for item in parameters(kind):
            if item.role == "switch":
                found[f"{name} {item.name}"] = replace(kind.typical(), **{item.name: item.high})
    return found
