"""Whether the stated controller made the motion records: what is identified by replaying another one is not right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from diagnosis.where.controller import Replayed, replayed
from models.machine import Machine
from models.quantity import show
from models.records.checks import is_at_rate
from models.records.files import Loaded
from models.records.record import Record
from studies.study import Check

CHECK: Final = "motion records whose commands the stated controller does not make"


def judged(machine: Machine, records: Sequence[tuple[str, Loaded]]) -> tuple[list[tuple[str, str]], list[Check]]:
    """Motion records that another controller made, or whose columns are shifted, each with what is to be said of it,
    and the check of them.

    records: each with its kind. Other kinds are identified without the controller, and are not judged; nor are logs
    without all of its samples, on which it can't be replayed.
    """
    found = [
        (one.name, replayed(machine, one.content))
        for kind, one in records
        if kind == "motion"
        and isinstance(one.content, Record)
        and {"reference", "target"} & set(one.given)
        and is_at_rate(one.content, machine.sample_time)
    ]
    if not found:
        return [], []
    wrong = [(name, replay) for name, replay in found if not replay.replays]
    names = ", ".join(name for name, _ in found)
    check = Check(CHECK, float(len(wrong)), "1", 0.0, f"its replay on reference and position of {names}")
    return [(name, _said(replay)) for name, replay in wrong], [check]


def _said(replay: Replayed) -> str:
    fits = f"; with {replay.remedy}, {show(replay.remains, 'N', 2)} (rms) would remain" if replay.remedy else ""
    return (
        f"the logged command is not what the stated controller makes of reference and position; they differ by "
        f"{show(replay.rms, 'N', 2)} (root mean square){fits}. Another controller made the record, or a column is "
        "shifted; what is identified from it is not to be trusted before the machine file's [control] or the columns "
        "are right."
    )
