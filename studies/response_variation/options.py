"""Options of response_variation besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import Options, flag, path, whole


@dataclass(frozen=True, kw_only=True)
class VariationOptions(Options):
    """The set of tables, from a file or from a new search."""

    ensemble: Path | None = path(
        "FILE",
        "the tables of the set (default: models/machines/linear_motor_table_ensemble.toml; only the machine itself "
        "if --machine is given)",
        reviewable=True,
    )
    search: bool = flag(
        "search the set anew, seeded by --seed, in a minute or two; ensemble.toml and most_central.toml are written "
        "beside the results"
    )
    conventions: bool = flag(
        "search also the sets under other conventions: another deadbeat, another divisor of sigma; takes some minutes, "
        "and conventions.toml is written beside the results"
    )
    members: int = whole("N", "tables that --search keeps, 2 to 160 (default: 60)", 2, 160, default=60)
