"""Sets the Markdown of a report as a web page and as a PDF, both by pandoc with the layout next to this file.

Neither reaches anything but the layout and the figures that the report has made: pandoc runs in its sandbox, Typst
sees the report's folder only and no package, and a page with an image, a link or raw markup that is not the report's
own is refused (guard.lua). The web page tells the browser the same by its Content-Security-Policy.
"""

from __future__ import annotations

import base64
import re
import subprocess
from pathlib import Path

import pypandoc
import typst

LAYOUT = Path(__file__).parent
# Raw HTML or TeX would reach only one of the two pages; '@' does not begin a citation here.
MARKDOWN = "-".join(
    (
        "markdown",
        "raw_html",
        "raw_tex",
        "raw_attribute",
        "latex_macros",
        "native_divs",
        "native_spans",
        "markdown_in_html_blocks",
        "citations",
    )
)
COMMON = (
    "--sandbox",
    "--standalone",
    "--wrap=none",
    "--fail-if-warnings",
    "--toc",
    "--number-sections",
    "--syntax-highlighting=none",
    f"--lua-filter={LAYOUT / 'guard.lua'}",
    f"--lua-filter={LAYOUT / 'bars.lua'}",
    f"--lua-filter={LAYOUT / 'numbers.lua'}",
)
# Pandoc's MathML has accents that combine with the letter before them; alone in their box they stand left of it.
# Typst's ways to other files and packages, none of which the layout or pandoc's writer uses.
REACHING = re.compile(r"(?<!\\)#\s*(?:import|include|read|plugin|eval|csv|json|toml|yaml|xml|cbor|bibliography)\b")
IMAGE = re.compile(r'(<img\s[^<>]*?src=")(figures/[\w-]+\.svg)(")')
ACCENTS = {"\u0307": "\u02d9", "\u0308": "\u00a8", "\u0302": "\u02c6", "\u0303": "\u02dc", "\u030c": "\u02c7"}


class PageError(Exception):
    """The Markdown can not be set as a page; the message is the converter's."""


def write_html(markdown: str, folder: Path) -> Path:
    """Writes `folder`/report.html, with the figures below `folder` and the style sheet held inside it."""
    path = folder / "report.html"
    sheets = "".join((LAYOUT / name).read_text(encoding="utf-8") for name in ("page.css", "media.css"))
    style = re.sub(r"/\*.*?\*/\s*", "", sheets, flags=re.DOTALL)
    options = (
        f"--template={LAYOUT / 'page.html'}",
        f"--variable=style:{style}",
        "--mathml",
        "--shift-heading-level-by=1",
        "--toc-depth=3",
    )
    page = IMAGE.sub(lambda image: _embedded(image, folder), _pandoc(markdown, "html5", options))
    for combining, alone in ACCENTS.items():
        page = page.replace(f'<mo accent="true">{combining}</mo>', f'<mo accent="true">{alone}</mo>')
    path.write_text(page, encoding="utf-8")
    return path


def to_typst(markdown: str) -> str:
    """The Typst source of the PDF; its images are given relative to the report's folder."""
    return _pandoc(markdown, "typst", (f"--template={LAYOUT / 'page.typ'}", "--toc-depth=2"))


def write_pdf(source: str, folder: Path) -> Path:
    """Writes `folder`/report.pdf from the Typst `source`, with the fonts and the date of no machine."""
    path = folder / "report.pdf"
    if reaching := REACHING.search(source):
        raise PageError(f"the PDF's source reaches for a file: {reaching[0]}")
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


def _embedded(image: re.Match[str], folder: Path) -> str:
    """The image with what its file holds in the place of the file's name."""
    data = base64.b64encode((folder / image[2]).read_bytes()).decode("ascii")
    return f"{image[1]}data:image/svg+xml;base64,{data}{image[3]}"


def _pandoc(markdown: str, to: str, options: tuple[str, ...]) -> str:
    # pypandoc would log the warnings instead of failing with them; it only says where its pandoc is.
    command = [pypandoc.get_pandoc_path(), f"--from={MARKDOWN}", f"--to={to}", *COMMON, *options]
    run = subprocess.run(command, input=markdown, capture_output=True, encoding="utf-8", check=False)
    if run.returncode or run.stderr:
        raise PageError(run.stderr.strip() or f"pandoc ended with {run.returncode}")
    return run.stdout
