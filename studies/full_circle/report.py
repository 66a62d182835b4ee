"""The reports of the circle: on one's own axis, and on withheld machines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from reports.report import Figure, Report
from studies.full_circle import figures, figures_withheld, scoring
from studies.full_circle.verification import closing, settles, time_to_settle
from studies.gap_diagnosis import course
from studies.wording import effect, filters

Results = Mapping[str, Any]

HERE = Path(__file__).parent
TABLES = {"machines": ("results.cases",), "policies": ("results.policies",), "parameters": ("parameters",)}
"""Of the report on withheld machines."""
ROLES = {
    "identify": "identification",
    "diagnose": "diagnosis",
    "current": "the design in place",
    "redesign": "verification",
}
TOLD = (
    ("settles_in_the_end", "of machines with motions that never settled and with the truth do, those where all do"),
    ("worse_when_run", "redesigns worse when run by more than 5 % and noise, or not run to their end"),
    ("inside_settling", "redesigns whose settling was in its 90 % interval"),
    ("inside_dispersion", "redesigns whose 3σ was in its 90 % interval"),
    ("said_why", "of what ends late, said with a reason"),
)
MACHINES = (
    "Every machine before and after{truth}. Dashed: the specification, and what was before. A motion that never "
    "settles counts as long as it lasted."
)
SHARES = (
    "The share recovered on each machine, and the median (bar), by the redesign and by what is simpler. What is beyond "
    "-1 or 1.5 is drawn there."
)
NAMES = (
    "The share of machines with a single effect on which each policy had rightly and surely named it after so much "
    "machine time, that of the first record included. Bars: the share in the end, with its exact 95 % interval."
)
EXPECTED = (
    "What each design is expected to achieve on machines that the records allow, and what was measured. Dashed: the "
    "specification."
)
MOTIONS = (
    "The errors of the motions over the specified stroke, turned with the motion, from the step of the target on; of "
    "several records, those of the one with the slowest motion. "
    "Dashed: the tolerance, and the time by which motions are to settle."
)


def tell(whole: Results) -> Report:
    """The report on the content of results.json."""
    return _own_axis(whole) if whole["results"]["mode"] == "records" else _withheld(whole)


def _withheld(whole: Results) -> Report:
    results = whole["results"]
    truth = any(row["truth"] is not None for row in results["cases"])  # a quick run makes no design with it
    caption = MACHINES.format(truth=", and with designs made with the truth" if truth else "")
    shown = [Figure("machines", caption, ("results.cases",), figures_withheld.machines)]
    if has_shares(results):
        shown.append(Figure("shares", SHARES, ("results.shares",), figures_withheld.shares))
    if singles(results):
        shown.append(Figure("names", NAMES, ("results.policies",), figures_withheld.names))
    for number, one in enumerate(results["stories"]):
        caption = f"Errors of the motions of {one['case'].replace('-', ' ')}, before and in the end."
        shown.append(Figure(f"story-{number + 1}", caption, ("results.stories",), figures_withheld.story(number)))
    extra: dict[str, Callable[..., Any]] = {
        "closed": closed,
        "ways": ways,
        "way": scoring.WAYS.__getitem__,
        "part": _part,
        "ends": _ends,
        "told": lambda rates: [(key, said) for key, said in TOLD if rates[key]["tries"]],
        "has_shares": has_shares,
        "singles": singles,
        "rate": _rate,
        "median": lambda values: float(np.median(values)),
        "found": course.found,
        "settles": settles,
        "settling": lambda one: "never" if one["never"] else filters()["show"](one["settling_s"], "s", 3),
        "number": lambda case: str(int(case.rpartition("-")[2])),
        "true": _true,
        "named": _named,
        "design": lambda row: f"{row['chosen']}{', taken back' if row['rolled_back'] else ''}",
    }
    question = "Asked, named, redesigned and run on machines that are withheld: does the gap close?"
    return Report("Full circle", question, HERE / "report.md", tuple(shown), {**filters(), **extra}, TABLES)


def has_shares(results: Results) -> bool:
    """Whether there is a machine on which something could be recovered."""
    return bool(ways(results))


def singles(results: Results) -> int:
    """On how many machines there was a single effect to be named."""
    return max((one["right_over_time"][-1]["tries"] for one in results["policies"]["of"].values()), default=0)


def _rate(one: Results) -> str:
    return f"{one['hits']} of {one['tries']} ({_ends(one)})" if one["tries"] else "–"


def ways(results: Results) -> list[tuple[str, str]]:
    """The ways and quantities that a share is known for."""
    return [(way, name) for way, found in results["shares"].items() for name in found if found[name]["count"]]


def closed(results: Results) -> str:
    """What came of it, in a sentence."""
    count, worse = len(results["cases"]), results["rates"]["worse_when_run"]
    machines = f"{count} machine{'s' if count != 1 else ''}"
    back = f"{worse['hits']} of {worse['tries']} redesigns {'was' if worse['hits'] == 1 else 'were'} rolled back"
    share = results["shares"]["after"]["settling"]
    if results["quick"]:  # no design is made with the truth, so nothing says what could be gained
        return f"On {machines}, {back}."
    if share["median"] is None:
        return f"On {machines}, {back}; on none could settling be much faster."
    return (
        f"On {machines}, the redesign recovers {_part(share['median'])} (median of {share['count']}) of the settling "
        f"time that designs with the truth would gain; {back}."
    )


def _part(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"


def _ends(one: Results) -> str:
    return "–" if one["low"] is None else f"{100 * one['low']:.0f} to {100 * one['high']:.0f} %"


def _true(row: Results) -> str:
    names = [effect(name) for name in row["true"]]
    return f"{', '.join(names)} ({row['kind']})" if names else row["kind"]


def _named(row: Results) -> str:
    return ", ".join(effect(name) for name in row["named"]) or row["outcome"].replace("_", " ")


def _own_axis(whole: Results) -> Report:
    results = whole["results"]
    shown = (
        Figure("expected", EXPECTED, ("results.redesign", "results.verified"), figures.expected),
        Figure("motions", MOTIONS, ("results.pictures", "results.redesign"), figures.motions),
    )
    tables = {
        "designs": ("results.redesign",),
        "records": ("results.records",),
        "parameters": ("parameters",),
    }
    if results["verified"]["rows"]:
        tables["measured"] = ("results.verified",)
    if results["identified"]:
        tables["identified"] = ("results.identified",)
    question = (
        "Which machine is it, what does its model lack, which design follows from it, and what is to be run next?"
    )
    extra: dict[str, Callable[..., Any]] = {
        "headline": headline,
        "role": ROLES.__getitem__,
        "time_to_settle": time_to_settle,
        "in_its_interval": in_its_interval,
        "closing": closing,
    }
    title = f"Full circle: {whole['machine']['name']}"
    return Report(title, question, HERE / "own_axis.md", shown, {**filters(), **extra}, tables)


def headline(redesign: Results, verified: Results) -> str:
    """What came of it, in a sentence."""
    rows = {one["name"]: one for one in redesign["designs"]}
    show = filters()["show"]
    if redesign["kept"]:
        return "The design in place stays: no other one is surely better on the machines that the records allow."
    before, after = redesign["designs"][0], rows[redesign["chosen"]]
    was, now = (time_to_settle(one["settling"]["median"], verified["interval_s"]) for one in (before, after))
    gain = f"the slowest motion is expected to settle in {now} instead of {was}"
    if now == "never":
        was, now = (show(one["dispersion"]["median"], "m", 3) for one in (before, after))
        gain = f"its 3σ is expected to be {now} instead of {was}"
    if verified["state"] in {"holds", "missed"}:
        return _tried(verified, redesign["specified"]["settling_s"])
    if verified["state"] == "rolled back":
        return "The redesign was run and was worse, so the design in place is restored."
    return f"There is a better design, to be verified: {gain}."


def _tried(verified: Results, specified: float) -> str:
    """What the redesign achieved, against the specified settling time [s] and the design in place."""
    show, now, was = filters()["show"], verified["after"], verified["before"]
    came = "holds" if verified["state"] == "holds" else "misses the specification"
    told = f"The redesign {came}: it {settles(now)}, and {show(specified, 's')} are specified"
    spread = f"Its 3σ is {show(now['dispersion_m'], 'm', 3)}"
    if was is None:
        return f"{told}. {spread}. What the design in place achieves is not in the records."
    return f"{told}; the design in place {settles(was)}. {spread} instead of {show(was['dispersion_m'], 'm', 3)}."


def in_its_interval(inside: Results) -> str:
    """Which of what the redesign achieved was in the interval in which it was expected, as a sentence."""
    settling, spread = inside["settling"], inside["dispersion"]
    if settling == spread:
        both = "Settling and 3σ were both in their expected intervals"
        return both if settling else "Neither settling nor 3σ was in its expected interval"
    within, beyond = ("settling", "3σ") if settling else ("3σ", "settling")
    return f"{within[0].upper()}{within[1:]} was in its expected interval, {beyond} was not"
