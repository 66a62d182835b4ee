"""Reports are whole, the same on every run, and refuse what does not fit together."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import jinja2
import pytest
from matplotlib.figure import Figure as Drawing

from models.quantity import turned
from reports import pages, style
from reports.markup import Markdown
from reports.report import Figure, Report, render
from reports.text import fill, head
from tests.reports import demo

ROOT = Path(__file__).parents[2]
RENDER = """
import sys
from pathlib import Path
from reports.markup import Markdown
from reports.report import render
from tests.reports import demo
render(demo.report(), demo.results(), Path(sys.argv[1]))
"""
NAMES = ("contributions", "loop", "runs", "step")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report")
    render(demo.report(), demo.results(), path)
    return path


@pytest.fixture(scope="module")
def html(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def told(tmp_path: Path, markdown: str, *figures: Figure) -> Report:
    """A report with the template `markdown`, opened by a summary."""
    template = tmp_path / "template.md"
    template.write_text(f"::: {{.summary}}\nAnswer.\n:::\n\n{markdown}\n", encoding="utf-8")
    return replace(demo.report(template), figures=figures)


def figure(name: str = "loop", keys: tuple[str, ...] = ("loop",)) -> Figure:
    return Figure(name, "Caption.", keys, demo.draw_loop)


def html_of(tmp_path: Path, markdown: str) -> str:
    """The web page of a report without figures."""
    render(told(tmp_path, markdown), {}, tmp_path)
    return (tmp_path / "report.html").read_text(encoding="utf-8")


def test_returns_the_written_paths_sorted(tmp_path: Path) -> None:
    lines: list[str] = []
    paths = render(demo.report(), demo.results(), tmp_path, progress=lines.append)
    assert [str(path.relative_to(tmp_path)) for path in paths] == [
        *(f"figures/{name}.svg" for name in NAMES),
        "report.html",
        "report.pdf",
    ]
    assert set(paths) == {path for path in tmp_path.rglob("*") if path.is_file()}
    assert {line for line in lines if line.startswith("drawing")} <= {f"drawing {name}" for name in NAMES}
    assert lines[-1] == "setting report.html and report.pdf"


def test_figures_drawn_by_a_second_process_are_those_of_one(
    tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("reports.report._begin", lambda *_: None)
    for path in render(demo.report(), demo.results(), tmp_path):
        assert path.read_bytes() == (folder / path.relative_to(tmp_path)).read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="no second process draws on other systems")
def test_what_is_wrong_with_a_figure_of_the_second_process_is_raised_here(tmp_path: Path) -> None:
    figures = (figure(), replace(figure("other"), keys=("loop.frequency_Hz", "loop.phase_deg")))
    report = told(tmp_path, "{{ figure('loop') }} {{ figure('other') }}", *figures)
    with pytest.raises(KeyError, match="'other' reads 'magnitude'"):
        render(report, demo.results(), tmp_path)


def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    folders = [tmp_path / "first", tmp_path / "in" / "second"]
    for folder, seed in zip(folders, ("1", "2"), strict=True):
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT), "HOME": str(tmp_path), "TZ": f"UTC-{seed}"}
        subprocess.run([sys.executable, "-c", RENDER, str(folder)], check=True, env=environment, cwd=ROOT)
    first, second = ({path.relative_to(f): path.read_bytes() for path in f.rglob("*.*")} for f in folders)
    assert len(first) == len(NAMES) + 2
    assert [str(path) for path in first if first[path] != second[path]] == []
    assert first.keys() == second.keys()


def test_web_page_needs_no_other_file(html: str) -> None:
    without_namespaces = re.sub(r'xmlns="[^"]*"', "", html)
    assert re.findall(r"(?i)https?:", without_namespaces) == []
    assert "<script" not in html.lower()
    targets = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert len(targets) > len(NAMES)
    assert [target[:40] for target in targets if not target.startswith(("#", "data:"))] == []
    assert "url(" not in html
    assert "<style" in html
    assert 'name="viewport"' in html


def test_every_figure_is_there_once_with_number_and_caption(html: str) -> None:
    pattern = r'<figure id="fig:(\w+)">\s*<img.*?<figcaption[^>]*>\s*<strong>(.*?)</strong>'
    captions = re.findall(pattern, html, re.DOTALL)
    assert captions == [
        ("step", "Figure\u00a01."),
        ("loop", "Figure\u00a02."),
        ("contributions", "Figure\u00a03."),
        ("runs", "Figure\u00a04."),
    ]
    assert html.count("data:image/svg+xml") == len(NAMES)
    assert "Error budget" in html


def test_references_get_the_numbers_of_what_they_name(html: str) -> None:
    links = dict(re.findall(r'<a href="#([\w:]+)">(\w+\u00a0[\d.]+)</a>', html))
    assert links["fig:loop"] == "Figure\u00a02"
    assert links["tbl:variants"] == "Table\u00a01"
    assert links["eq:motion"] == "Equation\u00a01"
    assert links["sec:checks"] == "Section\u00a02"
    assert re.findall(r'class="number">\((\d)\)', html) == ["1", "2", "3"]


def test_verdicts_are_told_in_words(html: str) -> None:
    runs = demo.results()["runs"]
    missed = sum(not run["holds"] for run in runs) + 1
    assert len(re.findall(r"✗\s+MISSED", html)) == missed
    assert len(re.findall(r"✓\s+holds", html)) == len(runs) + 3 - missed


def test_a_table_of_the_summary_has_the_width_that_its_box_leaves(tmp_path: Path) -> None:
    """Else its last column is too narrow, and the frame of a verdict goes through its letters."""
    prose = "a sentence that is long enough to be broken over several lines of a table " * 3
    table = f"| Check | Verdict |\n|:--|:--|\n| {prose} | {{{{ False | verdict }}}} |\n"
    told_of = told(tmp_path, table + "\nTable: Below. {#tbl:below}")
    told_of.template.write_text(f"::: {{.summary}}\n{table}:::\n\n{table}\nTable: Below. {{#tbl:below}}\n", "utf-8")
    source = pages.to_typst(head("Title", "Question", []) + fill(told_of.template, {}, {}, {}))
    narrow, wide = (
        float(re.findall(r"[\d.]+(?=%)", columns)[-1]) for columns in re.findall(r"columns: \(([^)]*%[^)]*)\)", source)
    )
    assert narrow > wide


def test_pdf_opens_and_has_its_pages(folder: Path) -> None:
    pdf = (folder / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    count = re.search(rb"/Type\s*/Pages\b[^>]*/Count (\d+)", pdf)
    assert count is not None
    # Forty rows, four figures and the title do not fit three pages, and need not take six.
    assert 4 <= int(count[1]) <= 5


@pytest.mark.parametrize("name", NAMES)
def test_svg_has_no_date_and_keeps_the_width_of_the_text(folder: Path, name: str) -> None:
    svg = (folder / "figures" / f"{name}.svg").read_text(encoding="utf-8")
    assert "dc:date" not in svg
    assert not re.search(r"20\d\d-\d\d-\d\d", svg)
    width = re.search(r'<svg[^>]*width="([\d.]+)pt"', svg)
    assert width is not None
    assert float(width[1]) == pytest.approx(160.0 / 25.4 * 72.0)


@pytest.mark.parametrize(
    ("formula", "opening", "closing"),
    [
        (r"\|S\|_\infty \le |z|", 2, 2),
        (r"\left|z\right| + \left\|S\right\|", 2, 2),
        (r"\lvert z \rvert + \lVert S \rVert", 2, 2),
        (r"\left\lvert z \right\rvert + \left\lVert S \right\rVert", 2, 2),
        (r"P(a|b)", 1, 0),  # alone, so no bracket: pandoc's writer calls it a prefix
    ],
)
def test_bars_in_pairs_are_brackets(tmp_path: Path, formula: str, opening: int, closing: int) -> None:
    page = html_of(tmp_path, f"${formula}$")
    assert len(re.findall(r'form="prefix">[‖|]<', page)) == opening
    assert len(re.findall(r'form="postfix">[‖|]<', page)) == closing


def test_accents_stand_over_their_letter(tmp_path: Path) -> None:
    page = html_of(tmp_path, r"$\dot x + \ddot x + \hat x$")
    assert re.findall('<mo accent="true">(.)</mo>', page) == ["\u02d9", "\u00a8", "\u02c6"]


def test_words_of_the_summary_come_before_the_contents(html: str) -> None:
    assert html.index("Two of three requirements hold") < html.index("Contents") < html.index("A carriage of mass")


@pytest.mark.parametrize("key", ["loop.damping", "gain", "loop.frequency_Hz.first"])
def test_a_key_that_the_results_do_not_have_is_named(tmp_path: Path, key: str) -> None:
    report = told(tmp_path, "{{ figure('loop') }}", figure(keys=(key,)))
    with pytest.raises(KeyError, match=f"'loop' is drawn from '{re.escape(key)}'"):
        render(report, demo.results(), tmp_path)


def test_a_figure_can_not_read_what_it_does_not_declare(tmp_path: Path) -> None:
    report = told(tmp_path, "{{ figure('loop') }}", figure(keys=("loop.frequency_Hz", "loop.phase_deg")))
    with pytest.raises(KeyError, match="'loop' reads 'magnitude'"):
        render(report, demo.results(), tmp_path)


@pytest.mark.parametrize(
    ("markdown", "message"),
    [
        ("Nothing.", r"does not place .*\['loop'\]"),
        ("{{ figure('loop') }} {{ figure('bode') }}", "places figure 'bode', which"),
        ("{{ figure('loop') }} {{ figure('loop') }}", "places figure 'loop' twice"),
        ("{{ figure('loop') }} {{ none }}", "is None"),
        ("{{ figure('loop') }}\n\n| a | b |\n|---|---|\n| |S| | 2 |\n\nTable: T", "row of a table has 4 cells"),
    ],
)
def test_a_template_that_does_not_fit_is_refused(tmp_path: Path, markdown: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        render(told(tmp_path, markdown, figure()), demo.results(), tmp_path)


def test_two_figures_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"\['loop', 'loop'\]"):
        render(told(tmp_path, "{{ figure('loop') }}", figure(), figure()), demo.results(), tmp_path)


def test_an_undefined_variable_is_named(tmp_path: Path) -> None:
    with pytest.raises(jinja2.UndefinedError, match="settling_ms"):
        render(told(tmp_path, "{{ results.settling_ms }}"), demo.results(), tmp_path)


def test_a_verdict_is_on_a_bool(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="not on 'yes'"):
        render(told(tmp_path, "{{ 'yes' | verdict }}"), {}, tmp_path)


@pytest.mark.parametrize(
    ("markdown", "message"),
    [
        ("[](#fig:none)", "refers to #fig:none"),
        ("| a |\n|---|\n| 1 |", "Table.1 has no caption"),
        (r"$\notacommand{x}$", "notacommand"),
        ("| " + "a | " * 60 + "\n|" + "---|" * 60 + "\n| " + "100.000 | " * 60 + "\n\nTable: T", "60 columns"),
    ],
)
def test_what_can_not_be_set_is_said(tmp_path: Path, markdown: str, message: str) -> None:
    with pytest.raises(pages.PageError, match=message):
        render(told(tmp_path, markdown), {}, tmp_path)


def test_a_caption_that_breaks_its_figure_is_refused(tmp_path: Path) -> None:
    report = told(tmp_path, "{{ figure('loop') }}", replace(figure(), caption=Markdown("One ] too many")))
    with pytest.raises(pages.PageError, match="fig:loop does not come out"):
        render(report, demo.results(), tmp_path)


def test_a_figure_may_stand_within_a_paragraph(tmp_path: Path) -> None:
    report = told(tmp_path, "Before {{ figure('loop') }} and after.", figure())
    render(report, demo.results(), tmp_path)
    assert '<figure id="fig:loop">' in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_sections_without_a_number_are_not_counted(tmp_path: Path) -> None:
    page = html_of(tmp_path, "# One\n\n# Aside {#aside .unnumbered}\n\n# Two {#two}\n\n[](#two), [](#aside)")
    assert dict(re.findall(r'<a href="#(\w+)">([^<]*)</a>', page)) == {"two": "Section\u00a02", "aside": "Aside"}


def test_a_report_opens_with_its_answer(tmp_path: Path) -> None:
    report = told(tmp_path, "Text.")
    report.template.write_text("# Heading\n", encoding="utf-8")
    with pytest.raises(pages.PageError, match="summary"):
        render(report, {}, tmp_path)


def test_title_is_text_and_not_yaml(tmp_path: Path) -> None:
    report = replace(told(tmp_path, "Text."), title='A "stage": #1 & $x^2$ 🙂\n...')
    render(report, {}, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<h1>A "stage": #1 &amp; $x^2$ 🙂 ...</h1>' in page


def test_comments_of_the_template_stay_there(tmp_path: Path) -> None:
    assert "SECRET" not in html_of(tmp_path, "Text <!-- SECRET --> goes on. # {#label}")


def test_the_style_holds_only_while_a_figure_is_drawn(tmp_path: Path) -> None:
    import matplotlib as mpl  # noqa: PLC0415

    seen: list[float] = []

    def draw(results: Mapping[str, Any]) -> Drawing:
        seen.append(mpl.rcParams["lines.linewidth"])
        return demo.draw_loop(results)

    before = dict(mpl.rcParams)
    render(told(tmp_path, "{{ figure('loop') }}", replace(figure(), draw=draw)), demo.results(), tmp_path)
    assert seen == [1.3]
    assert dict(mpl.rcParams) == before


def test_pyplot_is_not_loaded() -> None:
    code = "import sys, reports.report; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0


def test_powers_of_ten_are_letters_that_say_where_the_tick_is(tmp_path: Path) -> None:
    figure, axes = style.subplots()
    axes[0, 0].loglog([1e-4, 3e2], [2.0, 9.0])
    style.save(lambda _: figure, {}, tmp_path / "one.svg")
    told: list[tuple[float, str]] = []
    for axis in (axes[0, 0].xaxis, axes[0, 0].yaxis):
        for minor in (False, True):
            labels = [label.get_text() for label in axis.get_ticklabels(minor=minor)]
            told += [(at, text) for at, text in zip(axis.get_ticklocs(minor=minor), labels, strict=True) if text]
    assert len(told) >= 6
    for at, text in told:
        factor, _, power = text.rpartition("10")
        exponent = int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
        assert float(factor.rstrip("×") or 1) * 10.0**exponent == pytest.approx(at)


def test_units_are_put_into_text_table_and_figure(tmp_path: Path) -> None:
    """As for a rotary axis: one report, other units, in what the template says and in what the figure says."""

    def draw(_: Mapping[str, Any]) -> Drawing:
        drawing, axes = style.subplots()
        axes[0, 0].plot([0, 1], [0, 2], label="at 3 N")
        axes[0, 0].set_ylabel("position [µm]")
        axes[0, 0].legend()
        return drawing

    table = "| Symbol | Unit |\n|:--|:--|\n| stiffness | N/m |\n\nTable: Symbols. {#tbl:symbols}"
    words = f"Within 2 µm.\n\n{table}\n\n{{{{ figure('loop') }}}}"
    report = told(tmp_path, words, Figure("loop", "Over 20 mm.", (), draw))
    render(replace(report, wording=turned), {}, tmp_path)
    page, svg = ((tmp_path / name).read_text(encoding="utf-8") for name in ("report.html", "figures/loop.svg"))
    for wanted in ("Within 2 µrad", "N m/rad", "Over 20 mrad"):
        assert wanted in page
    assert "position [µrad]" in svg
    assert "at 3 N m" in svg
