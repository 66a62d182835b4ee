"""Packages behind the readers: those that are needed for some formats only, and what they say besides their answers."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from models.records.tables.sizes import RecordError


def optional(module: str, package: str, format_name: str) -> Any:
    """The module of an optional package. Raises RecordError, with the command that installs it, where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        raise RecordError(
            f"{format_name} needs the package {package}, which is not installed; run python -m pip install {package} "
            "in the project's environment, or export the record in another format"
        ) from error


@contextmanager
def unlogged() -> Iterator[None]:
    """Within, libraries log nothing: what is wrong with a file is said in one line, in the error that is raised."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
