"""The Markdown of a report: the study's template filled with its results.

What a template prints is text, shown as it is, unless it is a `markup.Markdown`: no template can forget to escape.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateSyntaxError
from jinja2.ext import Extension
from jinja2.lexer import Token, TokenStream

from reports.markup import Markdown, block, code, escape, formula

NO_BREAK = "\u00a0"


def fill(
    template: Path,
    results: Mapping[str, Any],
    captions: Mapping[str, str],
    filters: Mapping[str, Callable[..., Any]],
) -> str:
    """The template's Markdown with `results` and every figure of `captions` (name to caption) in its place.

    Captions are text, too, unless they are `Markdown`. Templates have, beside `filters`: `verdict`; `formula`,
    `code` and `block` for a text in mathematics and in letters of one width; `markdown` for words of the template that
    are markup.
    Raises `ValueError` for a figure that is unknown, placed twice or not placed and for a printed None, and
    `jinja2.UndefinedError` for a variable that the results do not have.
    """
    placed: list[str] = []

    def figure(name: str) -> Markdown:
        if name not in captions:
            raise ValueError(f"the template places figure {name!r}, which the report does not have")
        if name in placed:
            raise ValueError(f"the template places figure {name!r} twice")
        placed.append(name)
        caption = " ".join(escape(captions[name]).split())
        return Markdown(f"\n\n![{caption}](figures/{name}.svg){{#fig:{name}}}\n\n")

    environment = Environment(
        loader=FileSystemLoader([template.parent, template.parent.parent]),  # what studies share is one above
        undefined=StrictUndefined,
        finalize=_printed,
        trim_blocks=True,
        lstrip_blocks=True,
        # Jinja2's own '{#' is how Markdown writes a label: '{#fig:step}'.
        comment_start_string="<!--",
        comment_end_string="-->",
        keep_trailing_newline=True,
        autoescape=False,  # it is Markdown, not HTML: `finalize` escapes
        extensions=[OwnWords],
    )
    own = {"verdict": verdict, "formula": formula, "code": code, "block": block, "markdown": Markdown}
    environment.filters.update({**own, **filters})
    body = environment.get_template(template.name).render(results=results, figure=figure)
    if unplaced := sorted(set(captions) - set(placed)):
        raise ValueError(f"the template does not place these figures of the report: {unplaced}")
    _check_tables(body)
    return body


def head(title: str, question: str, figures: Iterable[str]) -> str:
    """The metadata block that opens the Markdown of a report; `figures` are the names of those that must come out."""
    # JSON is YAML, so whatever the title holds is quoted right; YAML does not know JSON's pairs for one character.
    data = {"title": escape(title), "question": escape(question), "figures": [f"#fig:{name}" for name in figures]}
    return f"---\n{json.dumps(data, ensure_ascii=False)}\n---\n\n"


def verdict(holds: bool) -> Markdown:
    """The mark of a check, to be told without colour: '✓ holds' or '✗ MISSED'. Raises `TypeError` for a non-bool."""
    if not isinstance(holds, bool):
        raise TypeError(f"a verdict is on True or False, not on {holds!r}")
    return Markdown(f"[✓{NO_BREAK}holds]{{.holds}}" if holds else f"[✗{NO_BREAK}MISSED]{{.missed}}")


class OwnWords(Extension):
    """Refuses a template that takes anything but words of its own for markup: `{{ name | markdown }}`."""

    def filter_stream(self, stream: TokenStream) -> Iterable[Token]:
        """The template's tokens. Raises `TemplateSyntaxError` where what `markdown` filters is not one string."""
        before: tuple[str, ...] = ()
        for token in stream:
            if token.value == "markdown" and before != ("string", "pipe"):
                raise TemplateSyntaxError("only words of the template can be markup", token.lineno, stream.name)
            before = (*before[-1:], token.type)
            yield token


def _printed(value: Any) -> Markdown:
    # Jinja2 would print the word None into the report, where it reads like a result.
    if value is None:
        raise ValueError("the template prints a value that is None")
    return escape(value)


def _check_tables(markdown: str) -> None:
    """Raises `ValueError` for a row of a pipe table with more or fewer cells than the row above it."""
    # Pandoc drops the cells that are too many without a word: '|S|' outside of maths in a cell is enough.
    previous = 0
    for line in markdown.splitlines():
        bars = len(re.findall(r"\|", re.sub(r"\\.|\$[^$]*\$|`[^`]*`", "", line))) if line.startswith("|") else 0
        if previous and bars and bars != previous:
            raise ValueError(f"a row of a table has {bars - 1} cells and the one above it {previous - 1}: {line}")
        previous = bars
