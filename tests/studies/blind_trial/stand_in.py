"""A diagnosis for tests: it answers at once, depending only on the disabled entries."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from models.machine import Machine
from models.records.record import Record

SLOW = "STAND_IN_SECONDS"


def diagnose(
    machine: Machine,
    records: Sequence[Record],
    *,
    seed: int = 0,
    disabled: Sequence[str] = (),
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, Any]:
    """Names cogging, or abstains where an entry is disabled."""
    del machine, seed, progress
    time.sleep(float(os.environ.get(SLOW, "0")))
    outcome = "none_of_these" if disabled else "attributed"
    return {"outcome": outcome, "size": sum(one.position.size for one in records)}


def to_json(found: dict[str, Any]) -> dict[str, Any]:
    """Under the keys of results.json."""
    named = ["cogging"] if found["outcome"] == "attributed" else []
    return {
        "verdict": {"outcome": found["outcome"], "effects": named, "equivalent": []},
        "where": {"samples": found["size"]},
        "which": [{"effect": "cogging", "probability": 0.75}],
        "how_far": {"closure": 0.5, "closure_interval": [0.4, 0.6]},
    }


def log_call(folder: Path, name: str) -> None:
    """Leaves a trace of a call, for tests that count them."""
    with (folder / "calls").open("a", encoding="utf-8") as stream:
        stream.write(name + "\n")
