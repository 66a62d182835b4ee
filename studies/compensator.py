"""The number of elements of the friction compensator, where a machine file leaves it to the study ("auto")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from design.controller import assemble_bare, default_feedforward
from design.deadbeat import Deadbeat, DesignError
from design.element_count import EXTRA_COUNTS, SPARE, Choice, choose, largest_count
from design.validation import LONGER_PERIODS, PERIODS
from models.machine import Machine
from models.plant import Plant
from models.quantity import show
from studies.effort import SIMULATED, foresee, period, seconds_a_sample
from studies.options import BadInputError, Options
from studies.study import Progress


@dataclass(frozen=True)
class Counted:
    """A machine that states the number of its compensator's elements; where a study chose it, the study's `choice`."""

    machine: Machine
    choice: Choice | None = None
    results: Mapping[str, Any] = field(default_factory=dict)
    summary: tuple[tuple[str, str], ...] = ()


def with_elements(
    machine: Machine,
    options: Options,
    progress: Progress,
    deadbeat: Deadbeat | None = None,
    *,
    plant: Plant | None = None,
    shares: tuple[float, float] = (0.0, 0.05),
) -> Counted:
    """The machine with a number of elements [-]; where its file says "auto", the fewest with which the design holds.

    deadbeat: the feedforward that the compensator stands beside, and plant, that it is designed for, where that is not
    the machine's own; by default that of `design.controller.default_controller`. The effects that can be met are met.
    shares: of the study's work [1] that are done before and after the search. `results` goes into results.json and
    `summary` into the summary; both are empty where the file states a number.
    Raises BadInputError where there is no such feedforward, or the search would take too long.
    """
    if machine.control.compensator_elements != "auto":
        return Counted(machine)
    _foresee(machine, options, progress)
    try:
        made, known = (deadbeat, plant) if deadbeat else default_feedforward(machine)
    except DesignError as error:
        raise BadInputError(f"--machine: {error}") from error

    def tell(count: int, most: int) -> None:
        share = shares[0] + (shares[1] - shares[0]) * (count - 1) / most
        progress(share, f"trying the friction compensator with {count} of at most {most} elements")

    bare = assemble_bare(machine, made, known)
    choice = choose(machine, bare, stroke=made.stroke, seed=options.seed, further=EXTRA_COUNTS, tell=tell)
    stated = replace(machine, control=replace(machine.control, compensator_elements=choice.count))
    return Counted(stated, choice, {"compensator_elements": _plain(choice)}, (_line(choice),))


def _plain(choice: Choice) -> dict[str, Any]:
    """The chosen number and the curve for results.json; a motion that never settles has no settling time."""
    return {
        "chosen": choice.count,
        "meets": choice.meets,
        "spare": SPARE if choice.spare else None,
        "largest": choice.most,
        "curve": [
            {
                "elements": one.count,
                "settling_s": one.settling_time,
                "dispersion_m": one.dispersion,
                "peak_thrust_N": one.peak_thrust,
                "periodic": bool(one.periodic),
                "meets": bool(one.meets),
            }
            for one in choice.trials
        ],
    }


def _line(choice: Choice) -> tuple[str, str]:
    """The row of the summary: the number, and the settling times that it was chosen by."""
    told = {choice.count - 1, choice.count, choice.most, *(1 << i for i in range(choice.most.bit_length()))}
    curve = ", ".join(f"{one.count}: {show(one.settling_time, 's')}" for one in choice.trials if one.count in told)
    best = next(one for one in choice.trials if one.count == choice.count)
    met = f"none of 1 to {choice.most} elements meets; the best{'' if best.periodic else ', whose periods differ'}"
    if choice.meets:
        met = (
            f"the fewest elements that meet with {SPARE:.0%} of the time to spare"
            if choice.spare
            else "the elements that meet soonest, none with time to spare"
        )
    return f"friction compensator, {met}", f"{choice.count} (settling by elements: {curve})"


def _foresee(machine: Machine, options: Options, progress: Progress) -> None:
    """The time of trying every number of elements, the last of which never becomes periodic."""
    samples, trials = period(machine), largest_count(machine)
    simulated = (trials * PERIODS + sum(LONGER_PERIODS)) * samples
    taken = {"the number of compensator elements": simulated * seconds_a_sample(machine)}
    foresee(taken, max(LONGER_PERIODS) * samples * SIMULATED, options, progress)
