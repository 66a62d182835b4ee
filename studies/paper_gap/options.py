"""Options of paper_gap besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import Options, path, quantity, whole


@dataclass(frozen=True, kw_only=True)
class PaperOptions(Options):
    """The tables to simulate, and the tolerance of the paper's pattern."""

    tables: int | None = whole(
        "N",
        "number of tables of the set, spread over it, to simulate with the effects; the time grows with it "
        "(default: all there are, 60; quick: 3)",
        1,
    )
    margin: float = quantity(
        "m",
        "LENGTH",
        'largest difference of 3 sigma from the published one that still shows the pattern (default: "0.24 um")',
        default=0.24e-6,
        text="0.24 um",
    )
    ensemble: Path | None = path(
        "FILE",
        "the tables of the set (default: models/machines/linear_motor_table_ensemble.toml; only the machine itself "
        "if --machine is given)",
        reviewable=True,
    )
