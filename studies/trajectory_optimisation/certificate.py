"""The error of the smoothed friction, in force and in the loop's response, and its order of convergence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import feedback_alone
from design.trajectory.history_aware import Trajectory
from design.trajectory.scenarios import Scenario, respond
from design.trajectory.schemes import feedback
from models.controller import References
from models.friction import follow
from models.machine import Machine
from models.simulation.simulator import simulate
from models.smooth_friction import follow_smoothed

Array = NDArray[np.float64]

RATIOS: Final = (0.3, 0.1, 0.03, 0.01, 0.003)
SUBSTEP_COUNTS: Final = (2, 4, 8, 16)  # substeps of a sample; two, as the thrust changes within it
FINE_SUBSTEPS: Final = 160
PATH_STEP_DECADES: Final = (-3.0, -1.3)  # decades of a random path's steps [1, of the longest limit]
SETTLED: Final = 1.2  # settling times of the loop's response that are compared


def certify(machine: Machine, motion: Trajectory, seed: int, *, quick: bool) -> dict[str, Any]:
    """Largest differences over random paths and random motions; orders by least squares on their logarithms."""
    rng, friction = np.random.default_rng(seed), machine.friction
    limits = np.array(friction.limit)
    count = 4 if quick else 20
    longest = float(np.max(limits))
    paths = [
        np.cumsum(rng.standard_normal(400)) * longest * 10 ** rng.uniform(*PATH_STEP_DECADES) for _ in range(count)
    ]
    starts = [rng.uniform(-1, 1, limits.size) * limits for _ in range(count)]
    scales = rng.uniform(0.1, 2.0, count)
    exact_paths = [follow(friction, path, start)[0] for path, start in zip(paths, starts, strict=True)]
    exact = [_response(machine, motion, start, scale, 0.0) for start, scale in zip(starts, scales, strict=True)]
    force, response = [], []
    for ratio in RATIOS:
        smoothed = [follow_smoothed(friction, path, ratio, start) for path, start in zip(paths, starts, strict=True)]
        force.append(_largest(smoothed, exact_paths))
        loops = [_response(machine, motion, start, scale, ratio) for start, scale in zip(starts, scales, strict=True)]
        response.append(_largest(loops, exact))
    return {
        "ratio": RATIOS,
        "paths": count,
        "force_N": force,
        "bound_N": [ratio * friction.coulomb_force for ratio in RATIOS],
        "response_m": response,
        "order_force": _order(force),
        "order_response": _order(response),
    }


def held(machine: Machine, given: References, target: Array) -> dict[str, Any]:
    """The error [m] of the response to given references due to friction once a sample, and its order in the substep.

    Nonsmooth, by the simulator with ever shorter substeps; `left_m` at those of SUBSTEP_COUNTS, against FINE_SUBSTEPS
    of them.
    """
    exact = replace(machine, scale=replace(machine.scale, resolution=0.0, noise=0.0))
    law = feedback_alone(machine)
    best = simulate(exact, law, target, given=given, substeps=FINE_SUBSTEPS).position
    left = [
        float(np.max(np.abs(simulate(exact, law, target, given=given, substeps=n).position - best)))
        for n in SUBSTEP_COUNTS
    ]
    return {
        "substeps": SUBSTEP_COUNTS,
        "left_m": left,
        "order": float(-np.polyfit(np.log(SUBSTEP_COUNTS), np.log(left), 1)[0]),
    }


def _response(machine: Machine, motion: Trajectory, start: Array, scale: float, ratio: float) -> Array:
    """x [m] of the loop under the motion scaled by `scale`, without friction compensation: the feedback does it all."""
    loop = feedback(machine, motion.task.samples + 1, SETTLED * machine.specification.settling_time)
    extra = loop.last - motion.net.size
    thrust = scale * np.append(motion.net, np.zeros(extra))
    reference = scale * np.append(motion.position, np.full(extra - 1, motion.task.stroke))
    scenario = Scenario(machine.plant, machine.friction, 0)
    return respond(scenario, loop, start, thrust, reference, ratio).position


def _largest(some: list[Array], others: list[Array]) -> float:
    return max(float(np.max(np.abs(one - other))) for one, other in zip(some, others, strict=True))


def _order(errors: list[float]) -> float:
    return float(np.polyfit(np.log(RATIOS), np.log(errors), 1)[0])
