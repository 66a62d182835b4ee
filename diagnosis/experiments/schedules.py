"""Experiments for a diagnosis, as the references that the controller is to follow.

A move is a seventh-order polynomial in time, with zero speed, acceleration and jerk at both ends. The feedforward is
the force that the rigid body needs for it beyond what the controller feeds forward by itself, plus an excitation at
rest where the experiment has one.

What an axis is asked to do is in its own sizes: lengths in the specified stroke or in the friction's presliding
distance, speeds in the rated one, forces in the friction, frequencies in the sample rate, times in the specified
settling time or in samples where that is less; but for what is watched as long as an engineer would: a hold of 15 s,
for what goes on by itself, and a stroke over most of the travel, of 3 s at the most. The rated thrust and speed are
kept to, and the travel and what a spring to ground takes where the machine file states them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.controller import References
from models.machine import Machine

Array = NDArray[np.float64]

PEAK_SPEED = 35 / 16  # peak speed of a move over its mean speed
PEAK_ACCELERATION = 7.5131884  # peak acceleration of a move, in units of distance / duration^2
SUITE_SAMPLES: Final = 90_000  # of the 200,000 that a diagnosis takes by default: other records are beside the suite
RAMP: Final = 0.2  # periods of the lowest frequency in which a multisine begins, and in which it ends
SHORTER: Final = (1.0, 0.8, 0.6, 0.5, 0.4, 0.35, 0.3, 0.25, 0.2)  # of the usual rests
SHORTEST_RESTS: Final = (0.2, 0.1, 0.05)  # likewise, where experiments are left out: a stroke has to remain
HOLD_S: Final = 15.0  # s that nothing moves, for what goes on by itself
HARD_THRUST_SHARES: Final = (0.2, 0.4, 0.6, 0.8)  # of the rated thrust
UNHURRIED_THRUST_SHARE: Final = 0.6  # of the rated thrust, for what need not be fast
LADDER: Final = (0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1)  # of the longest move
DWELL_STROKE: Final = 0.865  # specified strokes
RESTS: Final = (2.4, 4.8, 10, 20, 40, 60)  # pauses
# Pauses that a stroke may take: slower ones would take minutes where the rated speed is low.
MAX_STROKE_PAUSES: Final = 200.0
SUITE_STROKES: Final = (
    (15, 0.1, 0.0021, 1),
    (60, 0.3, 0.0083, 1),
    (120, 0.6, 0.0333, 1),
    (200, 1.0, 0.05, 1),
    (600, 3.0, 0.0625, 2),
)
"""Strokes of the suite: presliding distances, specified strokes, shares of the rated speed, passes."""


@dataclass(frozen=True)
class Schedule:
    """What to run: a name, the target r (n,) [m], and the references x_T*, u_ff and u_rf (n,) [m], [N], [N]."""

    name: str
    target: Array
    given: References


@dataclass(frozen=True)
class Move:
    """A move by `distance` [m] within `duration` [s], then rest for `dwell` [s]; rest only where the distance is 0."""

    distance: float
    duration: float
    dwell: float


@dataclass(frozen=True)
class Excitation:
    """A multisine on the feedforward at rest: `band` [Hz], `amplitude` [N] (rms), `duration` [s]."""

    band: tuple[float, float]
    amplitude: float
    duration: float
    seed: int = 0


Step = Move | Excitation


def schedule(name: str, machine: Machine, steps: Sequence[Step], lead: float | None = None) -> Schedule:
    """The steps one after the other, after `lead` [s] of rest at 0, at the sample time of the machine's controller.
    Default: four pauses."""
    ts, mass = machine.sample_time, machine.plant.mass - machine.control.fed_forward
    ahead = round((4 * pause(machine) if lead is None else lead) / ts)
    position, target, force = [np.zeros(ahead)], [np.zeros(ahead)], [np.zeros(ahead)]
    at = 0.0
    for step in steps:
        if isinstance(step, Excitation):
            added = _multisine(step, ts)
            path, thrust = np.full(added.size, at), added
        else:
            moving, resting = max(round(step.duration / ts), 1), round(step.dwell / ts)
            s = np.clip(np.arange(1, moving + resting + 1) / moving, 0.0, 1.0)
            path = at + step.distance * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
            curved = 420 * s**2 - 1680 * s**3 + 2100 * s**4 - 840 * s**5
            thrust = mass * step.distance / (moving * ts) ** 2 * curved * (s < 1)
            at += step.distance
        position.append(path)
        target.append(np.full(path.size, at))
        force.append(thrust)
    whole = np.concatenate(position)
    return Schedule(name, np.concatenate(target), References(whole, np.concatenate(force), np.zeros(whole.size)))


def quickest(machine: Machine, distance: float, share: float) -> float:
    """Duration [s] of a move of `distance` [m] whose peak thrust is a share [1] of the rated thrust, within the rated
    speed."""
    force = share * machine.drive.rated_thrust
    by_thrust = float(np.sqrt(PEAK_ACCELERATION * distance * machine.plant.mass / force))
    return max(by_thrust, PEAK_SPEED * distance / machine.drive.rated_speed, 2 * machine.sample_time)


def allowed(machine: Machine, distance: float, speed: float) -> float:
    """The peak speed [m/s] of a move of `distance` [m], reduced to what its share of the rated thrust can reach."""
    return min(speed, PEAK_SPEED * distance / quickest(machine, distance, UNHURRIED_THRUST_SHARE))


def at_share(machine: Machine, distance: float, share: float, longest: float = 1.0) -> float:
    """The peak speed [m/s] of a stroke of `distance` [m]: a share [1] of the rated speed, but within MAX_STROKE_PAUSES
    pauses, or the share `longest` [1] of them, and what the thrust allows."""
    slowest = PEAK_SPEED * distance / (longest * MAX_STROKE_PAUSES * pause(machine))
    return allowed(machine, distance, max(rounded(share * machine.drive.rated_speed), slowest))


def _multisine(excitation: Excitation, sample_time: float) -> Array:
    """Sines of equal amplitude and random phase over the band, periodic in the duration, with a soft start and end."""
    n = round(excitation.duration / sample_time)
    low, high = (round(f * n * sample_time) for f in excitation.band)
    spectrum = np.zeros(n // 2 + 1, complex)
    chosen = np.arange(max(low, 1), min(high, n // 2) + 1)
    phase = np.random.default_rng(excitation.seed).uniform(0, 2 * np.pi, chosen.size)
    spectrum[chosen] = np.exp(1j * phase)
    signal = np.fft.irfft(spectrum, n)
    ramp = np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) * sample_time * excitation.band[0] / RAMP, 0.0, 1.0)
    return np.asarray(signal / np.std(signal) * excitation.amplitude * ramp)


def sequence(machine: Machine, repeats: int = 3) -> Schedule:
    """The motions of the specification, up and down, `repeats` times."""
    wanted = machine.specification
    duration = wanted.reference_settling_time
    up = [Move(wanted.stroke, duration, wanted.interval - duration)] * wanted.motions
    down = [Move(-wanted.stroke, duration, wanted.interval - duration)] * wanted.motions
    return schedule("sequence", machine, (up + down) * repeats)


def reach(machine: Machine) -> float:
    """The friction's presliding distance [m] to one digit; five specified strokes of a machine without friction."""
    return rounded(max(machine.friction.limit, default=0.0) or 5 * machine.specification.stroke, 1)


def room(machine: Machine) -> float:
    """How long the way of an experiment may be [m]: what the travel leaves where it is stated; and no further than
    where a spring that the file states leaves of the rated thrust what unhurried moves take, wherever they begin."""
    spring = sum(effect.spring_to_ground() for effect in machine.effects)
    held = (1 - UNHURRIED_THRUST_SHARE) * machine.drive.rated_thrust
    return min(machine.drive.room, held / spring if spring > 0 else np.inf)


def length(machine: Machine, distances: float, strokes: float, onward: int = 1) -> float:
    """So many presliding distances or specified strokes [m], whichever is more, as far as the axis may travel with so
    many such moves one after another in one direction."""
    return min(max(distances * reach(machine), strokes * machine.specification.stroke), room(machine) / onward)


def pause(machine: Machine) -> float:
    """What rests are counted in [s]: the specified settling time, or 100 samples and at least a tenth of it."""
    settling = machine.specification.settling_time
    return min(settling, max(100 * machine.sample_time, settling / 10))


def ladder(machine: Machine) -> tuple[float, ...]:
    """Sizes of moves [m], to be made twice in one direction, up to two presliding distances or the specified stroke."""
    longest = length(machine, 2, 1, onward=2)
    return tuple(min(rounded(share * longest), room(machine) / 2) for share in LADDER)


def rounded(number: float, digits: int = 2) -> float:
    """A number [of any unit] to some digits, as a person would ask for it."""
    return float(f"{number:.{digits}g}")


def top(machine: Machine) -> float:
    """The highest frequency [Hz] of a multisine: 0.8 of Nyquist's."""
    return rounded(0.4 / machine.sample_time)


def amplitude_ladder(machine: Machine, sizes: Sequence[float] | None = None, share: float = 1.0) -> Schedule:
    """Moves of each size [m], twice up and twice down, within 1.2 settling times where the thrust allows it; share [1]
    of the usual rests after them. Default: those of `ladder`."""
    settling, rest = machine.specification.settling_time, 8.8 * share * pause(machine)
    steps = [
        Move(sign * size, max(1.2 * settling, quickest(machine, size, UNHURRIED_THRUST_SHARE)), rest)
        for size in (ladder(machine) if sizes is None else sizes)
        for sign in (1, 1, -1, -1)
    ]
    return schedule("amplitude ladder", machine, steps)


def rests(machine: Machine) -> tuple[float, ...]:
    """Rests of many lengths [s], from 2.4 to 60 pauses."""
    return tuple(rounded(share * pause(machine)) for share in RESTS)


def dwell_stroke(machine: Machine) -> float:
    """The moves of a dwell sweep [m], twice in one direction: 0.865 specified strokes."""
    return length(machine, 0, DWELL_STROKE, onward=2)


def dwell_sweep(machine: Machine, dwells: Sequence[float] | None = None) -> Schedule:
    """Moves of `dwell_stroke` after rests of each length [s], onward in the same direction and back."""
    stroke, settling = dwell_stroke(machine), machine.specification.settling_time
    duration = max(settling, quickest(machine, stroke, UNHURRIED_THRUST_SHARE))
    chosen = rests(machine) if dwells is None else dwells
    return schedule(
        "dwell sweep", machine, [Move(sign * stroke, duration, dwell) for dwell in chosen for sign in (1, 1, -1, -1)]
    )


def multisine(
    machine: Machine,
    band: tuple[float, float] | None = None,
    amplitude: float | None = None,
    duration: float | None = None,
) -> Schedule:
    """A multisine at rest: band [Hz], amplitude [N] (rms), duration [s]. Default: from 1/200 to half of the highest
    frequency, a quarter of the friction, 16 periods of the lowest."""
    low, high = band or (top(machine) / 200, top(machine) / 2)
    excitation = Excitation(
        (low, high), shaking(machine) if amplitude is None else amplitude, 16 / low if duration is None else duration
    )
    still = Move(0.0, 4 * pause(machine), 4 * pause(machine))
    return schedule("multisine", machine, [still, excitation, still])


def shaking(machine: Machine, share: float = 0.24) -> float:
    """The force [N] (rms) of a multisine: a share of the friction, and no more than a tenth of the rated thrust."""
    most = 0.1 * machine.drive.rated_thrust
    return rounded(min(share * machine.friction.coulomb_force, most) or most)


def strokes(
    machine: Machine, distance: float, speeds: Sequence[float], passes: int = 1, share: float = 1.0
) -> Schedule:
    """Strokes of `distance` [m] there and back at each peak speed [m/s]; share [1] of the usual rests after them."""
    steps = [
        Move(sign * distance, PEAK_SPEED * distance / speed, 12 * share * pause(machine))
        for speed in speeds
        for _ in range(passes)
        for sign in (1, -1)
    ]
    return schedule("strokes", machine, steps)


def hold(machine: Machine) -> Schedule:
    """Nothing moves for HOLD_S [s]."""
    return schedule("hold", machine, [Move(0.0, HOLD_S, 0.0)])


def nested_loops(machine: Machine, sizes: Sequence[float], duration: float) -> Schedule:
    """Loops of each size [m] back and forth, each from the end of the larger one, each way in `duration` [s]."""
    steps = [Move(sign * size, duration, 0.5 * duration) for size in sizes for sign in (1, -1, 1, -1)]
    return schedule("nested loops", machine, steps)


def hard_moves(machine: Machine, distance: float) -> Schedule:
    """Moves of `distance` [m] there and back whose peak thrust is each of HARD_THRUST_SHARES of the rated thrust."""
    durations, rest = [quickest(machine, distance, share) for share in HARD_THRUST_SHARES], 10 * pause(machine)
    steps = [Move(sign * distance, duration, rest) for duration in durations for sign in (1, -1) * 2]
    return schedule("hard moves", machine, steps)


def moves_along(machine: Machine, places: int, apart: float, distance: float) -> Schedule:
    """Fast moves of `distance` [m] back and forth at places `apart` [m], at half of the rated thrust; as many at one
    place where there is no room for others."""
    fast, rest = quickest(machine, distance, 0.5), pause(machine)
    here = [Move(sign * distance, fast, 6 * rest) for sign in (1, -1)]
    if apart == 0:
        return schedule("moves at one place", machine, here * places)
    on, back = Move(apart, _calm(machine, apart, 16), 8 * rest), -apart * (places - 1)
    steps = [*here, *([on, *here] * (places - 1)), Move(back, _calm(machine, abs(back), 40), 8 * rest)]
    return schedule("moves along the way", machine, steps)


def _calm(machine: Machine, distance: float, times: float) -> float:
    """The duration [s] of a move [m] that is not part of an experiment: so many pauses, or what a third of the rated
    thrust allows."""
    return max(times * pause(machine), quickest(machine, distance, 1 / 3))


def repeated_strokes(machine: Machine, passes: int = 12) -> Schedule:
    """The same stroke [m] at one speed [m/s], again and again: 50 presliding distances or the specified stroke; 1/80 of
    the rated speed, or within 40 pauses if that is faster, where the thrust allows it."""
    size = length(machine, 50, 1)
    wanted = max(rounded(machine.drive.rated_speed / 80), PEAK_SPEED * size / (40 * pause(machine)))
    return strokes(machine, size, (allowed(machine, size, wanted),), passes)


def together(name: str, parts: Sequence[Schedule]) -> Schedule:
    """Several schedules as one; all begin and end at 0."""
    return Schedule(
        name,
        np.concatenate([part.target for part in parts]),
        References(
            np.concatenate([part.given.position for part in parts]),
            np.concatenate([part.given.feedforward for part in parts]),
            np.concatenate([part.given.compensation for part in parts]),
        ),
    )


def suite(machine: Machine, most: int | None = None) -> Schedule:
    """The main experiments of the menu in one record, of half a minute on the default machine.

    most: samples that it may have, such as SUITE_SAMPLES for what an axis is to run. Where it has more, as on a finely
    sampled machine, the strokes are passed once, rests get shorter, and at last the longest experiments are left out.
    """
    whole = _parts(machine)
    if most is None or _samples(whole) <= most:
        return together("suite", whole)
    for share in SHORTER:
        parts = _parts(machine, share, once=True)
        if _samples(parts) <= most:
            return together("suite", parts)
    found = [_shortest(_parts(machine, share, once=True), most) for share in SHORTEST_RESTS]
    return together("suite", next((parts for parts in found if len(parts) > 1), found[-1]))


def _shortest(parts: Sequence[Schedule], most: int) -> list[Schedule]:
    """The shortest experiments, in their order, that have no more samples together; one at least."""
    ranked = sorted(range(len(parts)), key=lambda i: parts[i].target.size)
    count = max(sum(np.cumsum([parts[i].target.size for i in ranked]) <= most), 1)
    return [parts[i] for i in sorted(ranked[:count])]


def _parts(machine: Machine, share: float = 1.0, *, once: bool = False) -> list[Schedule]:
    """The experiments of the suite, with rests a share [1] as long; once: each stroke is passed once."""
    resting = tuple(rounded(share * dwell) for dwell in rests(machine))
    far = [_far(machine, one[:3], 1 if once else one[3], share) for one in SUITE_STROKES]
    return [amplitude_ladder(machine, share=share), dwell_sweep(machine, resting), multisine(machine), *far]


def _samples(parts: Sequence[Schedule]) -> int:
    return sum(part.target.size for part in parts)


def _far(machine: Machine, sizes: tuple[float, float, float], passes: int, share: float) -> Schedule:
    """Strokes of so many presliding distances or specified strokes at a share [1] of the rated speed, with rests, and
    the longest time of a stroke, a share [1] as long."""
    distances, stroke, speed = sizes
    size = length(machine, distances, stroke)
    return strokes(machine, size, (at_share(machine, size, speed, share),), passes, share)


def to_csv(planned: Schedule, sample_time: float) -> str:
    """The schedule as a record of references (SI): time_s, target_m, reference_m, feedforward_N."""
    given = planned.given
    lines = ["time_s,target_m,reference_m,feedforward_N"]
    force = given.feedforward + given.compensation
    for k, (target, reference, pushed) in enumerate(zip(planned.target, given.position, force, strict=True)):
        lines.append(f"{k * sample_time:.12g},{target:.9g},{reference:.9g},{pushed:.9g}")
    return "\n".join(lines) + "\n"
