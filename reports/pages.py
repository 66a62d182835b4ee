"""Sets the Markdown of a report as a web page and as a PDF, both by pandoc with the layout next to this file."""

from __future__ import annotations

import logging
from pathlib import Path

import pypandoc
import typst

LAYOUT = Path(__file__).parent
# Raw HTML or TeX would reach only one of the two pages; '@' is no citation here.
MARKDOWN = "markdown-raw_html-raw_tex-citations"
COMMON = (
    "--standalone",
    "--fail-if-warnings",
    "--toc",
    "--number-sections",
    "--syntax-highlighting=none",
    f"--lua-filter={LAYOUT / 'bars.lua'}",
    f"--lua-filter={LAYOUT / 'numbers.lua'}",
)


class PageError(Exception):
    """The Markdown can not be set as a page; the message is the converter's."""


def write_html(markdown: str, folder: Path) -> Path:
    """Writes `folder`/report.html, with the figures below `folder` and the style sheet held inside it."""
    path = folder / "report.html"
    options = (
        f"--template={LAYOUT / 'page.html'}",
        f"--css={LAYOUT / 'page.css'}",
        "--embed-resources",
        "--mathml",
        "--shift-heading-level-by=1",
        "--toc-depth=3",
        f"--resource-path={folder}",
    )
    path.write_text(_pandoc(markdown, "html5", options), encoding="utf-8")
    return path


def to_typst(markdown: str) -> str:
    """The Typst source of the PDF; its images are given relative to the report's folder."""
    return _pandoc(markdown, "typst", (f"--template={LAYOUT / 'page.typ'}", "--toc-depth=2"))


def write_pdf(source: str, folder: Path) -> Path:
    """Writes `folder`/report.pdf from the Typst `source`, with the fonts and the date of no machine."""
    path = folder / "report.pdf"
    compiler = typst.Compiler(source.encode(), root=folder, ignore_system_fonts=True)
    try:
        pdf, warnings = compiler.compile_with_warnings(format="pdf", timestamp=0)
    except typst.TypstError as error:
        raise PageError(error.diagnostic) from error
    if warnings:
        raise PageError("\n".join(warning.diagnostic for warning in warnings))
    if not isinstance(pdf, bytes):
        raise PageError(f"expected one PDF, got {type(pdf)}")
    path.write_bytes(pdf)
    return path


def _pandoc(markdown: str, to: str, options: tuple[str, ...]) -> str:
    # pypandoc logs what pandoc says and raises it again: once is enough.
    logging.getLogger("pypandoc").setLevel(logging.CRITICAL)
    try:
        return str(pypandoc.convert_text(markdown, to, format=MARKDOWN, extra_args=[*COMMON, *options]))
    except RuntimeError as error:
        raise PageError(str(error)) from error
