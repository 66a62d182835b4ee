"""What paper_gap can be asked beyond what all studies are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import Options, path, quantity, whole


@dataclass(frozen=True, kw_only=True)
class PaperOptions(Options):
    """The tables that the effects are put into, and how near to the paper counts."""

    tables: int | None = whole(
        "N",
        "tables of the set, spread ones, that the effects are put into; the time grows with it "
        "(default: 12; quick: 3; all there are: 60)",
        1,
    )
    margin: float = quantity(
        "m",
        "LENGTH",
        'how far 3 sigma may be from the published one and still show the pattern (default: "0.24 um")',
        default=0.24e-6,
        text="0.24 um",
    )
    ensemble: Path | None = path(
        "FILE",
        "the tables of the set (default: models/machines/linear_motor_table_ensemble.toml; only the machine itself "
        "where --machine is given)",
    )
