"""What is said of a law that was learned, where no effect explains the records; from results.json alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from diagnosis.handover.files import Content
from models.quantity import show

Results = Mapping[str, Any]

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


def has_curve(learned: Results | None) -> bool:
    """Whether there is a curve to show."""
    return learned is not None and "knots" in learned


def told(learned: Results | None) -> list[str]:
    """The law, how it was judged, and whether improved.toml has it, in a sentence or two; none without one."""
    if learned is None:
        return []
    if not has_curve(learned):
        return [f"No law was learned in its place: {learned['reason']}."]
    largest = max(map(abs, learned["values"]))
    low, high = learned["closure_interval"]
    law = (
        f"Learned from the records, it is a force over {OVER[learned['coordinate']]}, "
        f"{TURNING[learned['symmetry']]}, of up to {show(largest, 'N', 3)}"
    )
    if learned["adopted"]:
        return [
            f"{law}.",
            f"On types of motion that were not used it closes {100 * learned['closure']:.0f} % "
            f"({100 * low:.0f} to {100 * high:.0f} %) of the gap, and improved.toml has it as [effects.measured].",
        ]
    return [f"{law}; but {learned['reason']}, so that improved.toml does not have it."]


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
