"""Text goes in and the same text is shown, whatever it holds; only our own markup is markup."""

from __future__ import annotations

import ast
import html
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import pypandoc
import pytest
import typst
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from reports import pages, style
from reports.markup import Markdown, code, escape, for_figure, formula, unlinked, visible
from reports.text import fill
from tests.reports.payloads import PAYLOADS

ROOT = Path(__file__).parents[2]
# Payloads, and what they are made from.
PIECES = [
    *PAYLOADS, *"\\`*_{}[]()<>#+-.!|$~^@:;=&%'\"/?,", "--", "...", "```", ":::", "1.", "(a)", "http://", "|--", "&amp;",
]  # fmt: skip
TEXTS = st.lists(st.sampled_from([*PIECES, "a", "b", " "]) | st.text(max_size=6), max_size=8).map("".join)
# Each example is a page of texts and a process of its own; making a failure smaller would take minutes.
CONVERTED = settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow], phases=[Phase.generate]
)


def shown(text: str) -> str:
    """What a reader is to see of a text: on one line, without blanks at its ends, apostrophes set as such."""
    return re.sub(r"(?<=[^\W\d_])'", "\u2019", visible(text)).strip(" ")


def converted(markdown: str, to: str) -> str:
    command = [pypandoc.get_pandoc_path(), f"--from={pages.MARKDOWN}", f"--to={to}", "--sandbox", "--wrap=none"]
    return subprocess.run(command, input=markdown, capture_output=True, encoding="utf-8", check=True).stdout


@CONVERTED
@given(texts=st.lists(TEXTS, min_size=20, max_size=40))
def test_any_text_is_shown_as_typed_on_the_web_page(texts: list[str]) -> None:
    page = converted("\n\n".join(f"{escape(text)};end" for text in texts), "html")
    assert [html.unescape(one) for one in re.findall(r"<p>([^<>]*)</p>", page)] == [
        shown(f"{one};end") for one in texts
    ]
    assert page.count("<") == 2 * len(texts)


@CONVERTED
@given(texts=st.lists(TEXTS, min_size=30, max_size=50))
def test_any_text_is_shown_as_typed_in_a_table_on_paper(texts: list[str]) -> None:
    rows = "".join(f"| {escape(text)}; | end |\n" for text in texts)
    front = "---\ntitle: t\nquestion: q\n---\n\n::: {.summary}\ns\n:::\n\n"
    whole = pages.to_typst(f"{front}| a | b |\n|---|---|\n{rows}\n\nTable: t\n")
    source = whole[whole.index("#figure(") :]
    assert not pages.REACHING.search(source)
    page = typst.compile(f"#let align(_, body) = body\n{source}".encode(), format="html")
    assert isinstance(page, bytes)
    cells = re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", page.decode(), re.DOTALL)
    assert [html.unescape(cell).replace("\u2212", "-").replace("\u200b", "") for cell in cells[2:]] == [
        one for text in texts for one in (shown(f"{text};"), "end")
    ]


@given(text=TEXTS)
def test_what_is_escaped_is_on_one_line_and_escaped_once(text: str) -> None:
    once = escape(text)
    assert len(once.splitlines()) <= 1
    assert escape(once) is once
    assert "*a" + once == escape("*a") + once
    assert (escape(str(once)) == once) is ("\\" not in once)  # what is text again is escaped again


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a\x00b", "a[U+0000]b"),
        ("a \r\n\t b", "a b"),
        ("\u202ea", "[U+202E]a"),
        ("\ud800", "[U+D800]"),
        ("é 軸", "é 軸"),
    ],
)
def test_signs_that_nobody_sees_are_shown(text: str, expected: str) -> None:
    assert visible(text) == expected


def test_what_is_added_to_markup_is_text() -> None:
    assert Markdown("*a*") + "*b*" == "*a*\\*b\\*"
    assert "*b*" + Markdown("*a*") == "\\*b\\**a*"
    assert isinstance("x" + Markdown("*a*"), Markdown)
    assert not isinstance(Markdown("*{}*").format("x"), Markdown)
    assert unlinked(Markdown("see [](#tbl:a), $x$"), "a table") == "see a table, $x$"


def test_plain_numbers_can_stand_in_a_formula() -> None:
    assert [escape(number) for number in (-3, 1.5, "2e-05", "1.")] == ["-3", "1.5", "2e-05", "1\\."]


@pytest.mark.parametrize("tex", ["x$ y", "x\\", "$"])
def test_a_formula_can_not_end_the_mathematics(tex: str) -> None:
    with pytest.raises(ValueError, match="not a formula"):
        formula(tex)


@pytest.mark.parametrize("text", ["a`b", "``", "plain", "`{=html}", "a$b|c"])
def test_code_is_literal(text: str) -> None:
    assert converted(code(text), "html") == f"<p><code>{html.escape(text, quote=False)}</code></p>\n"


@pytest.mark.parametrize(
    "template",
    [
        "{{ results.x | markdown }}",
        "{{ [results.x] | map('markdown') | first }}",
        "{{ ('a' ~ results.x) | markdown }}",
        "{% filter markdown %}{{ results.x }}{% endfilter %}",
    ],
)
def test_a_template_can_not_declare_text_to_be_markup(tmp_path: Path, template: str) -> None:
    (tmp_path / "template.md").write_text(template, encoding="utf-8")
    with pytest.raises(jinja2.TemplateSyntaxError, match="only words of the template"):
        fill(tmp_path / "template.md", {"x": "*y*"}, {}, {})


def test_words_of_a_template_can_be_markup(tmp_path: Path) -> None:
    (tmp_path / "template.md").write_text("{{ '$x$' | markdown }} {{ '$x$' }} {{ results.x }}", encoding="utf-8")
    assert fill(tmp_path / "template.md", {"x": "*y*"}, {}, {}) == "$x$ \\$x\\$ \\*y\\*"


def test_only_literals_of_the_source_are_markup() -> None:
    """No caption or filter wraps anything but its own words: a name in an f-string would be markup."""
    wrong = [
        f"{path.name}:{node.lineno}"
        for path in (ROOT / "studies").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Markdown"
        and not all(isinstance(argument, ast.Constant) for argument in node.args)
    ]
    assert wrong == []


@pytest.mark.parametrize(
    ("markdown", "message"),
    [
        ("![x](figures/other.svg)", "the image figures/other.svg"),
        ("![x](http://payload.invalid/a.png)", "the image http"),
        ("[x](javascript:alert)", "a link to javascript"),
        ("[x](https://payload.invalid)", "a link to https"),
        ("[x]{onclick=a}", "the attribute onclick"),
        ("[x]{.y}", "the class y"),
    ],
)
def test_what_is_not_of_the_report_is_refused_even_as_markup(tmp_path: Path, markdown: str, message: str) -> None:
    page = f"---\ntitle: a\nquestion: b\n---\n\n::: {{.summary}}\nx\n:::\n\n{markdown}\n"
    for convert in (lambda: pages.write_html(page, tmp_path), lambda: pages.to_typst(page)):
        with pytest.raises(pages.PageError, match=message):
            convert()


@pytest.mark.parametrize("source", ['#include "x.typ"', '#import "@preview/a:1.0.0"', '#read("/etc/passwd")'])
def test_the_pdf_reaches_for_no_file(tmp_path: Path, source: str) -> None:
    with pytest.raises(pages.PageError, match="reaches for a file"):
        pages.write_pdf(source, tmp_path)


def test_text_in_figures_is_literal(tmp_path: Path) -> None:
    """A dollar of the results is drawn as a dollar, and a name that begins with '_' is in the legend."""
    names: dict[str, Any] = {"names": ["$x^2$", "$\\frac{1$", "_hidden", "a\nb"], "numbers": [1.0, 2], "_key": "x"}
    seen: list[str] = []

    def draw(results: Mapping[str, Any]) -> Figure:
        figure, axes = style.subplots()
        for name in results["names"]:
            axes[0, 0].plot(results["numbers"], label=name)
        legend = axes[0, 0].legend()
        figure.draw_without_rendering()
        seen.extend(text.get_text() for text in legend.get_texts())
        assert not any(text._preprocess_math(text.get_text())[1] for text in legend.get_texts())
        assert [text._preprocess_math(text.get_text())[0] for text in legend.get_texts()][:2] == names["names"][:2]
        return figure

    style.save(draw, for_figure(names), tmp_path / "a.svg")
    assert seen == [r"\$x^2\$", r"\$\frac{1\$", "\u200b_hidden", "a b"]
    assert (tmp_path / "a.svg").stat().st_size > 1000
