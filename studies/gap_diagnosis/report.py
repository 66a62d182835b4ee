"""The report on a diagnosis: its figures and captions; the text is in report.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from reports.markup import Markdown
from reports.report import Figure, Report
from studies import as_known
from studies.gap_diagnosis import course, figures, unknown_law
from studies.gap_diagnosis.how_far import bound_meant, bounds_told, harm_told
from studies.wording import beside, effects_listed, filters, fitted, quantity

Results = Mapping[str, Any]


def tell(whole: Results) -> Report:
    """The report on the content of results.json."""
    results = whole["results"]
    shown = [
        Figure(
            "waterfall",
            _waterfall_caption(results),
            ("results.how_far", "results.where", "results.verdict", "results.learned"),
            figures.waterfall,
        ),
        Figure("force", FORCE, ("results.pictures", "results.records"), figures.force),
        Figure("courses", COURSES, ("results.pictures",), figures.courses),
        Figure("maps", MAPS, ("results.where",), figures.maps),
        Figure("coordinates", COORDINATES, ("results.where",), figures.coordinates),
        Figure("spectra", SPECTRA, ("results.pictures",), figures.spectra),
        Figure("gains", _gains_caption(results), ("results.which", "results.verdict"), figures.gains),
        Figure("confusable", CONFUSABLE, ("results.confusability",), figures.confusable),
    ]
    if unknown_law.has_curve(results.get("learned")):
        shown.append(Figure("learned", LEARNED, ("results.learned",), figures.learned_curve))
    if results["next"] is not None:
        shown.append(Figure("next", NEXT, ("results.next",), figures.next_run))
    extra: dict[str, Callable[..., Any]] = {
        "listed": effects_listed,
        "harm": partial(harm_told, quantity=quantity),
        "bounds": partial(bounds_told, verb=False),
        "bound_meant": bound_meant,
        "share": _share,
        "sized": _sized,
        "over": unknown_law.OVER.__getitem__,
        "found": course.found,
        "evalue": course.e_value,
        "ended": course.ended,
    }
    title = f"Diagnosis: {whole['machine']['name']}"
    question = (
        "Where does the real machine deviate from its model, which effect causes it, how much of the gap does it close?"
    )
    there = {
        "values": bool(_fitted(results)),
        "transfer": results["how_far"]["transfer"] is not None,
        "byrecord": results["how_far"]["transfer"] is not None,
        "holdout": results["how_far"]["hold_out"] is not None,
        "bytype": unknown_law.has_curve(results.get("learned")),
        "hanging": results["settling"] is not None,
        "looks": results.get("asked") is not None,
    }
    tables = {name: keys for name, keys in TABLES.items() if there.get(name, True)}
    return Report(
        title,
        question,
        Path(__file__).parent / "report.md",
        tuple(shown),
        {**filters(), **extra, **as_known.filters()},
        tables,
    )


TABLES = {
    "looks": ("results.asked",),
    "records": ("results.records",),
    "files": ("results.how_far",),
    "hanging": ("results.settling",),
    "transfer": ("results.how_far", "results.records"),
    "byrecord": ("results.how_far", "results.records"),
    "holdout": ("results.how_far",),
    "bytype": ("results.learned",),
    "parts": ("results.where",),
    "values": ("results.which", "results.verdict"),
    "shifts": ("results.shifts",),
    "limits": ("results.confusability", "results.catalogue"),
    "criteria": ("results.criteria",),
    "parameters": ("parameters",),
}
WATERFALL = (
    "The residual of each model: the unknown force{others}. Dashed: the noise floor, which is what the last model "
    "leaves of a record that it made itself or, for a drive rougher than its model, the scatter between equal motions. "
    "Dotted: the force that flexible curves over all coordinates, which name no cause, leave on held-out motions."
)
FORCE = Markdown(
    "The force $d$ that the re-fitted model lacks, smoothed over the whole record (past and future), at two settings: "
    "slow, with its 95 % band, and fast, shown by its extremes; below, the reference."
)
COURSES = "The force during the motions where it is largest, mean and scatter over equal ones; below, the reference."
MAPS = (
    "Size of the force by kind of motion and phase; the numbers are its shares of the energy, less what noise alone "
    "would give."
)
COORDINATES = (
    "Left: share of the force's variance that a curve over one coordinate explains on held-out motions, with its 95 % "
    "interval, and the part that changes sign with the direction of motion, or of the command with that of its change; "
    "p by randomly flipping the sign of whole "
    "motions. Right: the curve over the best coordinate."
)
SPECTRA = "Power spectral density of the force, with the part due to the scale's noise, and its periods over position."
LEARNED = (
    "The learned law over its coordinate, linear between the knots, and its band by drawing motions. Beyond "
    "its ends it stays what it is there."
)
GAINS = "Held-out gain of the catalogue's effects over the re-fitted model, and the thresholds for chance."
CONFUSABLE = (
    "Which effects these records can distinguish, from their paths alone: the chi-square by which the row's effect, at "
    "its typical size, would win over the best fit by the column's effect and the nominal values (on the diagonal: by "
    "the nominal values alone; white: a thousand times the threshold or more). A cross: below the threshold (the line "
    "on the scale), so that one could be mistaken for the other. A circle: not detectable."
)
NEXT = Markdown("The references of the proposed experiment, `next_experiment.csv`.")


def _gains_caption(results: Results) -> str:
    """The caption, and what the gains are beside where the unknown force hid a slow one."""
    if not results["verdict"].get("beside_still_force"):
        return GAINS
    return (
        f"{GAINS} They are beside a white unknown force; one that walks at random would follow a law as slow as this."
    )


def _waterfall_caption(results: Results) -> str:
    """The caption with what the figure shows: records without a motion that settles have no settling times."""
    stages = results["how_far"]["stages"]
    others = [
        words
        for key, words in (
            ("position_m", "the position error of the simulated closed loop against the record"),
            ("settling_s", "the error of its settling times"),
        )
        if any(stage[key] is not None for stage in stages)
    ]
    parts = "" if not others else f" and {others[0]}" if len(others) == 1 else f", {others[0]}, and {others[1]}"
    return WATERFALL.format(others=parts)


def _share(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.1f} %"


def _sized(item: Results) -> str:
    """A fitted value with its standard deviation, and no more digits than that leaves it."""
    if not item["std"]:  # at the end of its range, or without one
        return fitted(item, 4)
    return f"{beside(item['value'], item['std'], item['unit'])} ± {quantity(item['std'], item['unit'], 2)}"


def _fitted(results: Results) -> list[Results]:
    """The rows of the named effects that have fitted values."""
    names = results["verdict"]["effects"] + results["verdict"]["partly"]
    return [row for row in results["which"] if row["effect"] in names and row["parameters"]]
