"""How a diagnosis is told: its figures and the words around them (report.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from reports.report import Figure, Report
from studies.gap_diagnosis import figures
from studies.gap_diagnosis.answer import effects_listed
from studies.wording import filters, fitted

Results = Mapping[str, Any]


def tell(whole: Results) -> Report:
    """The report on what results.json holds."""
    results = whole["results"]
    shown = [
        Figure("waterfall", WATERFALL, ("results.how_far", "results.where"), figures.waterfall),
        Figure("force", FORCE, ("results.pictures", "results.records"), figures.force),
        Figure("courses", COURSES, ("results.pictures",), figures.courses),
        Figure("maps", MAPS, ("results.where",), figures.maps),
        Figure("coordinates", COORDINATES, ("results.where",), figures.coordinates),
        Figure("spectra", SPECTRA, ("results.pictures",), figures.spectra),
        Figure("gains", GAINS, ("results.which", "results.verdict"), figures.gains),
        Figure("confusable", CONFUSABLE, ("results.confusability",), figures.confusable),
    ]
    if results["next"] is not None:
        shown.append(Figure("next", NEXT, ("results.next",), figures.next_run))
    extra: dict[str, Callable[..., Any]] = {
        "listed": effects_listed,
        "share": _share,
        "sized": partial(fitted, digits=4),
    }
    title = f"Diagnosis: {whole['machine']['name']}"
    question = "Where does the real machine leave the model, which effect causes it, how far does the gap shrink?"
    tables = {name: keys for name, keys in TABLES.items() if name != "values" or _fitted(results)}
    return Report(title, question, Path(__file__).parent / "report.md", tuple(shown), {**filters(), **extra}, tables)


TABLES = {
    "records": ("results.records",),
    "parts": ("results.where",),
    "values": ("results.which", "results.verdict"),
    "shifts": ("results.shifts",),
    "limits": ("results.confusability", "results.catalogue"),
    "parameters": ("parameters",),
}
WATERFALL = (
    "What each model leaves: the unknown force, the position of the simulated closed loop against the record, and how "
    "far its settling times are from the record's. Dashed: the floor, what the last model leaves of a record that it "
    "made itself or, of a drive rougher than its model, what does not repeat where motions do. Dotted: what "
    "flexible curves over all coordinates, which name nothing, leave of the force on motions left out."
)
FORCE = (
    "The force $d$ that the re-fitted model lacks, from all of the record (past and future), at two settings: a slow "
    "one with its 95 % band, and a fast one as its extremes; below, the reference."
)
COURSES = "The force over the motions that hold most of it, mean and scatter over equal ones; below, the reference."
MAPS = (
    "Size of the force by kind of motion and phase; the numbers are the shares of its energy, what noise alone would "
    "give taken off."
)
COORDINATES = (
    "Left: share of the force's variance that a curve over one coordinate explains on motions left out, with its 95 % "
    "interval, and the part that turns with the direction of motion; p by turning the sign of whole motions at random. "
    "Right: the curve over the first of them."
)
SPECTRA = "The force over frequency, beside what the scale's noise makes of it, and its periods over position."
GAINS = "What the catalogue's effects gain on motions left out, beside the re-fitted model, and what counts as chance."
CONFUSABLE = (
    "What these records can tell apart, from their paths alone: by what chi-square the row's effect, at its typical "
    "size, would win over the best that the column's and all that is nominal can make (on the diagonal: the nominal "
    "values alone; white: a thousand times the threshold or more). A cross: below the threshold (the line on the "
    "scale), the one can be passed off as the other. A circle: it does not show at all."
)
NEXT = "The references of the proposed experiment, `next_experiment.csv`."


def _share(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.1f} %"


def _fitted(results: Results) -> list[Results]:
    """The rows of the effects in the answer that have fitted values."""
    names = results["verdict"]["effects"] + results["verdict"]["partly"]
    return [row for row in results["which"] if row["effect"] in names and row["parameters"]]
