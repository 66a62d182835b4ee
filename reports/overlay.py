"""One drawing laid over another: what an earlier one shows stands in grey beneath the later one.

Lines, markers, bars, bands and filled shapes are carried over, limits only where they moved. What can't be carried over
without hiding the later drawing, such as an image, is said in the drawing itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Transform

from reports import style

UNIT: Final = re.compile(r"\[([^\]]+)\]$")
BENEATH: Final = 0.9  # order of drawing: above the grid and specifications, below the later drawing's lines
BAND: Final[dict[str, Any]] = {"facecolor": "#9a9a9a", "edgecolor": style.LIMIT, "alpha": 0.3, "linewidth": 0.4}
OUTLINE: Final[dict[str, Any]] = {"facecolor": "none", "edgecolor": style.LIMIT, "linewidth": 0.9}
STROKE: Final[dict[str, Any]] = {"color": style.LIMIT, "alpha": 0.5, "linewidth": 0.8}


def lay_over(after: Figure, before: Figure) -> Figure:
    """`after` with what `before` shows beneath it in grey, axes by axes in their order; returns `after`."""
    for axes, earlier in zip(after.axes, before.axes, strict=False):
        missing = _carry_over(axes, earlier) if _units(axes) == _units(earlier) else ["it has other units"]
        if missing:
            _say(axes, f"before: not drawn ({', '.join(missing)})")
        axes.autoscale_view()
    if len(after.axes) != len(before.axes) and after.axes:
        _say(after.axes[-1], f"before: {len(before.axes)} panels, here {len(after.axes)}")
    return after


def _units(axes: Axes) -> list[set[str]]:
    """The units of both axes, which may stand at another panel that shares the axis."""
    across = [one.get_xlabel() for one in axes.get_shared_x_axes().get_siblings(axes)]
    up = [one.get_ylabel() for one in axes.get_shared_y_axes().get_siblings(axes)]
    return [{unit for label in labels for unit in UNIT.findall(label)} for labels in (across, up)]


def _carry_over(axes: Axes, earlier: Axes) -> list[str]:
    """Draws each of the earlier axes' artists beneath; the kinds of those that can't be."""
    missing = [type(image).__name__ for image in earlier.images]
    drawn = list(axes.lines)
    for line in list(earlier.lines):
        place = _place(line, axes, earlier)
        if place is not None and (place == axes.transData or not _among(line, drawn)):
            _line(axes, line, place)
    for patch in list(earlier.patches):
        place = _place(patch, axes, earlier)
        shape = patch.get_patch_transform().transform_path(patch.get_path())
        if place is not None and (place == axes.transData or not _is_there(shape, axes)):
            _patch(axes, shape, place, OUTLINE)
    missing += [type(one).__name__ for one in list(earlier.collections) if not _collection(axes, one)]
    return sorted(set(missing))


def _line(axes: Axes, line: Line2D, place: Transform) -> None:
    look: dict[str, Any] = {**STROKE, "linestyle": "-", "zorder": BENEATH, "drawstyle": line.get_drawstyle()}
    if place != axes.transData:  # a limit that moved: dashed, as limits are
        look["linestyle"] = (0, (4, 2))
    if line.get_linestyle() == "None":
        size = line.get_markersize()
        look |= {"linestyle": "none", "marker": line.get_marker(), "markersize": size, "markerfacecolor": "none"}
    x, y = line.get_data()
    axes.add_line(Line2D(np.asarray(x), np.asarray(y), transform=place, **look))


def _patch(axes: Axes, shape: Path, place: Transform, look: dict[str, Any]) -> None:
    axes.add_patch(PathPatch(shape, transform=place, zorder=BENEATH, **look))


def _collection(axes: Axes, collection: Collection) -> bool:
    """Whether the collection, in the data's coordinates, could be drawn beneath."""
    if isinstance(collection, PathCollection):  # a scatter
        offsets = np.asarray(np.ma.filled(np.ma.asarray(collection.get_offsets(), float), np.nan), float)
        look: dict[str, Any] = {**STROKE, "linestyle": "none", "marker": "o", "markersize": 3.0}
        axes.add_line(Line2D(offsets[:, 0], offsets[:, 1], markerfacecolor="none", zorder=BENEATH, **look))
    elif isinstance(collection, LineCollection):
        axes.add_collection(LineCollection(collection.get_segments(), zorder=BENEATH, **STROKE))
    elif isinstance(collection, PolyCollection):
        for shape in collection.get_paths():
            _patch(axes, shape, axes.transData, BAND)
    else:
        return False
    return True


def _place(artist: Artist, axes: Axes, earlier: Axes) -> Transform | None:
    """In `axes`, the coordinates that the artist has in `earlier`: data, or data along one axis; else None."""
    for own, other in zip(_coordinates(earlier), _coordinates(axes), strict=True):
        if own == (artist.get_data_transform() if isinstance(artist, Patch) else artist.get_transform()):
            return other
    return None


def _coordinates(axes: Axes) -> Iterator[Transform]:
    yield axes.transData
    yield axes.get_yaxis_transform(which="grid")
    yield axes.get_xaxis_transform(which="grid")


def _among(line: Line2D, lines: list[Line2D]) -> bool:
    return any(np.array_equal(line.get_xydata(), other.get_xydata()) for other in lines)


def _is_there(shape: Path, axes: Axes) -> bool:
    shapes = (patch.get_patch_transform().transform_path(patch.get_path()) for patch in axes.patches)
    return any(np.array_equal(shape.vertices, other.vertices) for other in shapes)


def _say(axes: Axes, words: str) -> None:
    axes.text(0.01, 0.01, words, transform=axes.transAxes, fontsize=6.5, color="#333333", va="bottom")
