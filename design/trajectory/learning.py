"""Learning on the axis itself: a wipe, then motions whose thrust at rest and tracking errors tell what the machine is.

Nothing is known of the friction's state at the start. The wipe brings every element to its limit, in the machine and
in the compensator; from then on the compensator's elements know their past. The thrust at rest tells the friction's
force and length and the constant force, and the mean tracking error of the motions the mass and the dead time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.trajectory.compensator import GRID_LENGTHS, LENGTHS, MIN_FORCE_RATIO, Learned, learn
from design.trajectory.schemes import Scheme
from design.validation import respond, sequence
from design.wiping import carried_on, wipe, wipe_references
from models.controller import Controller, References
from models.machine import Machine
from models.records.record import Record, motions
from models.simulation.simulator import Response
from models.variation import Variation, at_mode, varied

Array = NDArray[np.float64]

REST: Final = 0.8  # of the specified settling time: the thrust that holds the table is averaged over so much of a
# motion's end
LEARNING_PERIODS: Final = 2  # periods of the sequence to learn from, the second with what the first has told
MAX_RELATIVE_ERROR: Final = 0.5  # error of the mass, and of the dead time, that is believed at most [1]
LOOK_SETTLING_TIMES: Final = 2.0  # specified settling times behind the step over which a motion's error is looked at
RESTED: Final = 5  # specified settling times behind its step at which a drive takes the thrust of a motion's rest
NOISE: Final = 1e-3  # of the stroke, by which the errors differ from their linear model
# The relative error [1] of each that is likely, as a standard deviation; the forces are known from the wipe already.
LIKELY: Final = {
    "mass": 0.02,
    "dead_time": 0.1,
    "friction_force": 0.02,
    "friction_length": 0.1,
    "frequency": 0.02,
    "modal_gain": 0.1,
}


@dataclass(frozen=True)
class LearnedTable:
    """A table that has learned: what was learned, the references of the sequence that follows, and where the table's
    own elements (N,) [m] stand at its start. errors: of mass [1] and dead time [s]."""

    learned: Learned
    controller: Controller
    given: References
    elements: Array
    errors: Array


def motions_to_learn(nominal: Machine) -> int:
    """The motions [-] after which all is learned: the two of the wipe, and those of LEARNING_PERIODS periods."""
    return 2 + LEARNING_PERIODS * 2 * nominal.specification.motions


def learned_tables(
    machines: Sequence[Machine],
    nominal: Machine,
    scheme: Scheme,
    stroke: float,
    seed: int,
    starts: Sequence[Array] | None = None,
) -> list[LearnedTable]:
    """What the controller learns on each table from a wipe and LEARNING_PERIODS periods of the sequence with strokes
    [m].

    seed: of the scale's noise. starts: where each table's elements (N,) [m] stand before the wipe; default 0. The
    controller knows what it puts out itself and the scale's readings; nothing else of the table.
    """
    known, rests = wipe_references(nominal, wipe(nominal))
    path, target = known.position, sequence(nominal, stroke, periods=1)
    responses = respond(machines, scheme.controller, path, given=known, seed=seed, initial_friction=starts)
    window = max(round(hold_time(nominal) / nominal.sample_time), 1)
    states = [_after_wipe(scheme, path, rests, response, window) for response in responses]
    sensitivity = None if scheme.adapted is None else sensitivities(nominal, scheme, stroke)
    for turn in range(LEARNING_PERIODS):
        responses = respond(
            machines,
            [one.scheme.controller for one in states],
            target,
            given=[_continued(one, target) for one in states],
            seed=seed + 1 + turn,
            initial_friction=[one.elements for one in states],
        )
        states = [
            _after_period(one, nominal, target, response, window, sensitivity)
            for one, response in zip(states, responses, strict=True)
        ]
    whole = sequence(nominal, stroke)
    return [
        LearnedTable(one.learned, one.scheme.controller, _continued(one, whole), one.elements, one.errors)
        for one in states
    ]


def path_to_learn(nominal: Machine, scheme: Scheme, stroke: float) -> Array:
    """The elements' path (n,) [m] through the wipe and all motions over a stroke [m] that are learned from."""
    known, _ = wipe_references(nominal, wipe(nominal))
    return np.append(known.position, np.tile(scheme.path(sequence(nominal, stroke, periods=1)), LEARNING_PERIODS))


@dataclass(frozen=True)
class _LearningState:
    """A table on its way: its scheme by now, what it has learned, the elements' path (n,) [m] since the wipe began, the
    wipe's and the latest rests (k,) on it and the thrust there (k,) [N], and the table's own elements (N,) [m]."""

    scheme: Scheme
    learned: Learned
    path: Array
    rests: NDArray[np.int64]
    hold: Array
    elements: Array
    errors: Array


def _after_wipe(
    scheme: Scheme, path: Array, rests: NDArray[np.int64], response: Response, window: int
) -> _LearningState:
    """What is known after the wipe: the forces, but not yet the lengths."""
    hold = _held(response, rests, window)
    found = learn(scheme.known, path, rests, hold, length=False)
    return _LearningState(scheme, found, path, rests, hold, response.elements, np.zeros(2))


def _after_period(
    one: _LearningState,
    nominal: Machine,
    target: Array,
    response: Response,
    window: int,
    sensitivity: Sensitivity | None,
) -> _LearningState:
    """What is known after another period."""
    ends = np.array([motion.stop - 1 for motion in motions(target)])
    rests = np.append(one.rests[:2], one.path.size + ends)
    path = np.append(one.path, one.scheme.path(target))
    hold = np.append(one.hold[:2], _held(response, ends, window))  # the wipe's and the latest, whose motions were best
    scheme, errors = one.scheme, one.errors
    if sensitivity is not None and scheme.adapted is not None:
        told = tracking_error(target, response.record, scheme.controller, sensitivity.faultless.size)
        most = MAX_RELATIVE_ERROR * np.array([1.0, nominal.plant.dead_time])
        errors = np.clip(errors + sensitivity.explain(told), -most, most)
        scheme = scheme.adapted(varied(nominal, Variation(mass=float(errors[0]), dead_time=float(errors[1]))))
    found = learn(one.scheme.known, path, rests, hold)
    return _LearningState(scheme, found, path, rests, hold, response.elements, errors)


def _continued(one: _LearningState, target: Array) -> References:
    """x_T* [m], u_ff and u_rf [N] over a target (n,) [m] behind the path learned from, which ends at rest at 0."""
    friction, scheme = one.learned.friction, one.scheme
    return carried_on(friction, one.path, scheme.path(target), scheme.references(friction, target))


def looked_at(machine: Machine) -> int:
    """The samples behind a step over which a motion's tracking error is looked at; the next motion is none of it."""
    look = min(LOOK_SETTLING_TIMES * machine.specification.settling_time, _rest_time(machine))
    return round(look / machine.sample_time)


def _rest_time(machine: Machine) -> float:
    """How long after its step [s] a drive takes the thrust of a motion's rest: before the next one."""
    wanted = machine.specification
    return min(wanted.interval - machine.sample_time, RESTED * wanted.settling_time)


def hold_time(machine: Machine) -> float:
    """How long before the end of a motion the thrust is averaged that holds the table [s]: not before it may settle."""
    wanted = machine.specification
    return min(REST * wanted.settling_time, wanted.interval - wanted.settling_time)


def _held(response: Response, rests: NDArray[np.int64], window: int) -> Array:
    """The thrust [N] that held the table, averaged over `window` samples before each of the samples `rests` (k,)."""
    command = response.record.command
    return np.array([np.mean(command[k - window : k + 1]) for k in rests])


@dataclass(frozen=True)
class Sensitivity:
    """The mean error of a period's motions without any fault (n,) [m], and the gain (2, n) that turns what differs
    from it into the errors of mass [1] and dead time [s]."""

    faultless: Array
    gain: Array

    def explain(self, error: Array) -> Array:
        """The errors of mass [1] and dead time [s] that a mean error (n,) [m] tells."""
        return self.gain @ (error - self.faultless)


def sensitivities(nominal: Machine, scheme: Scheme, stroke: float) -> Sensitivity:
    """By simulations of the nominal machine with an error of one thing at a time, each of its likely size; stroke [m].

    Least squares with these sizes as prior deviations. Errors of the friction and of the modes are among the causes, so
    that what they do is not taken for the mass or the dead time; they are not corrected by it.
    """
    exact = replace(nominal, scale=replace(nominal.scale, resolution=0.0, noise=0.0))
    target, causes = sequence(nominal, stroke, periods=2), _causes(nominal)
    half, count = target.size // 2, looked_at(nominal)
    given = scheme.references(scheme.known, target)
    machines = [exact, *(varied(exact, each) for each in causes)]
    faultless, *off = [
        tracking_error(target[half:], response.record.last(half), scheme.controller, count)
        for response in respond(machines, scheme.controller, target, given=given)
    ]
    by = np.array(off).T - faultless[:, None]
    noise = nominal.scale.deviation + NOISE * stroke
    gain = np.linalg.solve(np.eye(len(causes)) + by.T @ by / noise**2, by.T / noise**2)
    return Sensitivity(faultless, np.array([[causes[0].mass], [causes[1].dead_time]]) * gain[:2])


def length_candidates() -> Array:
    """The presliding lengths (K,) [1], over the nominal one, that a drive tries; the nominal one is among them."""
    lengths = np.geomspace(*LENGTHS, GRID_LENGTHS)
    lengths[int(np.argmin(np.abs(lengths - 1)))] = 1.0
    return lengths


def position_by_dead_time(nominal: Machine, scheme: Scheme, stroke: float) -> Array:
    """What x_T*'s response to a step of the target gains per second, and per second squared, of a longer dead time.

    (2, M) [1/s], [1/s^2], through the responses of schemes that are adapted to a dead time that is off by LIKELY either
    way; stroke [m]. A reference that waits a sample more for it is a response that begins a sample later. Raises
    ValueError for a scheme that cannot be adapted.
    """
    if scheme.adapted is None:
        raise ValueError("this scheme is not adapted to a dead time; give a history-aware one")
    size = sequence(nominal, stroke, periods=1).size
    step, off = np.full(size, stroke), LIKELY["dead_time"] * nominal.plant.dead_time
    adapted = [scheme, *(scheme.adapted(varied(nominal, Variation(dead_time=error))) for error in (off, -off))]
    designed, later, earlier = (_response(one, scheme, step) for one in adapted)
    if off == 0:
        return np.zeros((2, 1))
    rows = np.array([(later - earlier) / (2 * off), (later + earlier - 2 * designed) / (2 * off**2)])
    count = int(np.max(np.flatnonzero(np.any(rows != 0, axis=0)), initial=0)) + 1
    return rows[:, :count]


def _response(one: Scheme, designed: Scheme, step: Array) -> Array:
    """x_T* (n,) [m/m] after a step (n,) [m], as the feedback of the scheme as designed has to be given it."""
    response = one.references(one.known, step).position / step
    later = one.controller.reference_delay - designed.controller.reference_delay
    whole = np.concatenate([np.zeros(max(later, 0)), response[max(-later, 0) :], np.ones(max(-later, 0))])
    return whole[: step.size]


def learning_to_json(known: Sensitivity, nominal: Machine, scheme: Scheme, stroke: float) -> dict[str, Any]:
    """What controller.json tells of learning over a stroke [m], for a drive that does it itself."""
    per_second, per_square = position_by_dead_time(nominal, scheme, stroke)
    return {
        "motions": motions_to_learn(nominal),
        "rounds": LEARNING_PERIODS,
        "motions_per_round": 2 * nominal.specification.motions,
        "rest_s": _rest_time(nominal),
        "hold_s": hold_time(nominal),
        "length_shares": list(LENGTHS),
        "length_candidates": length_candidates(),
        "least_force": MIN_FORCE_RATIO,
        "faultless_error_m": known.faultless,
        "mass_error_per_m": known.gain[0],
        "dead_time_error_s_per_m": known.gain[1],
        "largest_error": MAX_RELATIVE_ERROR,
        "largest_dead_time_error_s": MAX_RELATIVE_ERROR * nominal.plant.dead_time,
        "position_by_dead_time": {"per_s": per_second, "per_s2": per_square},
    }


def _causes(nominal: Machine) -> list[Variation]:
    """Errors of mass, dead time, friction and each mode, one at a time."""
    plant = nominal.plant
    found = [
        Variation(mass=LIKELY["mass"]),
        Variation(dead_time=LIKELY["dead_time"] * plant.dead_time),
        Variation(friction_force=LIKELY["friction_force"]),
        Variation(friction_length=LIKELY["friction_length"]),
    ]
    for i in plant.flexible:
        found.append(Variation(frequency=at_mode(plant, i, LIKELY["frequency"])))
        found.append(Variation(modal_gain=at_mode(plant, i, LIKELY["modal_gain"])))
    return found


def tracking_error(target: Array, record: Record, controller: Controller, count: int) -> Array:
    """How far the scale reads beyond the reference that the feedback compares it with, (count,) [m] behind the step,
    averaged over the motions of a target (n,) [m], each turned upwards."""
    wait = controller.reference_delay
    known = np.append(np.full(wait, target[-1]), record.reference[: record.reference.size - wait])
    error = record.position - known
    found = [one.direction * error[one.start : one.start + count] for one in motions(target, float(target[-1]))]
    return np.asarray(np.mean(found, axis=0))
