"""Markup of five languages in every text of every study's results: the report shows it as typed, and nothing else.

The web page and the PDF are set from a quick run's results in which texts are replaced; a browser, where there is one,
then opens one page that holds them all.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from html.parser import HTMLParser
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from design.loop import DIAGRAM
from diagnosis.handover.files import Content
from models.machine import DEFAULT
from reports import pages, text
from reports.markup import visible
from reports.report import Report
from studies.catalogue import every
from studies.command import CHECK_MISSED, DONE, main
from tests.reports.payloads import HOST, PAYLOADS

NAMES = sorted(every())
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
# A text of these keys is never compared with anything, so that it can be anything.
FREE = {"detail", "record", "note", "meaning", "source", "section", "findings", "statements", "remark", "one_line"}
OURS = {
    *Content,
    "3 sigma with compensation: difference to the paper",
    "all members",
    "even steps",
    "end of Region 1 (about)",
    "share of the reversal's delay due to the friction's history",
    DIAGRAM,
}  # names that reports look up, and a drawing in letters, which is set as it is: no user writes them
SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1"/>'
VOID = {"img", "meta", "br", "hr", "col", "input", "link"}


class Page(HTMLParser):
    """The elements of a page with what they hold of attributes that do something, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, tuple[str, ...]]] = []
        self.words: list[str] = []
        self.title = ""
        self._in: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Remembers the element."""
        other = {"alt", "class"}  # a text, and how wide a column of prose is
        said = (f"{name}={(value or '').split(',')[0][:30]}" for name, value in attrs if name not in other)
        self.elements.append((tag, tuple(said)))
        if tag not in VOID:
            self._in.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Leaves the element."""
        if tag in self._in:
            while self._in.pop() != tag:
                pass

    def handle_data(self, data: str) -> None:
        """Remembers the text that is shown."""
        if self._in[-1:] == ["title"]:
            self.title += data
        if "style" not in self._in and "head" not in self._in:
            self.words.append(data)

    @cached_property
    def shown(self) -> str:
        """All text without its blanks, and apostrophes as they are typed; to be asked for once the page is read."""
        return typed("".join(self.words))


def typed(words: str) -> str:
    return re.sub(r"[\s\u2060]", "", words.replace("\u2019", "'"))


def spoiled(value: Any, key: str, payloads: Iterator[str], used: list[str]) -> Any:
    """`value` with a payload behind every text that is a sentence or of a free key."""
    if isinstance(value, dict):
        return {name: spoiled(item, name, payloads, used) for name, item in value.items()}
    if isinstance(value, list):
        return [spoiled(item, key, payloads, used) for item in value]
    if (
        isinstance(value, str)
        and value
        and value not in OURS
        and (key in FREE or (" " in value and key not in {"unit", "sense", "equation", "design"}))
    ):
        used.append(f"{value} {next(payloads)}")
        return used[-1]
    return value


def page_of(name: str, whole: dict[str, Any], folder: Path) -> tuple[str, Report]:
    """The web page and the PDF of a study's results, with empty figures."""
    report = every()[name].report(whole)
    captions = {figure.name: figure.caption for figure in report.figures}
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for figure in captions:
        (folder / "figures" / f"{figure}.svg").write_text(SVG, encoding="utf-8")
    body = text.fill(report.template, whole, captions, report.filters)
    markdown = text.head(report.title, report.question, captions) + body
    pages.write_pdf(pages.to_typst(markdown), folder)
    return pages.write_html(markdown, folder).read_text(encoding="utf-8"), report


@pytest.fixture(scope="module")
def pair(
    quick_run: Callable[[str], tuple[Path, int]],
    once: Callable[[str, Callable[[], Any]], Any],
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str], tuple[Page, str, dict[str, Any]]]:
    """A study's page as it is, and the text of the page and the results with payloads in them; each set once."""

    def spoiled_page(name: str) -> tuple[str, dict[str, Any]]:
        whole = json.loads((quick_run(name)[0] / "results.json").read_text(encoding="utf-8"))
        used: list[str] = []
        worse = spoiled(whole, "", cycle(PAYLOADS), used)
        worse["machine"]["name"] = "".join(PAYLOADS[:-1])
        return page_of(name, worse, tmp_path_factory.mktemp(name))[0], worse

    @cache
    def made(name: str) -> tuple[Page, str, dict[str, Any]]:
        page, worse = once(f"spoiled_{name}", lambda: spoiled_page(name))
        return Page((quick_run(name)[0] / "report.html").read_text(encoding="utf-8")), page, worse

    return made


@pytest.mark.parametrize("name", NAMES)
def test_no_text_of_a_study_changes_what_its_report_is_made_of(
    name: str, pair: Callable[[str], tuple[Page, str, dict[str, Any]]]
) -> None:
    before, page, worse = pair(name)
    after = Page(page)
    assert after.elements == before.elements
    if name not in {"blind_trial", "full_circle"}:  # which are not about one machine
        assert typed(visible(worse["machine"]["name"])) in typed(after.title)
    for parameter in worse["parameters"]:
        assert typed(visible(parameter["meaning"])) in after.shown
        assert typed(visible(parameter["provenance"]["detail"])) in after.shown
        assert typed(visible(parameter["provenance"]["note"])) in after.shown
    for check in worse["checks"] if name != "gap_diagnosis" else ():
        assert typed(visible(check["name"])) in after.shown


def quoted(words: str) -> str:
    """As a string of TOML."""
    return "".join(f"\\U{ord(sign):08x}" if sign < " " or sign in '\\"\x7f\x85' else sign for sign in words)


@pytest.fixture(scope="module")
def typed_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, list[str]]:
    """The web page of a study that ran on hostile files as a user gives them, and the texts that it is to show.

    The machine's name, its sources and notes, those of an effect, and the names of the files are markup.
    """
    folder = tmp_path_factory.mktemp("typed")
    names = [one for one in PAYLOADS if one.isprintable() and "/" not in one and len(one) < 100]
    texts = iter([one for one in PAYLOADS if "\n" not in one and "\ud800" not in one])
    name = "".join((*PAYLOADS[:2], next(one for one in PAYLOADS if "{=html}" in one)))
    machine = DEFAULT.read_text(encoding="utf-8")
    machine += """
[effects.viscous_friction]
coefficient = { value = "20 N s/m", source = "assumed: " }
"""
    shown = []

    def spoil(match: re.Match[str]) -> str:
        payload = next(texts, None)
        if payload is None:
            return match.group()
        shown.append(payload)
        return f'{match.group()[:-1]} {quoted(payload)}"'

    machine = re.sub(r'(?:source|note) = "[^"]*"', spoil, machine)
    machine = re.sub(r'(?m)^name = ".*"', lambda _: f'name = "{quoted(name)}"', machine)
    file = folder / f"{names[0]}{names[1]}.toml"
    file.write_text(machine, encoding="utf-8")
    arguments = ["--quick", "--machine", str(file), "--output", str(folder / "out")]
    assert main(every()["deadbeat_design"], arguments) in {DONE, CHECK_MISSED}
    return (folder / "out" / "report.html").read_text(encoding="utf-8"), [name, *shown]


def test_texts_of_a_users_files_are_shown_as_typed(typed_run: tuple[str, list[str]]) -> None:
    page, shown = typed_run
    after = Page(page)
    for one in shown:
        assert typed(visible(one)) in after.shown + typed(after.title), one


class Proxy(HTTPServer):
    """Notes what a browser asks for and answers nothing."""

    asked: list[str]


class Note(BaseHTTPRequestHandler):
    """One request to the proxy."""

    def do_GET(self) -> None:
        """Notes the address."""
        assert isinstance(self.server, Proxy)
        self.server.asked.append(self.path)
        self.send_error(404)

    do_CONNECT = do_POST = do_HEAD = do_GET  # noqa: N815

    def log_message(self, *_: Any) -> None:
        """Says nothing."""


def opened(page: str, folder: Path) -> tuple[Page, list[str]]:
    """The page as a browser shows it once its scripts have run, and the addresses on HOST that it asked for."""
    assert BROWSER is not None
    path = folder / "page.html"
    path.write_text(page, encoding="utf-8")
    proxy = Proxy(("127.0.0.1", 0), Note)
    proxy.asked = []
    thread = threading.Thread(target=proxy.serve_forever)
    thread.start()
    command = (
        *(BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
        *(f"--user-data-dir={folder / 'profile'}", f"--proxy-server=http://127.0.0.1:{proxy.server_port}"),
        *("--virtual-time-budget=3000", "--dump-dom", path.as_uri()),
    )
    try:
        run = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=120, check=True)
    finally:
        proxy.shutdown()
        thread.join()
        proxy.server_close()
    return Page(run.stdout), [address for address in proxy.asked if HOST in address]


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_a_browser_runs_and_fetches_nothing_and_shows_the_text(
    pair: Callable[[str], tuple[Page, str, dict[str, Any]]], typed_run: tuple[str, list[str]], tmp_path: Path
) -> None:
    """All reports in one page, without the policy that would stop what got in."""
    pages_of_all = [typed_run[0], *(pair(name)[1] for name in NAMES)]
    bodies = [re.findall(r"<body>(.*)</body>", one, re.DOTALL)[0] for one in pages_of_all]
    head = '<!DOCTYPE html><html><head><meta charset="utf-8"><title>still</title></head><body>'
    page, asked = opened(head + "".join(bodies) + "</body></html>", tmp_path)
    assert asked == []
    assert page.title == "still"
    assert not {tag for tag, _ in page.elements} & {
        "script",
        "iframe",
        "embed",
        "object",
        "svg",
        "base",
        "link",
        "style",
    }
    assert not [one for _, said in page.elements for one in said if one.startswith("on") or "javascript" in one]
    kinds = {one.split(":")[0] for tag, said in page.elements for one in said if one.startswith(("src=", "href="))}
    assert {kind[:6] for kind in kinds} == {"src=da", "href=#"}
    for one in typed_run[1]:
        assert typed(visible(one)) in page.shown
    for name in NAMES:
        for parameter in pair(name)[2]["parameters"]:
            assert typed(visible(parameter["provenance"]["detail"])) in page.shown


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_the_policy_of_a_report_stops_what_would_get_in(
    pair: Callable[[str], tuple[Page, str, dict[str, Any]]], tmp_path: Path
) -> None:
    """The same elements as markup: without the policy they run and fetch, with it they do not."""
    policy = re.findall(r'<meta http-equiv="Content-Security-Policy"[^>]*>', pair("deadbeat_design")[1])
    assert len(policy) == 1
    raw = f'<body><script>document.title="ran"</script><img src="http://{HOST}/a.png"></body></html>'
    head = '<!DOCTYPE html><html><head><meta charset="utf-8">{}<title>still</title></head>'
    page, asked = opened(head.format("") + raw, tmp_path)
    assert (page.title, asked) == ("ran", [f"http://{HOST}/a.png"])
    page, asked = opened(head.format(policy[0]) + raw, tmp_path)
    assert (page.title, asked) == ("still", [])
