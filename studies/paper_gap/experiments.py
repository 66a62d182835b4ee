"""Experiments that could discriminate: what is run, and its departure from the model's prediction.

An experiment is run twice on a simulated table, with the candidate and without; its observables are
read from the difference of the two, in steps: of the scale's resolution, or of the thrust that one such step makes
through the proportional gain. So what the model of the table predicts anyway counts for nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.controller import paper_controller
from design.deadbeat import DesignError
from diagnosis.experiments.schedules import Schedule, strokes
from models.controller import Controller, References, references
from models.friction import follow
from models.machine import Machine
from models.quantity import listed, show
from models.records.record import Record
from models.simulation.simulator import simulate
from reports.units import length_unit, time_unit
from studies.paper_gap import observables
from studies.paper_gap.candidates import Table
from studies.paper_gap.explore import Draw, rest
from studies.paper_gap.observables import MOVES, Departure, Observable, Plan

Array = NDArray[np.float64]

DWELLS: Final = (2.4, 4.8, 10.0, 20.0, 40.0, 60.0)  # specified settling times
SIZES: Final = (0.25, 0.5, 0.75, 1.0)  # strokes; the deadbeat's thrust grows with the stroke, and the next is beyond it
TIMES: Final = (1.0, 1.1, 1.2, 1.3, 1.5)  # of the specified time until x_T* rests
SLOW_STROKE: Final = (100.0, 80.0)  # strokes, in so many settling times
STILL: Final = 400.0  # settling times
PAUSE: Final = 10.0  # settling times between motions where the experiment does not say another
FOUR: Final = "a reversal and an inching motion up and the same down"  # MOVES


@dataclass(frozen=True)
class Experiment:
    """name; `words`, the settings in words; what to run on a table; and what to read."""

    name: str
    words: str
    plan: Callable[[Machine, Controller], Plan]
    observables: tuple[Observable, ...]


def menu(machine: Machine) -> tuple[Experiment, ...]:
    """The experiments, with the settings of this machine's motions."""
    wanted = machine.specification
    stroke, settling = show(wanted.stroke, "m"), show(wanted.reference_settling_time, "s")
    (micro, length), (milli, time) = length_unit(wanted.stroke), time_unit(wanted.settling_time)
    rests, pause = _listed(DWELLS, wanted.settling_time), show(PAUSE * wanted.settling_time, "s")
    sizes, times = _listed(SIZES, micro * wanted.stroke), _listed(TIMES, milli * wanted.reference_settling_time)
    way, speed = _slow_stroke(machine)
    return (
        Experiment(
            "rests of many lengths",
            f"motions of {stroke} after rests of {rests} s, {FOUR} after each",
            _rests,
            observables.RESTS,
        ),
        Experiment(
            "a ladder of strokes",
            f"motions of {sizes} {length} whose reference rests after {settling}, {FOUR}, {pause} apart",
            _ladder,
            observables.STROKES,
        ),
        Experiment(
            "a ladder of settling times",
            f"motions of {stroke} whose reference rests after {times} {time} (the thrust falls from rung to rung), "
            f"{FOUR}, {pause} apart",
            _times,
            observables.TIMES,
        ),
        Experiment(
            "a hold",
            f"nothing moves for {show(STILL * wanted.settling_time, 's')} after a motion of {stroke}",
            _hold,
            observables.HOLD,
        ),
        Experiment(
            "a slow stroke",
            f"a stroke of {show(way, 'm')} there and back at {show(speed, 'm/s')}",
            _slow,
            observables.SLOW_STROKES,
        ),
    )


def depart(experiment: Experiment, table: Table, draw: Draw) -> Departure:
    """The experiment on a table with the draw's candidate, minus the same without it."""
    machine, controller = table
    lead = rest(machine, draw.point)
    plan = experiment.plan(machine, controller)
    true, _ = draw.case.candidate().put(table, draw.values)
    with_it, without = (_run(one, controller, plan.schedule, lead) for one in (true, machine))
    reading, command = with_it.position - without.position, with_it.command - without.command
    return Departure(plan, machine.sample_time, machine.specification.settling_time, reading, command)


def measure(experiment: Experiment, table: Table, draw: Draw) -> list[float]:
    """The observables [steps] of an experiment."""
    machine, _ = table
    departure = depart(experiment, table, draw)
    step = {"m": machine.scale.resolution, "N": machine.scale.resolution * machine.control.pid.kp}
    return [one.read(departure) / step[one.unit] for one in experiment.observables]


def _run(machine: Machine, controller: Controller, planned: Schedule, lead: int) -> Record:
    """The record of a schedule, behind `lead` samples of rest."""
    still, given = np.zeros(lead), planned.given
    parts = (given.position, given.feedforward, given.compensation)
    rested = References(*(np.concatenate([still, part]) for part in parts))
    target = np.concatenate([still, planned.target])
    return simulate(machine, controller, target, given=rested).record.last(planned.target.size)


Rung = tuple[float, float, Controller]  # stroke [m], rest [s] before each motion, and the controller


def _moves(machine: Machine, rungs: Sequence[Rung]) -> Plan:
    """Up, up, down, down on each rung, after a warm-up rung; the feedforward of each rung's controller."""
    ts = machine.sample_time
    levels, at, moves, spans = [np.zeros(1)], 1, [], []
    first_stroke, first_rest, first = rungs[0]
    for stroke, pause, controller in [(first_stroke, first_rest, first), *rungs]:
        samples = round(pause / ts)
        begun = at
        for number, direction in enumerate((1, 1, -1, -1)):
            levels.append(np.full(samples, stroke * min(number + 1, 3 - number)))
            moves.append((at, direction, (len(controller.n_ff) - 1) * ts))
            at += samples
        spans.append((begun, at, controller))
    target = np.concatenate(levels)
    position, feedforward = np.zeros(at), np.zeros(at)
    for begun, end, controller in spans:  # each rung ends at rest at 0, so its references are its own
        its = references(controller.without_compensation(), target[begun:end])
        position[begun:end], feedforward[begun:end] = its.position, its.feedforward
    return Plan(
        _compensated(first, target, position, feedforward),
        tuple(moves[len(MOVES) :]),
        tuple(stroke for stroke, _, _ in rungs),
    )


def _compensated(controller: Controller, target: Array, position: Array, feedforward: Array) -> Schedule:
    """A schedule with the friction compensation that follows its x_T*."""
    rfm = controller.friction_compensation
    thrust = np.zeros(position.size) if rfm is None else follow(rfm, position)[0]
    return Schedule("planned", target, References(position, feedforward, thrust))


def _rests(machine: Machine, controller: Controller) -> Plan:
    wanted = machine.specification
    return _moves(machine, [(wanted.stroke, dwell * wanted.settling_time, controller) for dwell in DWELLS])


def _ladder(machine: Machine, controller: Controller) -> Plan:
    wanted = machine.specification
    return _moves(machine, [(size * wanted.stroke, PAUSE * wanted.settling_time, controller) for size in SIZES])


def _times(machine: Machine, controller: Controller) -> Plan:
    wanted = machine.specification
    laws = [_in(machine, time * wanted.reference_settling_time) or controller for time in TIMES]
    return _moves(machine, [(wanted.stroke, PAUSE * wanted.settling_time, law) for law in laws])


def _in(machine: Machine, time: float) -> Controller | None:
    """The controller whose x_T* rests after `time` [s]; None if no such design exists."""
    wanted = replace(machine.specification, reference_settling_time=time)
    try:
        return paper_controller(replace(machine, specification=wanted))
    except DesignError:
        return None


def _hold(machine: Machine, controller: Controller) -> Plan:
    samples = round(STILL * machine.specification.settling_time / machine.sample_time)
    target = np.concatenate([np.zeros(200), np.full(samples, machine.specification.stroke)])
    known = references(controller, target)
    return Plan(Schedule("hold", target, known))


def _slow(machine: Machine, controller: Controller) -> Plan:
    way, speed = _slow_stroke(machine)
    planned = strokes(machine, way, (speed,))
    given = planned.given
    return Plan(_compensated(controller, planned.target, given.position, given.feedforward))


def _slow_stroke(machine: Machine) -> tuple[float, float]:
    """The slow stroke [m] and its speed [m/s]."""
    wanted, (strokes_long, times) = machine.specification, SLOW_STROKE
    way = strokes_long * wanted.stroke
    return way, way / (times * wanted.settling_time)


def _listed(numbers: Sequence[float], factor: float) -> str:
    """Numbers times a factor, as text."""
    return listed(f"{factor * number:g}" for number in numbers)
