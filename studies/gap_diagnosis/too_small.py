"""Which names the verdict has, although nearly nothing would be lost without them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from models.quantity import listed, show
from studies.wording import effect, words

Results = Mapping[str, Any]

MAX_IDLE_SHARE: Final = 0.01  # of what is closed, up to which a name closes nearly nothing


def too_small(results: Results) -> list[str]:
    """What is said of names beside others that close nearly nothing, in sizes that these records would not show by
    themselves: they may be what the others' laws leave. None without any."""
    names, shares = results["verdict"]["effects"], results["how_far"].get("shares", {})
    limits = {row["effect"]: row for row in results["confusability"]["limits"]}
    sizes = {row["effect"]: row["parameters"] for row in results["which"]}
    told = []
    for name in names if len(names) > 1 else ():
        limit, fitted = limits.get(name), sizes.get(name, {})
        if limit is None or limit["parameter"] not in fitted or shares.get(name, 1.0) > MAX_IDLE_SHARE:
            continue
        size, least = abs(fitted[limit["parameter"]]["value"]), limit["limit"]
        if least is not None and size < least < math.inf:
            now, shows = (show(number, limit["unit"], 3) for number in (size, least))
            told.append(f"{effect(name)} ({words(limit['parameter'])} {now}, where {shows} would show)")
    if not told:
        return []
    it, closes = ("It", "closes") if len(told) == 1 else ("They", "close")
    laws = f"{it} may be what the laws of the other names leave, and {closes} nearly nothing of the gap"
    return [f"Not sure, though named: {listed(told)}. {laws}."]
