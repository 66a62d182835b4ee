"""Packages behind the readers: those that are needed for some formats only, and what they say besides their answers."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from models.records.tables.sizes import RecordError


def check_installed(package: str, format_name: str) -> None:
    """Raises RecordError, with the command that installs it, where an optional package is missing."""
    if find_spec(package) is None:
        raise RecordError(
            f"{format_name} needs the package {package}, which is not installed; run python -m pip install {package} "
            "in the project's environment, or export the record in another format"
        )


@contextmanager
def unlogged() -> Iterator[None]:
    """Within, libraries log nothing: what is wrong with a file is said in one line, in the error that is raised."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
