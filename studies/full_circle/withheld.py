"""The circle on one withheld machine, by a process that can open neither its truth nor the program that runs it.

All that the process can do with the machine is to ask whoever started it for runs. Each bench is the same machine with
its limits of its own: "main" is what an engineer would have; the others run what the redesign is compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.redesign.choice import worse
from design.redesign.designs import Design, designed
from design.redesign.learning_rounds import ROUND_COUNT, corrected
from design.redesign.outcome import Outcome, judged_target, outcome
from design.redesign.stated import machines_as_stated
from diagnosis.diagnose import Diagnosis, diagnosed
from diagnosis.experiments import active
from diagnosis.experiments.look import Look
from diagnosis.experiments.schedules import Schedule
from diagnosis.experiments.within_limits import Bounds
from diagnosis.handover.files import Content, machine_of
from diagnosis.handover.posterior import drawn, machines_allowed
from diagnosis.improved import improved_machine
from diagnosis.model.parameters import parameters
from diagnosis.refit import refit
from models.controller import References
from models.machine import Machine
from models.quantity import QuantityError
from models.records.record import Record
from studies.command import to_text
from studies.full_circle import redesigning
from studies.full_circle.policies import POLICIES
from studies.gap_diagnosis.course import confirmed

SHARES: Final = (0.95, 0.8, 0.65, 0.5)  # of the largest feedforward that designs have, as far as they go
RUNS: Final = 39  # machines that could be this one
COMPARED_RUNS: Final = 9
EACH: Final = 5  # rounds of learning on a bench
DIAGNOSED_SAMPLES: Final = 120_000  # that a machine is asked for at most: a diagnosis of them takes some minutes

Ask = Callable[[str, Schedule, Mapping[str, Any] | None], Mapping[str, Any]]


@dataclass(frozen=True)
class Limits:
    """What a run may ask for, as the machine states it: [m], [m/s], [N], and machine time [s] in all."""

    distance: float
    speed: float
    feedforward: float
    machine_time: float


@dataclass(frozen=True)
class Terms:
    """On which a machine is diagnosed: the policy by which it is asked, machine time [s] and records, those of the
    first record included; and how far: to its "name", or to a "redesign"; to a "refit" that asks for nothing."""

    policy: str
    goal: str
    seconds: float
    records: int


def circle(machine: Machine, limits: Limits, ask: Ask, settings: active.Settings, terms: Terms) -> dict[str, Any]:
    """All that is answered of one machine: what was asked, named, designed, and achieved (SI).

    ask(bench, references, controller): runs them, with another controller.json where one is given; the answer holds
    "record", or "refused" or "tripped" with the reason.
    """
    work = _Work(machine, limits, ask, settings.seed)
    share, old = _allowed(machine, limits)
    first = work.run("main", old)
    if isinstance(first, str):
        return {"failed": f"the design in place could not be run: {first}"}
    told: dict[str, Any] = {"begun_s": first.position.size * machine.sample_time}
    if terms.goal == "refit":
        return {**told, **_redesigned(work, share, old, first, refitted(machine, first, settings.seed))}
    found = _asked(work, first, settings, terms)
    if found.last is None:
        return {"failed": found.reason}
    last = found.last.found
    told["course"] = active.to_json(found)
    told["verdict"] = {
        "outcome": str(last.outcome),
        "effects": list(last.names),
        "equivalent": [list(one) for one in last.alike],
    }
    if terms.goal == "name":
        return told
    told |= _redesigned(work, share, old, first, known(found.last, settings), beside=True)
    told["named"] = confirmed(told["named"], told["course"])
    return told


def _asked(work: _Work, first: Record, settings: active.Settings, terms: Terms) -> active.Asked:
    """The diagnosis that asks for its records, the first of which is that of the design in place."""
    machine, limits = work.machine, work.limits
    seconds = min(terms.seconds, limits.machine_time, DIAGNOSED_SAMPLES * machine.sample_time)

    def run(references: Schedule) -> Record | active.NotRun:
        told = work.ask("main", references, None)
        found = _record(told)
        return found if found is not None else active.NotRun(_why_not(told), "tripped" in told)

    budget = active.Budget(
        Bounds(limits.distance, limits.speed, limits.feedforward),
        seconds - first.position.size * machine.sample_time,
        terms.records - 1,
    )
    return active.ask(machine, run, budget, settings, choose=POLICIES[terms.policy](settings.seed), have=(first,))


def _redesigned(
    work: _Work, share: float, old: Design, first: Record, now: Known, *, beside: bool = False
) -> dict[str, Any]:
    """The designs for the machine as it is known now, what came of the one that was run, and of simpler ways beside
    it."""
    machine, limits = work.machine, work.limits
    as_was, as_is = within(machine, limits, share), within(now.better, limits, share)
    made = redesigning.redesigned(as_was, as_is, now.could_be, work.seed, lambda _share, _text: None, pid=beside)
    before = outcome(first, machine)
    after, why, last = _tried(work, made, first)
    shown = redesigning.to_json(made)
    compared: dict[str, Any] = {}
    if beside:
        compared = _beside(work, as_was, within(now.refitted, limits, share), as_is)
        compared["learning"] = redesigning.outcome_to_json(learned(work, old, first, ROUND_COUNT))
    return {
        "named": now.told,
        "redesign": redesigning.restored(shown) if why else shown,
        "before": redesigning.outcome_to_json(before),
        "after": redesigning.outcome_to_json(after),
        "rolled_back": why,
        "tried": redesigning.outcome_to_json(outcome(last, machine)) if last is not None else None,
        "pictures": {
            "before": redesigning.errors_over_time(first, machine),
            "after": redesigning.errors_over_time(first if last is None or why else last, machine),
        },
        "beside": compared,
        "noise": {"settling_s": machine.sample_time, "dispersion_m": _reading(machine)},
    }


def _allowed(machine: Machine, limits: Limits) -> tuple[float, Design]:
    """The design in place with as much of the largest feedforward as it may have, so that a loop that weighs its
    reference, whose share comes on top, stays within it; and that share [1]."""
    for share in SHARES:
        design = redesigning.old_design(within(machine, limits, share))
        known = redesigning.references_of(machine, design, own_loop=True)
        if np.max(np.abs(known.feedforward + known.compensation)) <= limits.feedforward:
            break
    return share, design


def within(machine: Machine, limits: Limits, share: float) -> Machine:
    """The machine for designs, whose thrust is a share [1] of what a run may ask for (SI)."""
    thrust = min(machine.drive.rated_thrust, share * limits.feedforward)
    return replace(machine, drive=replace(machine.drive, rated_thrust=thrust))


def _reading(machine: Machine) -> float:
    """Three deviations [m] of a reading, noise and rounding together."""
    return 3 * machine.scale.reading_deviation


@dataclass(frozen=True)
class _Work:
    machine: Machine
    limits: Limits
    ask: Ask
    seed: int

    def run(self, bench: str, design: Design, feedforward: Any = None) -> Record | str:
        """The record of a design, or why there is none; feedforward (n,) [N] in place of the design's."""
        own = design.controller.feedback in (self.machine.control.feedback, self._of_error())
        known = redesigning.references_of(self.machine, design, own_loop=own)
        if feedforward is not None:
            known = References(known.position, feedforward, np.zeros(feedforward.size))
        references = Schedule(design.name, judged_target(self.machine), known)
        controller = None if own else redesigning.controller_file(self.machine, design)
        told = self.ask(bench, references, controller)
        found = _record(told)
        return found if found is not None else _why_not(told)

    def _of_error(self) -> Any:
        law = self.machine.control.law
        return self.machine.control.pid if law is None else law.of_error()


def _why_not(told: Mapping[str, Any]) -> str:
    """Why there was no run."""
    return str(told.get("refused") or told.get("tripped"))


def _record(told: Mapping[str, Any]) -> Record | None:
    """The record of an answer; None where there was no run."""
    from models.records.files import read_record

    return read_record(Path(told["record"]), None, trusted=True) if "record" in told else None


@dataclass(frozen=True)
class Known:
    """What is known of a machine: the verdict, the machine as it is known now, as the re-fit alone leaves it, and
    machines that it could be."""

    told: dict[str, Any]
    better: Machine
    refitted: Machine
    could_be: Sequence[Machine]


def refitted(machine: Machine, record: Record, seed: int) -> Known:
    """What the re-fit of one record tells, which names nothing."""
    fitted = refit(parameters(machine, 1), [record])
    better = machine_of(machine, fitted.candidate)
    few = [machine_of(machine, one) for one in drawn(fitted, None, COMPARED_RUNS, seed)]
    return Known({"outcome": "parameters", "effects": [], "equivalent": []}, better, better, few)


def known(last: Look, settings: active.Settings) -> Known:
    """What the diagnosis of all records tells of a machine."""
    found: Diagnosis = diagnosed(last.baseline, seed=settings.seed, disabled=settings.disabled)
    better = improved_machine(found, "full_circle")
    alone = found.how_far.handover.named(Content.REFITTED)
    told = {
        "outcome": str(found.outcome),
        "effects": list(found.effects),
        "equivalent": [list(group) for group in found.equivalent],
        "partly": list(found.partly),
        "closure": found.how_far.closure,
    }
    try:
        could_be = machines_allowed(found, RUNS, settings.seed)
    except (QuantityError, ValueError):
        could_be = machines_as_stated(better, RUNS, settings.seed)
    return Known(told, better, better if alone is None else alone.machine, could_be)


def _tried(work: _Work, made: redesigning.Redesign, first: Record) -> tuple[Outcome | None, list[str], Record | None]:
    """What is achieved in the end; why the redesign was rolled back, empty where it was not; and its record."""
    machine, before = work.machine, outcome(first, work.machine)
    if made.chosen.kept or before is None:
        return before, [], None
    last = work.run("main", made.chosen.design)
    if isinstance(last, str):
        return before, [last], None
    after = outcome(last, machine)
    lost = list(worse(before, after, machine)) if after is not None else ["it has no outcome"]
    return (before if lost else after), lost, last


def _beside(work: _Work, machine: Machine, refitted: Machine, better: Machine) -> dict[str, Any]:
    """What simpler ways achieve: the re-fit's feedforward alone, and another PID alone."""
    found: dict[str, Any] = {}
    ways: dict[str, Callable[[], Design]] = {
        "refit": lambda: designed(refitted, redesigning.REFIT, effects=False),
        "pid": lambda: redesigning.pid_alone(machine, better),
    }
    for name, make in ways.items():
        try:
            record = work.run("compare", make())
        except ValueError as error:  # there is no such design
            record = str(error)
        found[name] = None if isinstance(record, str) else redesigning.outcome_to_json(outcome(record, machine))
    return found


def learned(work: _Work, design: Design, record: Record, rounds: int, bench: str = "learning") -> Outcome | None:
    """What so many rounds of iterative learning from a record of a design achieve, the best of them and of the record;
    a round that cannot be run ends them."""
    machine, found, last = work.machine, list[Outcome](), record
    for number in range(rounds + 1):
        achieved = outcome(last, machine)
        found += [] if achieved is None else [achieved]
        if number == rounds:
            break
        force = corrected(last, machine, work.limits.feedforward)
        following = work.run(f"{bench}-{1 + number // EACH}", design, force)
        if isinstance(following, str):
            break
        last = following
    return _best(found, machine)


def _best(found: Sequence[Outcome], machine: Machine) -> Outcome | None:
    """The best outcome, by settling and 3 sigma as shares of what is specified; None of none."""
    wanted = machine.specification
    return min(
        found,
        key=lambda one: one.settling / wanted.settling_time + one.dispersion / wanted.tolerance,
        default=None,
    )


def with_truth(machine: Machine, true: Machine, limits: Limits, ask: Ask, seed: int) -> dict[str, Any] | None:
    """What the same designs achieve that are made with the truth: with the true parameters and, for what is wrong
    beside them, the feedforward that learning on the machine itself converges to; the best of its rounds (SI).

    machine: as it is known, whose specification and loop count. None where it could not be run.
    """
    whole = replace(true, specification=machine.specification, control=machine.control)
    work = _Work(machine, limits, ask, seed)
    design = designed(within(whole, limits, _allowed(machine, limits)[0]), "with the truth")
    record = work.run("truth-1", design)
    if isinstance(record, str):
        return None
    return redesigning.outcome_to_json(learned(work, design, record, EACH - 1, "truth"))


def asking(folder: Path, sample_time: float, run: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> Ask:
    """Asks for runs by tables and controller files in a folder; run: has them run; sample_time [s]."""
    count = 0

    def ask(bench: str, references: Schedule, controller: Mapping[str, Any] | None) -> Mapping[str, Any]:
        nonlocal count
        count += 1
        file, other = folder / f"table-{count}.csv", None
        file.write_text(redesigning.table(references.target, references.given, sample_time), encoding="utf-8")
        if controller is not None:
            other = folder / f"controller-{count}.json"
            other.write_text(to_text(controller), encoding="utf-8")
        return run({"bench": bench, "table": str(file), "controller": None if other is None else str(other)})

    return ask
