"""A report is the readable face of a study's results: figures, a web page and a PDF.

Nothing is computed here. A study hands over its results, plain data as JSON holds it, and a `Report` that says
how they are drawn and told. `render` writes

    figures/NAME.svg    one file per figure
    report.html         one self-contained page: no script, no request to anywhere
    report.pdf          the same text for A4 paper

and the same results give the same bytes, on every run.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure as Drawing

from reports import pages, style, text
from reports.markup import for_figure

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Figure:
    """One figure of a report.

    `name` is its file name and its label; `caption` is text or, with formulas and references, `markup.Markdown`;
    `keys` are the dotted keys of the results that it is drawn from, and `draw` gets the results cut down to these
    keys: what a figure says it shows is what it can show. In the strings that it gets a '$' is a dollar (see
    `markup.for_figure`); mathematics is only what `draw` writes itself.
    """

    name: str
    caption: str
    keys: tuple[str, ...]
    draw: Callable[[Mapping[str, Any]], Drawing]


@dataclass(frozen=True)
class Report:
    """A report's question and content: a Jinja2 Markdown `template` with `figures` placed in it.

    `title` and `question` (one sentence) are text, or `markup.Markdown`; `filters` are the study's own Jinja2
    filters, such as the rounding of its numbers; `tables` say, by the table's label without its "tbl:", which keys it
    is made from. `wording` is done to the text and to every text of a figure, such as putting other units.
    """

    title: str
    question: str
    template: Path
    figures: tuple[Figure, ...]
    filters: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    tables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    wording: Callable[[str], str] = str


def render(
    report: Report, results: Mapping[str, Any], folder: Path, *, progress: Progress | None = None
) -> tuple[Path, ...]:
    """Writes the report on `results` below `folder` and returns the written paths, sorted.

    `progress` is called with a line per step. Raises `ValueError` or `KeyError` naming the figure, the key or the
    variable at fault when figures, template and results do not fit together, and `pages.PageError` with the
    converter's message when the Markdown can not be set; what was written by then is left behind in `folder`.
    """
    tell = progress or (lambda _: None)
    drawn_from = {figure.name: select(results, figure) for figure in report.figures}
    for name, keys in report.tables.items():
        part_of(results, keys, f"table {name!r} is made")
    captions = {figure.name: figure.caption for figure in report.figures}
    if wrong := [name for name in captions if not re.fullmatch(r"[\w-]+", name)]:
        raise ValueError(f"not the name of a figure: {wrong}")
    if len(captions) != len(report.figures):
        raise ValueError(f"two figures of one name: {sorted(figure.name for figure in report.figures)}")
    body = text.fill(report.template, results, captions, report.filters)
    markdown = report.wording(text.head(report.title, report.question, captions) + body)
    drawings = folder / "figures"
    drawings.mkdir(parents=True, exist_ok=True)

    def drawn(figure: Figure) -> Path:
        tell(f"drawing {figure.name}")
        return draw(figure, drawn_from[figure.name], drawings, report.wording)

    helper = _begin(drawn, report.figures)
    # Pandoc is a process of its own: it sets the text for paper while this one still draws.
    with ThreadPoolExecutor(max_workers=2) as pool:
        source = pool.submit(pages.to_typst, markdown)
        ours = set[str]()
        for number in range(len(report.figures)) if helper is None else helper.turns():
            drawn(report.figures[number])
            ours.add(report.figures[number].name)
        done = helper is not None and helper.succeeded()
        written = []
        for figure in report.figures:
            kept = figure.name in ours or done
            written.append(_file(figure, drawings) if kept else drawn(figure))
        tell("setting report.html and report.pdf")
        html = pool.submit(pages.write_html, markdown, folder)
        written.append(pages.write_pdf(source.result(), folder))
        written.append(html.result())
    return tuple(sorted(written))


@dataclass(frozen=True)
class _Helper:
    """A copy of this process that draws, too; `taken` counts the figures that either has begun, of `count`."""

    process: BaseProcess
    taken: Synchronized[int]
    count: int

    def turns(self) -> Iterator[int]:
        """The numbers of the figures that this process is to draw, each taken when it comes to it."""
        return _turns(self.taken, self.count)

    def succeeded(self) -> bool:
        """Whether the copy has drawn all that it took; waits for it."""
        self.process.join()
        return self.process.exitcode == 0


def _turns(taken: Synchronized[int], count: int) -> Iterator[int]:
    while True:
        with taken.get_lock():
            number = taken.value
            taken.value += 1
        if number >= count:
            return
        yield number


def _begin(drawn: Callable[[Figure], Path], figures: Sequence[Figure]) -> _Helper | None:
    """A copy of this process that draws these figures on another core, at once, as it has imported all that it needs.

    None where there is no other core, or where a copy would not be safe: on systems other than Linux, and where other
    threads of Python run, whose locks would be held in the copy for ever. The idle threads of a solver do no harm.
    """
    if len(figures) < 2 or sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2 or threading.active_count() > 1:
        return None
    sys.stdout.flush()  # what still waits to be written would be written twice
    context = multiprocessing.get_context("fork")
    taken = context.Value("i", 0)
    process = context.Process(target=_draw_in_turn, args=(drawn, figures, taken), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12, about those idle threads
        process.start()
    return _Helper(process, taken, len(figures))


def _draw_in_turn(drawn: Callable[[Figure], Path], figures: Sequence[Figure], taken: Synchronized[int]) -> None:
    try:
        for number in _turns(taken, len(figures)):
            drawn(figures[number])
    except (
        Exception
    ):  # whoever started this process draws them once more, and then the error is raised where it is seen
        sys.exit(1)


def draw(figure: Figure, results: Mapping[str, Any], folder: Path, wording: Callable[[str], str] = str) -> Path:
    """Draws one figure to `folder`/NAME.svg, its texts as `wording` has them. Raises `KeyError` if it reads results
    that it does not declare."""
    path = _file(figure, folder)
    try:
        style.save(figure.draw, for_figure(results), path, wording)
    except KeyError as error:
        raise KeyError(f"figure {figure.name!r} reads {error}, which is none of its keys {figure.keys}") from error
    return path


def _file(figure: Figure, folder: Path) -> Path:
    return folder / f"{figure.name}.svg"


def select(results: Mapping[str, Any], figure: Figure) -> dict[str, Any]:
    """The part of `results` that `figure.keys` name, nested as in `results`. Raises `KeyError` for a missing key."""
    return part_of(results, figure.keys, f"figure {figure.name!r} is drawn")


def part_of(results: Mapping[str, Any], keys: tuple[str, ...], what: str) -> dict[str, Any]:
    """The part of `results` that dotted `keys` name. Raises `KeyError` that begins with `what` for a missing one."""
    part: dict[str, Any] = {}
    for key in keys:
        *parents, last = key.split(".")
        source: Any = results
        target = part
        for parent in parents:
            source = _step(source, parent, key, what)
            target = target.setdefault(parent, {})
        target[last] = _step(source, last, key, what)
    return part


def _step(source: Any, name: str, key: str, what: str) -> Any:
    if not isinstance(source, Mapping) or name not in source:
        raise KeyError(f"{what} from {key!r}, which the results do not have")
    return source[name]
