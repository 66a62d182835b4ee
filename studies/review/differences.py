"""Two results, number by number."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Difference:
    """One place at which two results differ: its dotted name, what stands there, the relative difference if any."""

    where: str
    before: Any
    after: Any
    relative: float | None

    def __str__(self) -> str:
        size = "" if self.relative is None else f" (relative difference {self.relative:.2g})"
        return f"{self.where}: {short(self.before)} before, {short(self.after)} now{size}"


def differences(before: Any, after: Any, where: str = "") -> Iterator[Difference]:
    """Every place at which two JSON contents differ, in the order of the first, however little."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        for key in [*before, *(key for key in after if key not in before)]:
            place = f"{where}.{key}" if where else str(key)
            if key not in before or key not in after:
                yield Difference(place, before.get(key, "absent"), after.get(key, "absent"), None)
            else:
                yield from differences(before[key], after[key], place)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for i, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{where}[{i}]")
    elif before != after or isinstance(before, bool) != isinstance(after, bool):
        yield Difference(where, before, after, _relative(before, after))


def _relative(before: Any, after: Any) -> float | None:
    if any(isinstance(one, bool) or not isinstance(one, int | float) for one in (before, after)):
        return None
    try:
        relative = float(abs(after - before) / max(abs(before), abs(after)))
    except OverflowError:
        return None
    return relative if math.isfinite(relative) else None


def short(item: Any) -> str:
    """What stands at a place, in sixty letters at most; a number (SI) to ten digits, of lists and the like the size."""
    if isinstance(item, Mapping | list):
        return f"{len(item)} {'value' if len(item) == 1 else 'values'}"
    text = "none" if item is None else f"{item:.10g}" if isinstance(item, float) else str(item)
    return text if len(text) <= 60 else text[:57] + "..."
