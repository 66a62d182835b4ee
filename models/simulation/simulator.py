"""The sampled loop of Figs. 6 and 13 around the nonsmooth machine; plain numpy, compiled where hot (kernel.py).

Within a sample the modes move exactly under a held input, in substeps of length h. Over a substep the friction is
that of the predicted mid-step position x + v h / 2, up to which every element has moved and slipped: second order in
h, as a midpoint rule is, at one evaluation a substep. The thrust changes where it does: L after the sample that put
it out, also within a sample.

`simulate` runs one machine; `simulate_many` runs variations side by side in one call, equal to `simulate` bit for bit.
A machine's effects (models/effects) act in both. They set in at the first sample, except that the feedback's integral
holds the external force at the start, too: let a run begin with a halt where they have to settle. The drive's offset is
held by an integral from the start, too. A feedback without one holds none of these at the start. A feedback of another
structure than a PID runs as its law (models/feedback), in the loop that also has the effects.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.controller import Controller, References, references
from models.feedback.law import Law, arrays
from models.machine import Machine
from models.plant import Plant, delay_split, matrices, transition
from models.quantity import show
from models.records.record import Record
from models.simulation.effect_kernel import run_effects
from models.simulation.hooks import pack
from models.simulation.kernel import Loop, Run, run_many, run_one

Array = NDArray[np.float64]

LEAST_SUBSTEPS: Final = 10  # in a sample, which many machines need no more than
# [rad]: of the mass on its contacts in a substep. Twenty times as far the scheme is unstable; at this one a feed of
# 20 µm of 0.3 kg on 20 N/µm is 60 nm off, and of the tables at hand some nanometres.
MAX_TURN: Final = 0.1
MAX_SUBSTEPS: Final = 20_480  # in a sample, beyond which a friction counts as a mistake
BEYOND: Final = 10.0  # times its limit, up to which an element may start: it slips at once
LOGGED: Final = ("reading", "command", "position", "friction")  # signals that a run writes at every sample


@dataclass(frozen=True, eq=False)  # arrays have no one answer to ==
class Response:
    """What a simulated run logged, and what only a simulation knows: x [m] and friction [N] at the samples (n,).

    elements: the displacements z (N,) [m] of the friction elements at the end of the run.

    >>> response = pos.simulate(machine, controller, target)
    >>> response
    Response(2000 samples every 500 µs, position ... to ... µm, friction up to ... N)
    """

    record: Record
    position: Array
    friction: Array
    elements: Array

    def __repr__(self) -> str:
        low, high, most = np.min(self.position), np.max(self.position), np.max(np.abs(self.friction))
        return (
            f"Response({self.position.size} samples every {show(self.record.sample_time, 's')}, position "
            f"{show(float(low), 'm')} to {show(float(high), 'm')}, friction up to {show(float(most), 'N')})"
        )

    def last(self, count: int) -> Response:
        """The last `count` samples, in memory of their own, so that whoever keeps them lets the rest go."""
        part = self.record.last(count)
        signals = (part.target, part.reference, part.feedforward, part.command, part.position)
        record = Record(part.sample_time, *(signal.copy() for signal in signals))
        return Response(record, self.position[-count:].copy(), self.friction[-count:].copy(), self.elements.copy())


def simulate(
    machine: Machine,
    controller: Controller,
    target: ArrayLike,
    *,
    substeps: int | None = None,
    seed: int = 0,
    initial_friction: ArrayLike | None = None,
    given: References | None = None,
    origin: float = 0.0,
) -> Response:
    """Response to a target r (n,) [m], from rest at `origin` [m] with the feedback's integral holding the friction's
    force.

    A feedback without an integral holds nothing: the friction then moves the table at the start.

    substeps: in a sample; None: as many as `substeps_needed`. seed: of the scale's noise. initial_friction:
    displacements (N,) [m] of the elements, default 0. given: x_T*, u_ff, u_rf (n,) [m], [N], [N] instead of those that
    the controller makes of the target, such as a slow stroke with an excitation on u_ff. origin: where on its way the
    table stands at the start, which matters to forces that depend on the place. Raises ValueError if machine and
    controller differ in sample time, and for numbers that are not finite, other shapes, substeps below 1 and elements
    far beyond their limits.

    >>> target = pos.feeding_sequence(20e-6, 5, 0.1, machine.sample_time)
    >>> response = pos.simulate(machine, controller, target)
    >>> bool(abs(response.position[199] - 20e-6) < 2e-6)  # within 2 µm at the end of the first motion
    True
    """
    r = _checked(target, origin)
    way = r - origin  # seen from where the run begins
    known = references(controller, way) if given is None else replace(given, position=given.position - origin)
    prepared = _prepare(machine, controller, known, substeps, seed, initial_friction)
    response = _alone(machine, controller.law, way, prepared, origin)
    return response if origin == 0.0 else _seen_from(-origin, response)


def _checked(target: ArrayLike, origin: float = 0.0) -> Array:
    """The target (n,) [m] as numbers. Raises ValueError for what is no row of finite ones, or an origin [m] that is
    none."""
    r = np.asarray(target, float)
    if r.ndim != 1 or r.size == 0 or not np.all(np.isfinite(r)):
        raise ValueError(f"target: must be a row of finite numbers of shape (n,) [m], and is of shape {r.shape}")
    if not math.isfinite(origin):
        raise ValueError(f"origin: must be a finite place [m], not {origin}")
    return r


def _seen_from(place: float, response: Response) -> Response:
    """A response whose positions are from another place [m]."""
    record = response.record
    moved = replace(
        record, target=record.target - place, reference=record.reference - place, position=record.position - place
    )
    return replace(response, record=moved, position=response.position - place)


def simulate_many(
    machines: Sequence[Machine],
    controllers: Sequence[Controller],
    target: ArrayLike,
    *,
    substeps: int | None = None,
    seed: int = 0,
    initial_friction: ArrayLike | Sequence[ArrayLike] | None = None,
    given: References | Sequence[References] | None = None,
) -> tuple[Response, ...]:
    """`simulate` for machines[i] with controllers[i], all over the same target, in one call; the same options.

    given: for all machines, or given[i] for each; initial_friction: (N,) for all, or initial_friction[i] for each [m].
    Machines with equal numbers of modes and elements and equal delays in whole samples run side by side, except those
    with effects or a law, which run one by one.
    """
    r = _checked(target)
    starts = [None] * len(machines) if initial_friction is None else _each_start(initial_friction, len(machines))
    if given is None:
        made = {controller: references(controller, r) for controller in set(controllers)}  # often there is but one
        given = [made[controller] for controller in controllers]
    known = [given] * len(machines) if isinstance(given, References) else given
    prepared = [
        _prepare(machine, controller, its, substeps, seed, start)
        for machine, controller, its, start in zip(machines, controllers, known, starts, strict=True)
    ]
    groups: dict[object, list[int]] = {}
    responses: dict[int, Response] = {}
    for i, (loop, run) in enumerate(prepared):
        if machines[i].effects or controllers[i].law is not None:
            responses[i] = _alone(machines[i], controllers[i].law, r, prepared[i])
            continue
        key = (
            loop.sample_time,
            *loop.delays,
            *loop.counts,
            run.state.shape,
            run.z.shape,
            bool(np.any(loop.damping > 0)),
        )
        groups.setdefault(key, []).append(i)
    for members in groups.values():
        loop, run = _side_by_side([prepared[i] for i in members])
        run_many(loop, run)
        for lane, i in enumerate(members):
            responses[i] = _response(machines[i], r, _lane(run, lane))
    return tuple(responses[i] for i in range(len(prepared)))


def _each_start(initial_friction: ArrayLike | Sequence[ArrayLike], count: int) -> list[ArrayLike | None]:
    """The start of each of `count` machines [m], of one for all or of one for each."""
    if all(np.ndim(one) == 0 for one in initial_friction):  # type: ignore[union-attr]
        return [np.asarray(initial_friction, float)] * count
    return list(initial_friction)  # type: ignore[arg-type]


def _alone(
    machine: Machine, law: Law | None, target: Array, prepared: tuple[Loop, Run], origin: float = 0.0
) -> Response:
    """The response of one machine under its PID, or under a law, its positions from where it begins [m]."""
    loop, run = prepared
    if machine.effects or law is not None:
        run_effects(loop, run, pack(machine.effects, run.z.size), arrays(law), origin, _by_friction(machine))
    else:
        run_one(loop, run)
    return _response(machine, target, run)


def _prepare(
    machine: Machine,
    controller: Controller,
    given: References,
    substeps: int | None,
    seed: int,
    initial_friction: ArrayLike | None,
) -> tuple[Loop, Run]:
    if controller.sample_time != machine.sample_time:
        raise ValueError(
            f"the controller runs at {controller.sample_time:g} s and the machine at {machine.sample_time:g} s; "
            "design the controller for this machine's sample time"
        )
    friction, pid = machine.friction, controller.pid
    if substeps is not None and not (float(substeps).is_integer() and substeps >= 1):
        raise ValueError(f"substeps: must be a whole number from 1 on, not {substeps}")
    sampled = substeps_of(machine, substeps)
    loop = Loop(
        sample_time=machine.sample_time,
        delays=np.array([sampled.delay, controller.reference_delay]),
        counts=sampled.counts,
        step=sampled.step,
        phi=sampled.phi,
        gamma=sampled.gamma,
        stiffness=np.array(friction.stiffness),
        limit=np.array(friction.limit),
        damping=np.array(friction.damping),
        gains=np.array([pid.kp, pid.ki, pid.kd, pid.derivative_filter]),
        thrust_limit=machine.drive.rated_thrust,
        resolution=machine.scale.resolution,
        offset=machine.drive.offset,
    )
    z = np.zeros(len(friction.stiffness)) if initial_friction is None else np.array(initial_friction, float)
    if z.shape != loop.limit.shape or not np.all(np.abs(z) <= BEYOND * loop.limit):
        raise ValueError(
            f"initial_friction: must be the displacements of {loop.limit.size} elements [m], none far beyond its limit"
        )
    n, noise = given.position.size, machine.scale.noise
    run = Run(
        reference=given.position,
        feedforward=given.feedforward + given.compensation,
        noise=noise * np.random.default_rng(seed).standard_normal(n) if noise > 0 else np.zeros(n),
        start=float(loop.stiffness @ z) + machine.drive.offset if controller.has_integral else 0.0,
        state=np.zeros((sampled.phi.shape[1], 2)),
        z=z,
        **{name: np.empty(n) for name in LOGGED},
    )
    return loop, run


@dataclass(frozen=True)
class Substeps:
    """The plant, with the modes of its effects, over the substeps of a sample's two parts.

    counts (2,) and step (2,) [s]: how many they are and how long; delay: whole samples of dead time; phi (2, m, 4) and
    gamma (2, m, 2) of each part and mode, see kernel.py; by_friction: how many of the modes, the last ones, the
    friction drives alone.
    """

    counts: NDArray[np.int64]
    step: Array
    delay: int
    phi: Array
    gamma: Array
    by_friction: int


def substeps_needed(machine: Machine, least: int = LEAST_SUBSTEPS) -> int:
    """How many substeps of a sample follow the quickest motion that the friction allows: `least`, doubled until the
    mass on all contacts turns by MAX_TURN in one at most, and their damping takes as small a part of its speed.

    Raises ValueError where more than MAX_SUBSTEPS were needed.
    """
    plant, friction = _with_effects(machine), machine.friction
    mobility = plant.thrust_constant * sum(abs(mode.gain) for mode in plant.modes)
    turn = machine.sample_time * math.sqrt(sum(friction.stiffness) * mobility)
    loss = machine.sample_time * sum(friction.damping) * mobility
    count = least
    while max(turn, loss) > MAX_TURN * count and count <= MAX_SUBSTEPS:
        count *= 2
    if count > MAX_SUBSTEPS:
        name, size, unit = (
            ("stiffness", sum(friction.stiffness), "N/m")
            if turn > loss
            else ("damping", sum(friction.damping), "N s/m")
        )
        raise ValueError(
            f"friction.{name}: {show(size, machine.unit(unit), 3)} on {show(1 / mobility, machine.unit('kg'), 3)} is "
            f"too quick to simulate at {show(machine.sample_time, 's')}: a sample takes more than {MAX_SUBSTEPS} "
            "steps; correct it, or the sample time"
        )
    return count


def _with_effects(machine: Machine) -> Plant:
    """The plant with the modes that its effects add, last those that the friction drives."""
    added = sorted(machine.effects, key=lambda effect: effect.friction_drives)
    return replace(machine.plant, modes=sum((effect.modes() for effect in added), machine.plant.modes))


def _by_friction(machine: Machine) -> int:
    """How many modes the friction drives alone, the last ones of `_with_effects`."""
    return sum(len(effect.modes()) for effect in machine.effects if effect.friction_drives)


def substeps_of(machine: Machine, substeps: int | None = None) -> Substeps:
    """The machine's plant over `substeps` in a sample, by default as many as are needed; SI units."""
    plant = _with_effects(machine)
    count = substeps_needed(machine) if substeps is None else substeps
    counts, step, delay = _parts(plant.dead_time, machine.sample_time, count)
    modes = len(plant.modes)
    phi, gamma = np.zeros((2, modes, 4)), np.zeros((2, modes, 2))
    a, b, _ = matrices(plant)
    for part in np.flatnonzero(counts):
        whole, held = transition(a, b, step[part])
        for j in range(modes):  # the modes do not act on each other: Phi is block diagonal
            phi[part, j] = whole[2 * j : 2 * j + 2, 2 * j : 2 * j + 2].ravel()
            gamma[part, j] = held[2 * j : 2 * j + 2, 0]
    return Substeps(counts, step, delay, phi, gamma, _by_friction(machine))


def _parts(dead_time: float, sample_time: float, substeps: int) -> tuple[NDArray[np.int64], Array, int]:
    """Substeps before and after the thrust changes in a sample, their lengths [s], and the delay in whole samples."""
    delay, rest = delay_split(dead_time, sample_time)
    early = (
        min(max(round(substeps * rest / sample_time), 1), substeps - 1) if rest > 0 and substeps > 1 else int(rest > 0)
    )
    late = max(substeps - early, 1)
    step = np.array([rest / early if early else sample_time, (sample_time - rest) / late])
    return np.array([early, late]), step, delay


def _side_by_side(prepared: list[tuple[Loop, Run]]) -> tuple[Loop, Run]:
    """One Loop and one Run whose arrays have the machines as their first axis; what a run writes is made anew."""
    loops, runs = zip(*prepared, strict=True)
    first: Loop = loops[0]
    stacked = Loop._make(np.stack(column) for column in zip(*loops, strict=True))
    loop = stacked._replace(sample_time=first.sample_time, delays=first.delays, counts=first.counts)
    columns = dict(zip(Run._fields, zip(*runs, strict=True), strict=True))
    shape = len(runs), runs[0].reference.size
    signals = {name: np.empty(shape) if name in LOGGED else np.stack(columns[name]) for name in Run._fields}
    return loop, Run(**signals)


def _lane(run: Run, lane: int) -> Run:
    return Run._make(signal[lane] for signal in run)


def _response(machine: Machine, target: Array, run: Run) -> Response:
    record = Record(machine.sample_time, target, run.reference, run.feedforward, run.command, run.reading)
    return Response(record, run.position, run.friction, run.z)
