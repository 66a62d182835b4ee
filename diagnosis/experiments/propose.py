"""The next experiment: the one of a menu that best distinguishes the remaining candidates, by simulation.

Each experiment's references are run on the nominal machine; along the resulting path the effects in question have
distances like those in confusability.py. The shortest experiment that separates them with a margin is proposed or,
where none does, the one that comes closest, and the proposal says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.experiments.confusability import distances, products
from diagnosis.experiments.menu import Experiment, menu
from diagnosis.experiments.schedules import Schedule, together
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.records.motions import pieces
from diagnosis.records.units import loop_time
from diagnosis.where.sentences import words
from models.effects.catalogue import in_order
from models.machine import Machine
from models.quantity import listed
from models.records.record import Record
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

BY_MOTION: Final = ("position", "pitch", "velocity", "velocity_sign")  # coordinates that a kind of motion tells
MAX_COMPARED_EFFECTS: Final = 4  # effects that are compared: the first ones


@dataclass(frozen=True)
class Proposal:
    """What to do next in one sentence, its schedule, and the squared distance [1] that it should reach."""

    sentence: str
    schedule: Schedule
    reaches: float


def next_experiment(
    members: Sequence[str],
    machine: Machine,
    *,
    criteria: Criteria = Criteria(),
    seed: int = 0,
    white_force: float | None = None,
) -> Proposal | None:
    """What to run on the machine to distinguish the members, or to detect the only one; None without members.

    The sentence states the settings with their units; white_force: standard deviation of this drive's white force [N].
    """
    asked = _comparable(members, machine)[:MAX_COMPARED_EFFECTS]
    if not asked:
        return None
    tried = [(one, _reached(machine, one, asked, seed, white_force)) for one in menu(machine)]
    enough = [
        (one, reached) for one, reached in tried if reached >= criteria.experiment_margin * criteria.distinguishable
    ]
    if enough:
        best, reached = min(enough, key=lambda item: item[0].schedule.target.size)
    else:
        best, reached = max(tried, key=lambda item: item[1])
    times = max(int(np.ceil(criteria.distinguishable / max(reached, 1e-9))), 1)
    if times > criteria.experiment_repeats:
        return Proposal(_hopeless(asked, best, reached, len(tried), criteria), best.schedule, reached)
    whole = together(best.schedule.name, [best.schedule] * times)
    return Proposal(_sentence(asked, best, reached, times, len(tried), criteria), whole, times * reached)


def _comparable(names: Sequence[str], machine: Machine) -> list[str]:
    """The effects that are looked for in this machine and change what a model predicts. Those that show in the log only
    do not; those that no record shows stay, because the answer for them is an external gauge."""
    return [name for name in names if name in machine.kinds and machine.kinds[name].shown_in() != "log"]


def _sentence(
    asked: Sequence[str], best: Experiment, reached: float, times: int, tried: int, criteria: Criteria
) -> str:
    how = "is the shortest that" if reached >= criteria.experiment_margin * criteria.distinguishable else "best"
    often = f" {times} times" if times > 1 else ""
    return (
        f"Run{often} {best.words}: of {tried} experiments it {how} {_what(asked)} (chi-square {times * reached:.0f}, "
        f"{criteria.distinguishable:.0f} needed)."
    )


def _hopeless(asked: Sequence[str], best: Experiment, reached: float, tried: int, criteria: Criteria) -> str:
    return (
        f"None of {tried} experiments with this scale and command {_what(asked)}; the best, {best.words}, would reach "
        f"a chi-square of {reached:.2g}, {criteria.distinguishable:.0f} needed: measure the table with an external "
        "gauge as well, such as an interferometer."
    )


def _what(asked: Sequence[str]) -> str:
    return f"separates {_named(asked)}" if len(asked) > 1 else f"shows {_named(asked)} at a typical size"


def _named(names: Sequence[str]) -> str:
    return listed(name.replace("_", " ") for name in names)


def along(coordinate: str | None, machine: Machine, records: Sequence[Record] = ()) -> Proposal | None:
    """The experiment that varies the coordinate the most, so that the force's curve over it can be read off whatever
    the effect is; without a coordinate, or where the records have its motions, one that shows whether the force
    repeats, or None where they have those, too. Settings in the sentence [SI]."""
    *others, last = menu(machine)
    varying, on = [one for one in others if coordinate in one.coordinates], words(coordinate) if coordinate else ""
    told = coordinate in BY_MOTION
    for one in varying:
        if not (told and _is_there(one.schedule, machine, records)):
            sentence = (
                f"No effect of the catalogue explains the residual, which depends most on {on}. "
                f"Run, two times over, {one.words}, and read off the curve of the unknown force over it."
            )
            return Proposal(sentence, together(one.schedule.name, [one.schedule] * 2), float("nan"))
    if _is_there(last.schedule, machine, records):
        return None
    why = "and no single coordinate explains the residual"
    if on:
        why = f"explains the residual, which depends most on {on}"
        why += ", and the records have the motions that vary it" if varying else ""
    sentence = f"No effect of the catalogue {why}. Run {last.words}: it shows whether the force is the same every time."
    return Proposal(sentence, last.schedule, float("nan"))


def _is_there(planned: Schedule, machine: Machine, records: Sequence[Record]) -> bool:
    """Whether the records have motions of every kind that a schedule has: it was run, or what is as good."""
    still, loop = np.zeros(planned.target.size), loop_time(machine)
    made = Record(
        machine.sample_time, planned.target, planned.given.position, planned.given.feedforward, still, planned.target
    )
    kinds, there = ({one.kind for one in pieces(some, loop) if one.kind.stroke > 0} for some in ([made], records))
    return bool(kinds) and kinds <= there


def showing(
    names: Sequence[str],
    machine: Machine,
    *,
    criteria: Criteria = Criteria(),
    seed: int = 0,
    white_force: float | None = None,
) -> Proposal | None:
    """The experiment that detects the most of these effects at their typical sizes [SI], which the records could
    not; None where no experiment of the menu detects any."""
    asked = _comparable(names, machine)
    if not asked:
        return None
    seen = [
        (one, np.diag(_distances(machine, one, asked, seed, white_force)) ** 2 >= criteria.distinguishable)
        for one in menu(machine)
    ]
    best, shown = max(seen, key=lambda item: (np.count_nonzero(item[1]), -item[0].schedule.target.size))
    if not np.any(shown):
        return None
    found = [name for name, there in zip(asked, shown, strict=True) if there]
    sentence = (
        f"Run {best.words}: of {len(seen)} experiments it shows the most of the effects that these records could not "
        f"show, {_named(found)}, if they are of a typical size."
    )
    return Proposal(sentence, best.schedule, criteria.distinguishable)


def _reached(machine: Machine, one: Experiment, asked: Sequence[str], seed: int, white_force: float | None) -> float:
    """The smallest squared distance [1] between any two of the effects, or of the one from the nominal parameters."""
    square = _distances(machine, one, asked, seed, white_force) ** 2
    if len(asked) > 1:
        np.fill_diagonal(square, np.inf)
    return float(np.min(square))


def _distances(machine: Machine, one: Experiment, asked: Sequence[str], seed: int, white_force: float | None) -> Array:
    fitted, record = virtual(machine, one.schedule, seed, white_force)
    return distances(products(fitted, [record], asked), tuple(asked))


def virtual(machine: Machine, planned: Schedule, seed: int = 0, white_force: float | None = None) -> tuple[Fit, Record]:
    """The record that the nominal machine, with the effects that its file states, would make of a schedule, and the
    linearisation along it, with a white force of standard deviation `white_force` [N]; nothing is fitted. Forces in
    [N]."""
    noisy = replace(machine, scale=machine.scale.noisy())
    record = simulate(noisy, machine.feedback_only(), planned.target, given=planned.given, seed=seed).record
    layout = parameters(noisy, 1)
    usual = Candidate(layout, np.zeros(layout.count), in_order(noisy.effects))
    candidate = replace(usual, roughness=(white_force / usual.usual_white_force,)) if white_force else usual
    return fit(candidate, [record], iterations=0), record
