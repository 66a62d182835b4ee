"""Fills in the templates of this room; knows no law."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import jinja2

TEMPLATES: Final = Path(__file__).parent / "templates"


def hexadecimal(value: float) -> str:
    """A double (SI) as C99 writes it without rounding; small whole numbers as they are commonly written."""
    return f"{value:.1f}" if value == int(value) and abs(value) < 1e6 else value.hex()


def filled(template: str, number: Any, **given: Any) -> str:
    """The text of a template; number: how a double is written in its language."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["number"] = lambda value: number(float(value))
    environment.filters["row"] = lambda values: "[" + ", ".join(number(float(one)) for one in values) + "]"
    return environment.get_template(template).render(**given)
