"""What is asked of a sealed machine: motions that the design of its nominal file misses and one with the truth meets.

No design made from the nominal file can know how the true machine departs from the nominal one under equal references,
and one made with the truth can take all off it that repeats. So the machine is asked to settle within a tolerance
between that departure and the scale's readings; of several settling times, within the longest that leaves such a
tolerance. Where none does, as where nothing is wrong, the tolerance is drawn between the same ends, so that a tight one
does not tell that something is; a settling time shorter than the first that is tried still does. Some machines are
asked for more than their scale can show, so that what cannot be met comes up as well.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.axis import Axis, shifted
from studies.blind_trial.sealer.machines.cases import RESERVE, Bench, Plan, together
from studies.blind_trial.sealer.machines.motions import Schedule, friction_along, profile
from studies.blind_trial.sealer.machines.simulation import simulate

Array = NDArray[np.float64]

TIMES: Final = (3.0, 2.0, 1.5, 1.0)  # settling times that are tried, over the crossover frequency
SAMPLES: Final = (30, 900)  # of a settling time
DEPARTURE: Final = (1.5, 4.0)  # over the tolerance, as drawn
SHOWN: Final = 6.0  # deviations of a reading that a tolerance is at least
IMPOSSIBLE: Final = (0.15, 2.0)  # share of machines asked for more than the scale can show, and for how many deviations
WIDEST: Final = 0.25  # of the stroke, a tolerance
RESTS: Final = 0.4  # of the settling time, after which the reference rests
INTERVAL: Final = (2.5, 4.0)  # settling times between two motions
LASTS: Final = (12.0, 40_000)  # s and samples that all motions take together, if their interval allows
MOTIONS: Final = 5  # one way
STROKE: Final = 0.5  # of the longest presliding displacement: so all of the motions one way leave no contact unturned
PERIODS: Final = 2  # of which the second counts
BRISK: Final = 0.8  # of the experiment's speed and force, which the motions may take
START: Final = 11  # seed of the friction's state


def specification(found: Plan) -> dict[str, Any]:
    """Stroke, tolerance [m] and times [s] as a nominal.json has them; the same for the same case."""
    axis = found.bench.axis
    rng = np.random.default_rng([found.seed, 6])
    over, impossible = rng.uniform(*DEPARTURE), rng.random() < IMPOSSIBLE[0]
    usual = wanted(axis, TIMES[0], SHOWN * axis.read)
    if impossible:
        return {**usual, "tolerance_m": IMPOSSIBLE[1] * axis.read}
    differs = bool(found.parts) or any(np.any(number) for number in found.shift.values())
    for share in TIMES if differs else ():  # a machine that is the nominal one does not depart from it
        asked = wanted(axis, share, SHOWN * axis.read)
        departs = departure(found, asked)
        if departs is not None and departs > over * asked["tolerance_m"]:
            return {**asked, "tolerance_m": min(departs / over, WIDEST * asked["stroke_m"])}
    widest = max(WIDEST * usual["stroke_m"], usual["tolerance_m"])
    return {**usual, "tolerance_m": float(usual["tolerance_m"] * (widest / usual["tolerance_m"]) ** rng.random())}


def wanted(axis: Axis, share: float, tolerance: float) -> dict[str, Any]:
    """The specification with this tolerance [m], its settling time as a share [1] of a period of the crossover."""
    ts = axis.sample_time
    settles = int(np.clip(np.ceil(share / axis.crossover / ts), SAMPLES[0], SAMPLES[1]))
    lasts = min(LASTS[0] / ts, LASTS[1])
    shortest, longest = (round(one * settles) for one in INTERVAL)
    interval = int(np.clip(lasts / (2 * MOTIONS * PERIODS), shortest, longest))
    return {
        "stroke_m": max(STROKE * axis.reach, 20 * axis.read),
        "tolerance_m": tolerance,
        "settling_time_s": settles * ts,
        "reference_settling_time_s": round(RESTS * settles) * ts,
        "interval_s": interval * ts,
        "motions": MOTIONS,
    }


def departure(found: Plan, asked: dict[str, Any]) -> float | None:
    """How far [m] the true machine is off the nominal one from the settling time on, in the worst of the motions, both
    without noise; None where one of them cannot do the motions."""
    bench, ts = found.bench, found.bench.axis.sample_time
    nominal = replace(bench.axis, control=of_error(bench.axis))
    planned = strokes(nominal, asked)
    if not within(bench, planned):
        return None
    true = replace(shifted(bench.axis, found.shift), control=nominal.control)
    changes = (None, together(found.parts, bench.units))
    try:
        runs = [
            simulate(axis, planned, found.seed, change, start=START, exact=True).reading
            for axis, change in zip((nominal, true), changes, strict=True)
        ]
    except ArithmeticError:
        return None
    counted = MOTIONS * 2 * round(asked["interval_s"] / ts)
    apart = np.abs(runs[1] - runs[0])[-counted:].reshape(2 * MOTIONS, -1)
    return float(apart[:, round(asked["settling_time_s"] / ts) :].max())


def of_error(axis: Axis) -> dict[str, float]:
    """The controller that sees nothing but the error, as a feedforward makes of one that weighs its reference."""
    return {**axis.control, "b": 1.0, "c": 1.0, "f": 1.0, "m": 0.0}


def strokes(axis: Axis, asked: dict[str, Any]) -> Schedule:
    """The motions from rest, with the force that the rigid body and the friction of a machine take along them."""
    ts = axis.sample_time
    rests, interval = (round(asked[name] / ts) for name in ("reference_settling_time_s", "interval_s"))
    one = np.concatenate([profile("quintic", rests), np.ones(interval - rests)])
    signs = np.tile(np.repeat([1.0, -1.0], MOTIONS), PERIODS)
    here = asked["stroke_m"] * np.concatenate([[0.0], np.cumsum(signs)])
    paths = [start + asked["stroke_m"] * sign * one for start, sign in zip(here[:-1], signs, strict=True)]
    path = np.concatenate([np.zeros(interval), *paths])
    ahead = np.append(path[1:], path[-1])
    force = axis.mass * np.gradient(np.gradient(path, ts), ts) + friction_along(axis, ahead)
    return Schedule(np.repeat(here, interval), path, force, ("specified",))


def within(bench: Bench, planned: Schedule) -> bool:
    """Whether motions take clearly less speed and force than the machine may be asked for."""
    fastest = max(float(np.abs(np.diff(one.reference)).max()) for one in bench.schedules)
    return bool(
        np.abs(np.diff(planned.reference)).max() <= BRISK * fastest
        and np.abs(planned.feedforward).max() <= BRISK * RESERVE * bench.axis.rated
    )
