"""What the measured rows say: targets reached or missed, the table, and the work-precision figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from matplotlib.figure import Figure

from reports import style
from tests.benchmark.rows import BATCHED, HOT, PLAIN, SCIPY, SIMULATOR, SLOW, TWIN, Row

HOT_LIMIT: Final = 1.3  # of the C twin's time
BATCH_LIMIT: Final = 0.5  # of a single trajectory's
FACTOR: Final = 100.0  # over what one would use instead, at equal or smaller error


@dataclass(frozen=True)
class Target:
    """A statement on the rows; value None: it could not be measured."""

    name: str
    value: float | None
    limit: float
    at_most: bool
    detail: str = ""

    @property
    def reached(self) -> bool | None:
        """Whether the statement holds; None if it was not measured."""
        if self.value is None:
            return None
        return self.value <= self.limit if self.at_most else self.value >= self.limit


def targets(rows: Sequence[Row]) -> tuple[Target, ...]:
    """The targets of the project, judged by these rows."""
    hot, batch = _find(rows, HOT), _find(rows, BATCHED)
    twin = next((row for row in rows if row.family == TWIN), None)
    against_c = None if twin is None else hot.ratio / twin.ratio
    return (
        Target("hot loop against the C twin", against_c, HOT_LIMIT, at_most=True),
        Target("batch against a single trajectory, each", batch.ratio, BATCH_LIMIT, at_most=True),
        *(_faster(rows, row) for row in rows if row.family in SLOW),
    )


def _faster(rows: Sequence[Row], slow: Row) -> Target:
    """How many times faster the fastest simulator is that is at least as exact."""
    exact = [row for row in rows if row.family == SIMULATOR and row.error <= slow.error]
    best = min(exact, key=lambda row: row.ratio, default=None)
    factor = 0.0 if best is None else slow.ratio / best.ratio
    detail = "no number of substeps here is as exact" if best is None else f"by {best.label}"
    return Target(f"times faster than {slow.name}", factor, FACTOR, at_most=False, detail=detail)


def table(rows: Sequence[Row], duration: float, skipped: str | None) -> str:
    """The rows as text, `duration` [s] the whole job's; `skipped` says why there is no C twin."""
    head = ("", "per simulated s", f"per job of {duration:g} s", "time ratio", "error", "")
    lines = [head]
    for row in rows:
        job = row.per_second * duration
        lines.append(
            (row.name, _time(row.per_second), _time(job), f"{row.ratio:.3g}", f"{row.error * 1e9:.2g} nm", row.note)
        )
    if skipped is not None:
        lines.append((TWIN, "skipped", "", "", "", skipped))
    widths = [max(len(line[i]) for line in lines) for i in range(5)]
    text = [
        f"{line[0]:<{widths[0]}}  " + "  ".join(f"{line[i]:>{widths[i]}}" for i in range(1, 5)) + f"  {line[5]}"
        for line in lines
    ]
    return "\n".join(line.rstrip() for line in text)


def verdicts(judged: Sequence[Target]) -> str:
    """The targets as text, one a line."""
    lines = []
    for one in judged:
        word = {True: "reached", False: "MISSED", None: "not measured"}[one.reached]
        value = (
            "" if one.value is None else f"{one.value:.3g} ({'at most' if one.at_most else 'at least'} {one.limit:g})"
        )
        lines.append(f"{word:<12}  {one.name}: {value} {one.detail}".rstrip(" :"))
    return "\n".join(lines)


def draw(results: Mapping[str, Any]) -> Figure:
    """Error against time per simulated second, from the rows of benchmark.json."""
    figure, axes = style.subplots(1, 1, 95.0)
    ax = axes[0, 0]
    families: dict[str, list[Mapping[str, Any]]] = {}
    for row in results["rows"]:
        families.setdefault(row["family"], []).append(row)
    for i, (family, points) in enumerate(families.items()):
        colour = style.COLOURS[i % len(style.COLOURS)]
        x = [point["seconds_per_simulated_second"] for point in points]
        y = [point["error_m"] for point in points]
        marker = style.MARKERS[i % len(style.MARKERS)]
        filled = colour if i < len(style.COLOURS) else "none"
        ax.plot(x, y, marker, color=colour, markerfacecolor=filled, label=family)
        if family == SIMULATOR:
            ax.plot(x, y, "-", color=colour, linewidth=0.8)
        side = -1 if family in (PLAIN, SCIPY) else 1  # their neighbours to the right have labels of their own
        for point, across, up in zip(points, x, y, strict=True):
            ax.annotate(
                point["label"],
                (across, up),
                xytext=(4 * side, 3),
                textcoords="offset points",
                ha="right" if side < 0 else "left",
                fontsize=6,
                color=colour,
            )
    ax.set(xscale="log", yscale="log", xlabel="time per simulated second [s]", ylabel="largest error of x [m]")
    ax.set_xlim(right=5 * ax.get_xlim()[1])  # room for the labels of the slowest
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def _find(rows: Sequence[Row], family: str) -> Row:
    return next(row for row in rows if row.family == family)


def _time(seconds: float) -> str:
    """A duration with its unit."""
    if not math.isfinite(seconds):
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} us"
