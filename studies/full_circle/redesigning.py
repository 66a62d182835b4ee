"""The redesign for a machine that is known better now, as the report tells it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import reference_delay_samples
from design.deadbeat import DesignError
from design.deployment.drive_file import controller_to_json
from design.redesign.choice import MEASURE_UNITS, Chosen, chosen
from design.redesign.designs import Design, designed, in_place, retuned, retuned_alone
from design.redesign.outcome import Outcome, judged_motions, judged_target
from design.redesign.prediction import Interval, Prediction, moved_by, predicted
from design.redesign.unmet import late_runs, unmet
from models.controller import References
from models.machine import Machine
from models.records.record import Record
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

OLD: Final = "design in place"
REFIT: Final = "new feedforward"
EFFECTS: Final = "new feedforward, effects met"
PID: Final = "another PID too"
PID_ALONE: Final = "another PID alone"
TUNED_FOR: Final = 3  # machines, besides the likeliest, on which a new PID keeps to its bound
THINNED: Final = 150  # points of a motion in a figure


@dataclass(frozen=True)
class Left:
    """The force that no model explains, which acts in the predictions as it did in the records, less each one's mean:
    how large it is [N], and by how much it alone moves the axis under the design in place [m], both in root mean
    square."""

    force: float
    moves: float


@dataclass(frozen=True)
class Redesign:
    """All designs that were looked at, the old one first, what each is expected to achieve on the machines that could
    be this one, which of them runs next, what it and the old one cannot meet, with the reasons, and the force that no
    model explains. notes: those of the reasons that say how the designs were made, and not what to expect of them."""

    machine: Machine
    designs: tuple[Design, ...]
    predictions: tuple[Prediction, ...]
    chosen: Chosen
    unmet: tuple[str, ...]
    unmet_in_place: tuple[str, ...]
    notes: tuple[str, ...] = ()
    left: Left | None = None

    @property
    def old(self) -> Design:
        """The design in place."""
        return self.designs[0]

    def named(self, name: str) -> Design | None:
        """The design of this name."""
        return next((one for one in self.designs if one.name == name), None)

    def prediction(self, design: Design) -> Prediction:
        """What one of the designs is expected to achieve."""
        return self.predictions[self.designs.index(design)]


def old_design(before: Machine) -> Design:
    """The design that the machine file as it was asks for; where there is none, the feedback with the steps of the
    target as its reference."""
    try:
        return designed(before, OLD, every_element=False)
    except DesignError as error:
        bare = before.feedback_only(reference_delay_samples(before))
        wanted = before.specification
        return Design(OLD, bare, wanted.stroke, wanted.settling_time, (f"there is no feedforward: {error}",))


def redesigned(
    before: Machine,
    better: Machine,
    could_be: Sequence[Machine],
    seed: int,
    progress: Callable[[float, str], None],
    *,
    pid: bool = True,
    left: Sequence[Array] = (),
) -> Redesign:
    """The redesign of a machine that was known as `before`, is known as `better`, and could be each of `could_be`.

    pid: whether another one can run in place of the one that does. left: the force (n,) [N] that no model explains, of
    each record that showed one.
    """
    old, notes = old_design(before), list[str]()
    designs = [old]
    progress(0.0, "designing feedforward, compensation and PID anew")
    for name, effects in ((REFIT, False), (EFFECTS, True)):
        if effects and not better.effects:
            continue
        try:
            designs.append(designed(better, name, effects=effects))
        except DesignError as error:
            notes.append(f"there is no {name}: {error}")
    if pid and len(designs) > 1:
        tried = retuned(designs[-1], better, before, could_be[:TUNED_FOR], PID)
        if tried.controller.feedback != designs[-1].controller.feedback:
            designs.append(tried)
        else:
            notes.append(tried.notes[-1])
    found = []
    for number, one in enumerate(designs):
        progress(0.3 + 0.6 * number / len(designs), f"what to expect of the {one.name}")
        found.append(predicted(one, could_be, seed, left))
    taken = chosen(designs, found, better)
    told = [
        tuple(dict.fromkeys((*unmet(one, better, found[designs.index(one)], seed, left), *notes)))
        for one in dict.fromkeys((taken.design, old))
    ]
    made = tuple(dict.fromkeys((*taken.design.notes, *old.notes, *notes)))
    acts = _left(left, old, better, seed)
    return Redesign(better, tuple(designs), tuple(found), taken, told[0], told[-1], made, acts)


def _left(left: Sequence[Array], old: Design, better: Machine, seed: int) -> Left | None:
    if not left:
        return None
    acting = np.concatenate([one - np.mean(one) for one in left])
    return Left(float(np.sqrt(np.mean(acting**2))), moved_by(left, old, better, seed))


def pid_alone(before: Machine, better: Machine) -> Design:
    """The design in place with another PID for the machine as it is known now."""
    return retuned_alone(old_design(before), better, before, PID_ALONE)


def to_json(found: Redesign) -> dict[str, Any]:
    """What the report shows of it (SI)."""
    taken, old = found.chosen, found.old
    return {
        "designs": [
            {
                "name": design.name,
                "taken": design is taken.design,
                "why_not": "" if design is old else taken.reasons.get(design.name, ""),
                **{name: _interval(prediction.interval(name)) for name in MEASURE_UNITS},
                "saturated": prediction.saturated,
                "late": late_runs(prediction, found.machine),
                "notes": list(design.notes),
            }
            for design, prediction in zip(found.designs, found.predictions, strict=True)
        ],
        "runs": int(found.predictions[0].settling.size),
        "level": found.predictions[0].interval("settling").level,
        "kept": taken.kept,
        "chosen": taken.design.name,
        "gains": {name: _interval(gain) for name, gain in taken.gains.items()},
        "unmet": list(found.unmet),
        "unmet_in_place": list(found.unmet_in_place),
        "notes": list(found.notes),
        "left": found.left and {"force_N": found.left.force, "moves_m": found.left.moves},
        "specified": {
            "stroke_m": found.machine.specification.stroke,
            "tolerance_m": found.machine.specification.tolerance,
            "settling_s": found.machine.specification.settling_time,
        },
    }


def restored(shown: Mapping[str, Any]) -> dict[str, Any]:
    """What the report shows of a redesign, with what the design in place cannot meet, which runs again."""
    return {**shown, "unmet": shown["unmet_in_place"]}


def outcome_to_json(found: Outcome | None) -> dict[str, Any] | None:
    """An outcome with units in its names; None stays."""
    if found is None:
        return None
    return {
        "settling_s": found.settling,
        "dispersion_m": found.dispersion,
        "motions": found.motions,
        "never": found.never,
    }


def _interval(one: Interval) -> dict[str, float]:
    return {"median": one.median, "low": one.low, "high": one.high}


def controller_file(machine: Machine, design: Design) -> dict[str, Any]:
    """The content of a controller.json with this design."""
    return controller_to_json(machine, design.controller, design.stroke, design.settling_time)


def references_of(machine: Machine, design: Design, *, own_loop: bool) -> References:
    """x_T*, u_ff and u_rf of a design over the motions that it is judged on.

    own_loop: for the loop that runs on `machine`, its feedback and its reference's delay; else for the design's own.
    """
    from models.controller import references

    target = judged_target(machine)
    return in_place(design, machine, target) if own_loop else references(design.controller, target)


def errors_over_time(record: Record, machine: Machine) -> dict[str, Any]:
    """The errors [m] of the judged motions over the time from their steps [s], thinned for a figure."""
    found = judged_motions(record, machine)
    shortest = min((one.stop - one.start for one in found), default=0)
    step = max(shortest // THINNED, 1)
    shown = slice(0, shortest, step)
    return {
        "time_s": (np.arange(0, shortest, step) * record.sample_time).tolist(),
        "error_m": [
            (one.direction * (record.position[one.start : one.start + shortest] - one.target))[shown].tolist()
            for one in found
        ],
        "reversal": [one.reversal for one in found],
    }


def simulated_record(machine: Machine, design: Design, seed: int) -> Record:
    """A run of a design on a machine, simulated."""
    return simulate(machine, design.controller, judged_target(machine), seed=seed).record


def current_table(machine: Machine) -> str:
    """The table of the design in place over the motions that it is judged on."""
    known = references_of(machine, old_design(machine), own_loop=True)
    return table(judged_target(machine), known, machine.sample_time)


def table(target: Any, known: References, sample_time: float) -> str:
    """References as the table that a machine runs (SI)."""
    from diagnosis.experiments.schedules import Schedule, to_csv

    return to_csv(Schedule("", np.asarray(target), known), sample_time)
