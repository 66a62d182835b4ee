"""Every report says what its tables are made from, and shares one table of symbols."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from studies.catalogue import HERE

TEMPLATES = sorted(path for path in HERE.glob("*/report.md") if path.parent.name != "review")


def whole(template: Path) -> str:
    """The template with the parameters that it includes; the symbols are made from no results."""
    text = template.read_text(encoding="utf-8")
    return text.replace('{% include "parameters.md" %}', (HERE / "parameters.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: path.parent.name)
def test_every_table_declares_the_keys_that_it_is_made_from(template: Path) -> None:
    labels = set(re.findall(r"\{#tbl:([\w-]+)\}", whole(template)))
    tables = importlib.import_module(f"studies.{template.parent.name}.report").TABLES
    assert labels == set(tables)
    assert all(keys for keys in tables.values())


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: path.parent.name)
def test_every_report_has_the_table_of_symbols(template: Path) -> None:
    assert template.read_text(encoding="utf-8").count('{% include "symbols.md" %}') == 1


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: path.parent.name)
def test_every_report_lists_the_parameters_with_their_sources(template: Path) -> None:
    assert template.read_text(encoding="utf-8").count('{% include "parameters.md" %}') == 1
