"""Options of blind_trial besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import choice, flag, path, path_list, text, whole
from studies.record_options import RecordOptions


@dataclass(frozen=True, kw_only=True)
class TrialOptions(RecordOptions):
    """The options of the blind trial; those on how records are read are for --inject."""

    cases: int | None = whole(
        "N",
        "number of cases to seal and answer, from 1 on (default: 60, or all with --inject; 2 with --quick). The total "
        "time is checked too from 300 cases on, on two cores, if --output holds nothing of an earlier run",
        1,
    )
    machines: str = choice(
        "on which machines the cases are sealed: all on one table (default), or on machines drawn at random, each with "
        "an experiment of its own, six cases on each; a claim needs some 1000 cases",
        ("table", "random"),
    )
    pack: Path | None = path(
        "FOLDER",
        "answer these sealed cases instead: case-*/*.csv.gz, nominal.json (of all, or in each case's folder), "
        "commitments.json. answers.json in --output grows with each case, and an interrupted run resumes from it",
    )
    inject: tuple[Path, ...] = path_list(
        "RECORD",
        "put known laws into these measured records of --machine instead, the motion kept: the command is changed by "
        "the law's force, and the reference by what the controller needs to give it. Sizes follow from each record's "
        "own roughness. The design has some 120 cases a record, half a minute of one core each for a record of 25 s at "
        "1 kHz; --cases takes the first so many of it. An interrupted run resumes",
    )
    key: Path | None = path("FILE", "the key of --pack, to open its labels and score the answers")
    scheduler: str | None = text(
        "ADDRESS",
        'of a Dask cluster whose workers see the same folders: "tls://host:8786" (default: all cores here). Dask\'s '
        "protocol is pickle without authentication: without TLS only tcp:// on this computer is accepted",
    )
    tls_ca: Path | None = path("FILE", "certificate of the authority of a tls:// scheduler, PEM")
    tls_cert: Path | None = path("FILE", "certificate to show to a tls:// scheduler, PEM")
    tls_key: Path | None = path("FILE", "private key of --tls-cert, PEM")
    insecure_scheduler: bool = flag(
        "connect to tcp:// on another computer, although whoever answers there can run code on this one",
        reviewable=False,
    )

    def usual_machine(self) -> Path | None:
        """The nominal machine of the pack; None for a folder that is not a pack, which is reported later."""
        if self.inject:
            return None
        file = (self.pack or Path(__file__).with_name("sealer")) / "nominal.json"
        return file if file.is_file() else None
