"""Two designs side by side: what differs in the machine, the checks that turned, the figures laid over each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure as Drawing

from reports.markup import NUMBER, unlinked
from reports.overlay import lay_over
from reports.report import Figure, Report, select
from studies.catalogue import find
from studies.review.differences import differences, short
from studies.wording import filters, powers, quantity

LARGEST_LIST = 40  # numbers of the results that are listed; the others are counted


def compare(before: Any, after: Any) -> dict[str, Any]:
    """What changed from one results.json to another of the same study; plain data, SI."""
    checks_after = {check["name"]: check for check in after["checks"]}
    rows = []
    for check in before["checks"]:
        other = checks_after.pop(check["name"], None)
        turned = other is not None and other["holds"] is not check["holds"]
        rows.append({"name": check["name"], "unit": check["unit"], "before": check, "after": other, "turned": turned})
    rows += [
        {"name": check["name"], "unit": check["unit"], "before": None, "after": check, "turned": False}
        for check in checks_after.values()
    ]
    scalars = [one for one in differences(before["results"], after["results"]) if "[" not in one.where]
    return {
        "study": before["study"],
        "machines": [before["machine"]["name"], after["machine"]["name"]],
        "machine": [_listed(one) for one in differences(before["machine"], after["machine"])],
        "checks": rows,
        "numbers": [_listed(one) for one in scalars[:LARGEST_LIST]],
        "more_numbers": max(len(scalars) - LARGEST_LIST, 0),
        "before": before,
        "after": after,
    }


def tell(content: Mapping[str, Any]) -> Report:
    """The change as a report, with every figure that both results can be drawn to."""
    study = find(content["study"])
    assert study is not None
    after = study.report(content["after"])
    figures = tuple(_overlaid(figure) for figure in after.figures if _drawn(figure, content))
    title = f"Change: {study.name.replace('_', ' ')}"
    question = "What changes from one design to the other?"
    own: dict[str, Callable[..., Any]] = {"verdict_of": _verdict, "limits": _limits, "told": _told}
    words = {**filters(), **own}
    return Report(title, question, Path(__file__).parent / "report.md", figures, words, wording=after.wording)


def _listed(one: Any) -> dict[str, Any]:
    return {"where": one.where, "before": short(one.before), "after": short(one.after), "relative": one.relative}


def _verdict(check: Mapping[str, Any] | None) -> str:
    if check is None:
        return "–"
    mark = "✓" if check["holds"] else "✗ MISSED"
    return f"{mark} {quantity(check['value'], check['unit'])}"


def _limits(row: Mapping[str, Any]) -> str:
    """A check's limit, or those before and after where it moved."""
    known = [quantity(one["limit"], row["unit"]) for one in (row["before"], row["after"]) if one]
    return " → ".join(dict.fromkeys(known))


def _told(text: str) -> str:
    """What stands at a place; a number with its power of ten as a page has it."""
    return powers(text) if NUMBER.fullmatch(text) else text


def _drawn(figure: Figure, content: Mapping[str, Any]) -> bool:
    """Whether both results have what the figure is drawn from."""
    try:
        select(content["before"], figure)
        select(content["after"], figure)
    except KeyError:
        return False
    return True


def _overlaid(figure: Figure) -> Figure:
    """The figure drawn from the results after, with what those before give in grey beneath."""

    def draw(whole: Mapping[str, Any]) -> Drawing:
        return lay_over(figure.draw(whole["after"]), figure.draw(whole["before"]))

    keys = tuple(f"{side}.{key}" for side in ("before", "after") for key in figure.keys)
    # What the study's own report refers to beside its figures is not in this one.
    caption = unlinked(figure.caption, "the study's own table") + " Grey: before; coloured: after."
    return Figure(figure.name, caption, keys, draw)
