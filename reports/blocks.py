"""Block diagrams as figures: boxes, sums and arrows on a sheet measured in millimetres, in the reports' style."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from reports.style import BLACK, TEXT_WIDTH

LINE: Final = 0.9  # points
SUM: Final = 2.2  # mm, the radius of a circle in which signals are added
ARROW_HEAD_MM: Final = (2.2, 0.8)  # mm, length and half width of an arrow's head
LETTERS: Final = 7.5  # points

Point = tuple[float, float]


class Sheet:
    """A figure of the text's width and a height [mm] with one drawing on it; x to the right, y upwards, in mm."""

    def __init__(self, height: float) -> None:
        self.figure = Figure(figsize=(TEXT_WIDTH / 25.4, height / 25.4))
        self.axes: Axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set(xlim=(0, TEXT_WIDTH), ylim=(0, height))
        self.axes.axis("off")

    def box(
        self, at: Point, text: str, size: Point = (18.0, 9.0), *, face: str = "#f2f5f8", dashed: bool = False
    ) -> None:
        """A block around its centre; `size` is its width and height [mm]."""
        corner = at[0] - size[0] / 2, at[1] - size[1] / 2
        shape = FancyBboxPatch(corner, *size, boxstyle="round,pad=0,rounding_size=0.8", facecolor=face, edgecolor=BLACK)
        shape.set(linewidth=LINE, linestyle=(0, (4, 2)) if dashed else "-")
        self.axes.add_patch(shape)
        self.text(at, text)

    def sum(self, at: Point, signs: Sequence[tuple[str, Point]] = ()) -> None:
        """A circle in which signals are added; signs: each at its offset [mm] from the centre."""
        self.axes.add_patch(Circle(at, SUM, facecolor="white", edgecolor=BLACK, linewidth=LINE, zorder=3))
        for sign, offset in signs:
            self.text((at[0] + offset[0], at[1] + offset[1]), sign)

    def dot(self, at: Point) -> None:
        """Where a signal branches."""
        self.axes.add_patch(Circle(at, 0.6, facecolor=BLACK, edgecolor=BLACK, zorder=3))

    def line(self, *points: Point, width: float = LINE, dashed: bool = False) -> None:
        """A line through points [mm]."""
        x, y = zip(*points, strict=True)
        self.axes.plot(x, y, color=BLACK, linewidth=width, linestyle=(0, (4, 2)) if dashed else "-", zorder=1)

    def arrow(self, *points: Point, text: str = "", at: Point | None = None) -> None:
        """A line through points [mm] that ends in an arrow's head, with its signal's name at a place beside it."""
        self.line(*points)
        (x0, y0), (x1, y1) = points[-2:]
        length = max(((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5, 1e-9)
        dx, dy = (x1 - x0) / length, (y1 - y0) / length
        back = x1 - ARROW_HEAD_MM[0] * dx, y1 - ARROW_HEAD_MM[0] * dy
        side = ARROW_HEAD_MM[1] * dy, -ARROW_HEAD_MM[1] * dx
        corners = [(x1, y1), (back[0] + side[0], back[1] + side[1]), (back[0] - side[0], back[1] - side[1])]
        self.axes.add_patch(Polygon(corners, closed=True, facecolor=BLACK, edgecolor="none", zorder=4))
        if text and at is not None:
            self.text(at, text)

    def text(self, at: Point, text: str, **look: Any) -> None:
        """Words or a formula around a place [mm]."""
        self.axes.text(*at, text, **{"ha": "center", "va": "center", "fontsize": LETTERS, "zorder": 5, **look})

    def spring(self, start: Point, length: float) -> None:
        """A spring to the right over a length [mm]."""
        x, y = start
        turns = [(x + length * (0.2 + 0.6 * i / 8), y + (1.6 if i % 2 else -1.6)) for i in range(9)]
        self.line(start, (x + 0.2 * length, y), *turns[1:-1], (x + 0.8 * length, y), (x + length, y))

    def damper(self, start: Point, length: float) -> None:
        """A damper to the right over a length [mm]."""
        x, y = start
        middle = x + 0.5 * length
        self.line(start, (middle, y))
        self.line((middle, y - 1.4), (middle, y + 1.4))
        self.line((middle - 2, y + 2.2), (middle + 2.5, y + 2.2), (middle + 2.5, y - 2.2), (middle - 2, y - 2.2))
        self.line((middle + 2.5, y), (x + length, y))
