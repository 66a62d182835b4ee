"""What blind_trial can be asked beyond what all studies are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import Options, path, text, whole


@dataclass(frozen=True, kw_only=True)
class TrialOptions(Options):
    """What to seal or open, and where to answer."""

    cases: int | None = whole(
        "N",
        "how many to seal and answer, from 1 on (default: 60; 4 with --quick). The time of 300 or more is checked, "
        "too, on two cores, where nothing of an earlier run is in --output",
        1,
    )
    pack: Path | None = path(
        "FOLDER",
        "answer these sealed cases instead: case-*/*.csv.gz, nominal.json, commitments.json. answers.json in --output "
        "grows with each, and a run that was interrupted goes on there",
    )
    key: Path | None = path("FILE", "open the labels of --pack with it, and score")
    scheduler: str | None = text(
        "ADDRESS",
        'of a Dask cluster whose workers see the same folders: "tcp://host:8786" (default: all cores here)',
    )

    def usual_machine(self) -> Path | None:
        """The nominal machine of the pack; None for a folder that is not a pack, which is said later."""
        file = (self.pack or Path(__file__).with_name("sealer")) / "nominal.json"
        return file if file.is_file() else None
