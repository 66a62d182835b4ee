"""Every report says what its tables are made from, defines its symbols and lists every parameter with its source."""

from __future__ import annotations

import html
import importlib
import json
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from models.machine import Provenance
from studies.catalogue import HERE, every
from studies.wording import source

INSTRUCTIONS = r"\s*(\{%[^%]*%\}\s*)+"
TEMPLATES = sorted(path for path in HERE.glob("*/report.md") if path.parent.name != "review")


def whole(template: Path) -> str:
    """The template with the parameters that it includes; the symbols are made from no results."""
    text = template.read_text(encoding="utf-8")
    for name in set(re.findall(r'{% include "([\w.]+)" %}', text)) - {"symbols.md"}:
        beside = template.with_name(name)
        included = (beside if beside.exists() else HERE / name).read_text(encoding="utf-8")
        text = text.replace(f'{{% include "{name}" %}}', included)
    return text


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: path.parent.name)
def test_every_table_declares_the_keys_that_it_is_made_from(template: Path) -> None:
    labels = set(re.findall(r"\{#tbl:([\w-]+)\}", whole(template)))
    module = importlib.import_module(f"studies.{template.parent.name}.report")
    tables = module.TABLES | getattr(module, "MANY_TABLES", {})  # those of a trial on many machines stand in it, too
    assert labels == set(tables)
    assert all(keys for keys in tables.values())


@pytest.mark.parametrize("name", sorted(every()))
def test_every_report_shows_one_table_of_symbols(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    page = (quick_run(name)[0] / "report.html").read_text(encoding="utf-8")
    assert page.count('id="tbl:symbols"') == 1


@pytest.mark.parametrize("name", sorted(every()))
def test_no_report_has_a_range_of_one_number(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    page = (quick_run(name)[0] / "report.html").read_text(encoding="utf-8")
    words = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", "", page)))
    assert not [found[0] for found in re.finditer(r"(?<![\w.])(\d[\d.,]* [^\W\d]+|never|\d+ %?) to \1(?![\w.])", words)]


@pytest.mark.parametrize("name", sorted(every()))
def test_every_report_lists_each_parameter_with_its_source(
    name: str, quick_run: Callable[[str], tuple[Path, int]]
) -> None:
    folder, _ = quick_run(name)
    parameters = json.loads((folder / "results.json").read_text(encoding="utf-8"))["parameters"]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count('id="tbl:parameters"') == 1
    body = page[page.index('id="tbl:parameters"') :].partition("<tbody>")[2].partition("</tbody>")[0]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in body.split("</tr>") if "<td" in row]
    assert [letters(cells[0]) for cells in rows] == [letters(one["name"]) for one in parameters]
    sources = [one["provenance"]["kind"] + one["provenance"]["detail"] for one in parameters]
    assert [letters(cells[3]) for cells in rows] == [letters(source) for source in sources]


def letters(text: str) -> str:
    """Letters and digits of a text or a table's cell; what Markdown and HTML make of the others is not looked at."""
    return "".join(re.findall(r"[^\W_]", html.unescape(re.sub(r"<[^>]*>", "", text))))


@pytest.mark.parametrize(
    ("provenance", "text"),
    [
        (Provenance("paper", "II.A"), "paper: II.A"),
        (
            Provenance("identified", "slow sweep", "", "slow.csv", 64 * "a", 0.2),
            f"identified: slow sweep, record slow.csv (SHA-256 {12 * 'a'}…), standard deviation 0.2 N",
        ),
        (
            Provenance("identified", "", "", "slow.csv", "", (0.2, 0.4)),
            "identified, record slow.csv, standard deviation 0.2 N to 0.4 N",
        ),
    ],
)
def test_a_parameter_s_source_names_its_record_and_deviation(provenance: Provenance, text: str) -> None:
    row = json.loads(json.dumps({"unit": "N", "provenance": vars(provenance)}))
    assert source(row).replace("\u00a0", " ") == text


@pytest.mark.parametrize("template", sorted(HERE.glob("**/*.md")), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_heading_follows_an_empty_line_whichever_parts_a_report_has(template: Path) -> None:
    """Behind a paragraph it would be a line of it. Lines of instructions leave nothing, not even an empty line."""
    lines = template.read_text(encoding="utf-8").splitlines()
    words = [line for line in lines if not re.fullmatch(INSTRUCTIONS, line)]
    bare = [line for before, line in pairwise(["", *words]) if re.match("#+ ", line) and before.strip()]
    assert not bare


@pytest.mark.parametrize("template", sorted(HERE.glob("**/*.md")), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_line_that_ends_with_an_instruction_does_not_swallow_the_next(template: Path) -> None:
    """What follows would stand behind it without a blank: an instruction takes the end of its line with it."""
    lines = template.read_text(encoding="utf-8").splitlines()
    joined = [
        (line, after)
        for line, after in pairwise(lines)
        if line.endswith("%}") and not re.fullmatch(INSTRUCTIONS, line) and after and not after.startswith("{%")
    ]
    assert not joined
