"""What is said of a law that was learned, where no effect explains the records; from results.json alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from diagnosis.handover.files import Content
from models.quantity import show
from studies.wording import in_percent

Results = Mapping[str, Any]

CURVE_END_SHARE: Final = 0.5  # of a curve's largest force: where it ends
MIN_SIZED_CLOSURE: Final = 0.5  # on other motions, below which a law that is not handed over is told without a size
MAX_LOCAL_SHARE: Final = 0.3  # of the way or the time that the records show, up to which a law has a place there
OVER: Final = {
    "time": "the time",
    "position": "the position",
    "speed": "the speed",
    "acceleration": "the acceleration",
    "command": "the command",
    "rest": "the time at rest",
    "path": "the path since the last reversal",
}
TURNING: Final = {
    "plain": "the same in both directions",
    "even": "the same for either sign",
    "odd": "turning with its sign",
    "directional": "turning with the direction of motion",
}
IN_PROPORTION: Final = {
    "drag": "a drag, in proportion to the speed, over",
    "thrust": "a part of the thrust over",
}


def has_curve(learned: Results | None) -> bool:
    """Whether there is a curve to show."""
    return learned is not None and "knots" in learned


def is_the_answer(results: Results) -> bool:
    """Whether nothing has a name, and the law that was learned is in the file that is handed over."""
    if results["verdict"]["outcome"] != "none_of_these" or not has_curve(results.get("learned")):
        return False
    return bool(results["how_far"]["adopted_file"] == Content.MEASURED)


def in_words(learned: Results) -> str:
    """What the law is: "a force over the position, the same in both directions"."""
    over, symmetry = OVER[learned["coordinate"]], learned["symmetry"]
    if symmetry in IN_PROPORTION:
        return f"{IN_PROPORTION[symmetry]} {over}"
    return f"a force over {over}, {TURNING[symmetry]}"


def in_short(learned: Results) -> str:
    """What the law is, at the beginning of a sentence that goes on."""
    return f"A{in_words(learned)[1:]}{'' if learned['symmetry'] in IN_PROPORTION else ','}"


def told(learned: Results | None) -> list[str]:
    """The law, how it was judged, and whether improved.toml has it, in a sentence or two; none without one."""
    if learned is None:
        return []
    if not has_curve(learned):
        return [f"No law was learned in its place: {learned['reason']}."]
    largest = max(map(abs, learned["values"]))
    low, high = learned["closure_interval"]
    size = show(largest, learned["values_unit"], 3) if learned["values_unit"] != "1" else in_percent(largest)
    law = f"Learned from the records, it is {in_words(learned)}, of up to {size}{_place(learned)}"
    if learned["adopted"]:
        return [
            f"{law}.",
            f"On types of motion that were not used it closes {100 * learned['closure']:.0f} % "
            f"({100 * low:.0f} to {100 * high:.0f} %) of the gap, and improved.toml has it as [effects.measured].",
        ]
    if learned["closure"] < MIN_SIZED_CLOSURE:
        law = f"{in_short(learned)} was learned from the records"
    return [f"{law}; but {learned['reason']}, so that improved.toml does not have it."]


def _place(learned: Results) -> str:
    """Where a law over position or time lies that is narrow beside the way or the time that the records show; nothing
    elsewhere. It ends where it is half as large, on the straight lines between its knots [m or s]."""
    knots, values = np.array(learned["knots"]), np.array(learned["values"])
    top = int(np.argmax(np.abs(values)))
    size = values * np.sign(values[top])
    if learned["coordinate"] not in {"position", "time"} or not 0 < top < size.size - 1:
        return ""
    ends = []
    for side in (slice(top, None, -1), slice(top, None)):
        least = np.flatnonzero(size[side] < CURVE_END_SHARE * size[top])
        if not least.size:
            return ""
        low, high = (knots[side][least[0] - i] for i in (0, 1))
        under, over = (size[side][least[0] - i] for i in (0, 1))
        ends.append(float(low + (high - low) * (CURVE_END_SHARE * size[top] - under) / (over - under)))
    begin, end = ends
    again = np.any(np.abs(values[(knots < begin) | (knots > end)]) >= CURVE_END_SHARE * size[top])
    if again or end - begin > MAX_LOCAL_SHARE * float(np.ptp(knots)):
        return ""
    unit = learned["unit"]
    place, first, last = (show(where, unit, 3) for where in (float(knots[top]), begin, end))
    return f" at {place}, and more than half of that from {first} to {last}"


def left(far: Results) -> list[str]:
    """What the machine file with the law leaves of motions left out of its fit; nothing where there is none."""
    files = {one["file"]: one["held_out"] for one in far["files"]}
    if Content.MEASURED not in files:
        return []
    gap = files[Content.MEASURED]
    return [
        f"With the measured law {show(gap['force_N'], 'N', 2)} and {show(gap['position_m'], 'm', 2)} of position are "
        "left on motions held out."
    ]
