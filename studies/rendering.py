"""A study's report, set by a copy of this process that imports what drawing needs while this one still computes."""

from __future__ import annotations

import multiprocessing
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.interrupt import supervised
from studies.study import Progress, Study

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Keys = dict[str, list[str]]
Render = Callable[[Mapping[str, Any], Path], tuple[Keys, Keys]]
"""Writes the report of the content of results.json to a folder; the keys that figures and tables are made from."""


@contextmanager
def renderer(study: Study, progress: Progress) -> Iterator[Render]:
    """A block in which the study's report can be set: in the copy, or in this process where one is of no use.

    The copy is made only where there is another core, and by a command that nobody has called from their own program:
    that may have threads, whose locks would be held in the copy for ever. The one of a command only waits.
    """

    def here(whole: Mapping[str, Any], folder: Path) -> tuple[Keys, Keys]:
        return render(study, whole, folder, progress)

    if not supervised() or sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
        yield here
        return
    ours, theirs = multiprocessing.Pipe()
    sys.stdout.flush()  # what still waits to be written would be written twice
    copy = multiprocessing.get_context("fork").Process(target=_serve, args=(study, here, ours, theirs))
    copy.start()
    theirs.close()

    def there(whole: Mapping[str, Any], folder: Path) -> tuple[Keys, Keys]:
        try:
            ours.send((whole, folder))
            found = ours.recv()
        except (EOFError, OSError):  # the copy was ended, as when memory runs out
            return here(whole, folder)
        if isinstance(found, Exception):
            raise found
        return found  # type: ignore[no-any-return]

    try:
        yield there
    finally:
        copy.terminate()
        copy.join()
        ours.close()


def _serve(study: Study, work: Render, ours: Connection, theirs: Connection) -> None:
    """What the copy does: imports, waits for the results, answers with what `work` returns or raises, and ends."""
    from reports.style import warm_up

    ours.close()  # so that the wait ends with the process that computes
    try:
        import_module("reports.report")
        import_module(f"studies.{study.name}.report")
        warm_up()
        whole, folder = theirs.recv()
    except EOFError:
        return
    try:
        answer: Any = work(whole, folder)
    except Exception as error:
        error.add_note(traceback.format_exc())
        answer = error
    theirs.send(answer)


def render(study: Study, whole: Mapping[str, Any], folder: Path, progress: Progress) -> tuple[Keys, Keys]:
    """Writes the report from what results.json holds, nothing else; the keys that figures and tables are made from."""
    from reports.report import render as write

    report = study.report(whole)
    write(report, whole, folder, progress=lambda text: progress(0.85, text))
    return (
        {figure.name: list(figure.keys) for figure in report.figures},
        {name: list(keys) for name, keys in report.tables.items()},
    )
