"""Every effect at its typical size, those of several laws by each."""

from __future__ import annotations

from dataclasses import replace

from models.effects.base import Effect, parameters
from models.effects.catalogue import every


def laws() -> dict[str, Effect]:
    """By name; the other law of an effect with a switch goes by the switch's name behind its own, a third by its number
    behind that."""
    found: dict[str, Effect] = {}
    for name, kind in every().items():
        found[name] = kind.typical()
        for item in parameters(kind):
            if item.role == "switch":
                for law in range(1, int(item.high) + 1):
                    further = f" {law}" if law > 1 else ""
                    found[f"{name} {item.name}{further}"] = replace(kind.typical(), **{item.name: law})
    return found
