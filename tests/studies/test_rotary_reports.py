"""Nothing that a study says of an axis that turns is in metres, newtons or kilograms.

A report of the linear default machine, in the wording of a rotary axis, tells as much as one of a rotary machine.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest
from matplotlib.text import Text

from models.quantity import turned
from reports import text
from reports.markup import for_figure
from reports.report import Report, select
from studies.catalogue import every
from studies.review.compare import compare, tell

_BEHIND_NUMBER: Final = r"(?<=[\d⁰¹²³⁴⁵⁶⁷⁸⁹$] )"
LINEAR: Final = re.compile(
    r"N m s/m|N/[mµ]?m\b|/kg\b|N m/[mµ]?m\b|[mµ]?m/s\b|\b[mµn]m\b|\[[kmµ]?N[]/]|\[m[]/]"
    rf"|(?<!newton )\bmetres?\b|\bnewtons?\b(?! metre)"
    rf"|{_BEHIND_NUMBER}(?:[kmµ]?N|m)\b(?! m| =)|{_BEHIND_NUMBER}kg\b(?! m)"
)
AS_PRINTED: Final = re.compile(
    r"Only N/mm closes.*|In N/m the force would.*"
)  # of the paper's table: what it misprints


def linear_units(shown: str) -> list[str]:
    """What of a text is of a linear axis, with the words around it."""
    plain = AS_PRINTED.sub("", shown.replace("\u00a0", " ").replace("\u2060", ""))
    return [plain[max(found.start() - 30, 0) : found.end() + 10] for found in LINEAR.finditer(plain)]


def page(report: Report, whole: dict[str, Any]) -> str:
    """The words of the report, of which formulas and Markdown's marks are left out."""
    captions = {figure.name: figure.caption for figure in report.figures}
    markdown = turned(text.fill(report.template, whole, captions, report.filters))
    return re.sub(r"\\(?=[^\w\s])", "", re.sub(r"(?<!\\)\$[^$]*(?<!\\)\$", "$", markdown))


def figures(report: Report, whole: dict[str, Any]) -> list[str]:
    """The words in the report's figures, without those in mathematics."""
    drawn = [figure.draw(for_figure(select(whole, figure))) for figure in report.figures]
    texts = [said for one in drawn for said in one.findobj(Text)]
    return [re.sub(r"\$[^$]*\$", "$", turned(said.get_text())) for said in texts if hasattr(said, "get_text")]


@pytest.mark.parametrize("name", sorted(every()))
def test_no_unit_of_a_linear_axis_is_left_in_a_report(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    whole = json.loads((quick_run(name)[0] / "results.json").read_text(encoding="utf-8"))
    report = every()[name].report(whole)
    assert linear_units(page(report, whole)) == []
    assert [found for one in figures(report, whole) for found in linear_units(one)] == []


def test_a_report_that_a_review_makes_anew_is_in_the_axis_units_as_well(
    quick_run: Callable[[str], tuple[Path, int]],
) -> None:
    whole = json.loads((quick_run("deadbeat_design")[0] / "results.json").read_text(encoding="utf-8"))
    assert every()["deadbeat_design"].report(whole).wording is str
    whole["machine"]["axis"] = "rotary"
    assert every()["deadbeat_design"].report(whole).wording is turned
    assert tell(compare(whole, whole)).wording is turned


def test_the_units_of_a_linear_axis_are_found() -> None:
    for said in ("by 3 N", "[mm]", "1028 N m/mm", "150000 N m s/m", "0.0001 1/kg", "in metres", "of 3 kg", "by 20 m"):
        assert linear_units(said), said
    for said in ("by 3 N m", "[mrad]", "N m/mrad", "150000 N m s/rad", "1/(kg m²)", "of 3 kg m²", "newton metres"):
        assert not linear_units(said), said
