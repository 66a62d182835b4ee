"""A diagnosis that asks for its own records: look, choose what to run next, run it, look again; see policy.py."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from diagnosis.baseline import refit_and_null
from diagnosis.criteria import Criteria
from diagnosis.experiments import policy
from diagnosis.experiments.e_process import EProcess, tested
from diagnosis.experiments.information import ExperimentInformation, information_of, told_by, usual_sizes
from diagnosis.experiments.look import Found, Look, look
from diagnosis.experiments.policy import Choice, Choose, Knowledge, Stop
from diagnosis.experiments.schedules import Schedule, together
from diagnosis.experiments.within_limits import Bounds, experiments
from models.effects.priors import Priors
from models.machine import Machine
from models.records.record import Record


@dataclass(frozen=True)
class NotRun:
    """Why a machine made no record of what it was asked; spent: whether it took its time for it all the same, as one
    that tripped did, and one that refused did not."""

    why: str
    spent: bool


Run = Callable[[Schedule], Record | NotRun]
"""Has the machine run references: its record, or why there is none."""
Say = Callable[[float, str], None]


@dataclass(frozen=True)
class Budget:
    """What may be taken of the machine: within which bounds, its time [s] and its records; and the probability of a
    false name over all looks [1]."""

    bounds: Bounds
    seconds: float = 60.0
    records: int = 6
    chance: float = policy.CHANCE


@dataclass(frozen=True)
class Settings:
    """How every look is taken: thresholds, the seed, the effects that are not to be used, and a folder that keeps the
    null from run to run."""

    criteria: Criteria = Criteria()
    seed: int = 0
    disabled: tuple[str, ...] = ()
    cache: Path | None = None


@dataclass(frozen=True)
class Step:
    """One record and what is known with it: what was asked in words, why, what it took of the machine's time [s]; what
    was found before and after; the e-process; failed: why there is no record."""

    asked: str
    why: str
    seconds: float
    before: Found | None
    found: Found | None
    process: EProcess
    failed: str = ""


@dataclass(frozen=True)
class Asked:
    """The whole diagnosis: how it ended and why, the names that are sure, the steps, the records, the last look,
    the effects that none of the records could show, and the probability of a false name [1]."""

    stop: Stop
    reason: str
    names: tuple[str, ...]
    steps: tuple[Step, ...]
    records: tuple[Record, ...]
    last: Look | None
    hidden: tuple[str, ...]
    chance: float = policy.CHANCE


def ask(
    machine: Machine,
    run: Run,
    budget: Budget,
    settings: Settings = Settings(),
    *,
    choose: Choose = policy.active,
    have: Sequence[Record] = (),
    say: Say = lambda _share, _text: None,
) -> Asked:
    """Runs experiments on a machine within its bounds until the diagnosis is sure or the budget is spent [SI].

    have: records that there are already; without any, the first one is the user's own test, the specified motions.
    choose: how the others are chosen. say is told the share of the budget that is spent, and what comes next.
    """
    say(0.0, "what each experiment would tell, by simulation")
    names = names_of(machine, settings.disabled)
    possible = experiments(machine, budget.bounds)
    menu = information_of(machine, possible, names, settings.seed)
    known = Knowledge(names, menu, (0,) * len(menu), (), EProcess(), budget.seconds, budget.records, settings.criteria)
    course = _Course(known, records=tuple(have))
    if have:
        there = Choice((), "records that there were")
        course = _looked(course, machine, settings, there, known, usual_sizes(machine, possible))
    choice = _next(course.known, choose)
    while choice is not None and policy.ending(course.known, budget.chance) is None:
        parts = [course.known.experiments[i] for i in choice.places]
        share = 1 - course.known.seconds / budget.seconds
        say(share, f"asked {_words(parts)}, {choice.why}")
        result = run(_joined(parts))
        begun = course.known
        if not isinstance(result, NotRun) or result.spent:
            course = replace(course, known=_spent(begun, parts))
        if isinstance(result, NotRun):
            say(share, f"the machine did not: {result.why}")
            steps = (*course.steps, _step(parts, choice, begun, None, result))
            course = replace(course, known=_without(course.known, choice), steps=steps)
        else:
            course = replace(course, known=_seen(course.known, choice), records=(*course.records, result))
            say(1 - course.known.seconds / budget.seconds, f"a diagnosis of {len(course.records)} records")
            course = _looked(course, machine, settings, choice, begun)
        choice = _next(course.known, choose)
    return _asked(course, budget)


def names_of(machine: Machine, disabled: Sequence[str] = ()) -> tuple[str, ...]:
    """The effects that a path can show, so that an experiment can be chosen for them."""
    kinds = machine.kinds
    return tuple(name for name in kinds if kinds[name].shown_in() != "log" and name not in disabled)


@dataclass(frozen=True)
class _Course:
    known: Knowledge
    records: tuple[Record, ...] = ()
    steps: tuple[Step, ...] = ()
    last: Look | None = None


def _looked(
    course: _Course,
    machine: Machine,
    settings: Settings,
    choice: Choice,
    begun: Knowledge,
    sizes: Priors | None = None,
) -> _Course:
    """One diagnosis of all records, after the last one was tested against what the look before had named; sizes: of
    the effects that experiments would show [SI], where the records are not of experiments, to know what these told."""
    baseline = refit_and_null(machine, course.records, criteria=settings.criteria, cache=settings.cache)
    known, last = course.known, course.last
    if sizes is not None:
        known = replace(known, had=told_by(baseline.nominal, course.records, known.effects, sizes))
    process = tested(last, baseline, known.process) if last is not None else known.process
    now = look(baseline, seed=settings.seed, disabled=settings.disabled)
    known = replace(known, found=(*known.found, now.found), process=process)
    step = _step([begun.experiments[i] for i in choice.places], choice, begun, known)
    return _Course(known, course.records, (*course.steps, step), now)


def _next(known: Knowledge, choose: Choose) -> Choice | None:
    fits = known.within(known.seconds)
    if not fits or known.records < 1:
        return None
    if known.found:
        return choose(known)
    why = "to begin with what the axis runs anyway" if min(fits) == 0 else "as what the axis runs anyway was not run"
    return Choice((min(fits),), why)


def _spent(known: Knowledge, parts: list[ExperimentInformation]) -> Knowledge:
    return replace(known, seconds=known.seconds - sum(one.seconds for one in parts), records=known.records - 1)


def _seen(known: Knowledge, choice: Choice) -> Knowledge:
    return replace(known, runs=tuple(n + choice.places.count(i) for i, n in enumerate(known.runs)))


def _without(known: Knowledge, choice: Choice) -> Knowledge:
    """Without the experiments that the machine did not run as what may be asked for; what was run tells what it did."""
    return replace(known, barred=known.barred.union(choice.places))


def _joined(parts: list[ExperimentInformation]) -> Schedule:
    schedules = [one.experiment.schedule for one in parts]
    return schedules[0] if len(schedules) == 1 else together("asked", schedules)


def _words(parts: Sequence[ExperimentInformation]) -> str:
    return "; then ".join(one.experiment.words for one in parts)


def _step(
    parts: list[ExperimentInformation],
    choice: Choice,
    begun: Knowledge,
    known: Knowledge | None,
    not_run: NotRun | None = None,
) -> Step:
    return Step(
        _words(parts),
        choice.why,
        sum(one.seconds for one in parts) if not_run is None or not_run.spent else 0.0,
        begun.found[-1] if begun.found else None,
        known.found[-1] if known else None,
        (known or begun).process,
        not_run.why if not_run else "",
    )


def _asked(course: _Course, budget: Budget) -> Asked:
    known = course.known
    if course.last is None:
        said = course.steps[-1].failed if course.steps else ""
        reason = f"nothing that stays within the limits was run{f'; the machine said: {said}' if said else ''}"
        return Asked(Stop.CANNOT_TELL, reason, (), course.steps, (), None, known.effects)
    end = policy.ending(known, budget.chance)
    if end is None:
        fits = known.within(known.seconds) and known.records > 0
        left = "its records are spent" if known.records < 1 else f"no experiment fits into {known.seconds:.2g} s"
        reason = "nothing within the limits would tell more" if fits else f"of the budget, {left}"
        end = policy.ending_when_spent(known, budget.chance, reason)
    names = tuple(name for name in known.found[-1].names if known.process.is_confirmed(name, budget.chance))
    named = names if end[0] is Stop.NAMED else ()
    return Asked(*end, named, course.steps, course.records, course.last, policy.hidden(known), budget.chance)


def to_json(asked: Asked) -> dict[str, Any]:
    """The course of it as results.json holds it; seconds [s], logarithms of e-values [1]."""
    return {
        "outcome": str(asked.stop),
        "reason": asked.reason,
        "effects": list(asked.names),
        "not_shown": list(asked.hidden),
        "chance": asked.chance,
        "needed": 1 / asked.chance,
        "seconds": sum(one.seconds for one in asked.steps),
        "looks": [
            {
                "asked": one.asked,
                "why": one.why,
                "seconds": one.seconds,
                "failed": one.failed,
                "before": one.before and one.before.to_json(),
                "after": one.found and one.found.to_json(),
                **one.process.decades(),
            }
            for one in asked.steps
        ],
    }
