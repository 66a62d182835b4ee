"""What the search finds where nothing is missing: the thresholds, by simulating the null on these very schedules.

Tables whose nominal parameters are off by their priors run the records' references in the closed loop, are fitted by a
step from their truth and scanned like a record. What an effect gains there on held-out motions, it gains by chance, by
quantisation or by what the method neglects. The answer depends on machine and schedule only, so it is kept under their
hash. Tables that follow the same references take nearly the same path, so most effects' columns are computed for the
first of them only.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import stat
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, largest, one_step
from diagnosis.model.kalman import STARTING
from diagnosis.model.parallel import parallel_map
from diagnosis.model.parameters import Parameters, bounded, initial_state, parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.roughness import WhiteForce, variance_by_record
from diagnosis.model.unknown_force import force_left
from diagnosis.records.motions import numbered, pieces
from diagnosis.records.units import loop_time, slow_walk
from diagnosis.which.detectors.command_jitter import gained_by_chance
from diagnosis.which.detectors.scan import Columns, Finding, NuisanceProjection, partial_out, scan
from models.controller import References
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import in_order
from models.friction import deflections
from models.machine import Machine, to_json
from models.records.record import Record
from models.simulation.simulator import simulate

Array = NDArray[np.float64]
Chance = tuple[dict[str, float], tuple[float, ...], float, float, tuple[float, ...]]

NULL_DRAWS: Final = 8
LARGEST_CACHE: Final = 1 << 22  # bytes of a kept null, which has a few kB
# Of 2**31, by the golden ratio: where neighbouring seeds begin in the white force's numbers.
SEED_STRIDE: Final = 0x9E3779B1
SIGNIFICANT_STDS: Final = 4.0  # deviations of a mean of the draws, beyond which it is not chance
SETTLING: Final = 138.0  # loop times at rest before the record


@dataclass(frozen=True)
class Null:
    """Where nothing is missing: gains by effect, one a draw, the innovations' variance by draw and record [1], the
    largest innovation of each draw in deviations [1], its unknown force [N] (root mean square), and how far its
    re-fit moved each nominal value away from the truth, in its tolerances [1]."""

    gains: Mapping[str, tuple[float, ...]]
    variance: tuple[tuple[float, ...], ...]
    largest: tuple[float, ...]
    force: tuple[float, ...] = ()
    moved: tuple[tuple[float, ...], ...] = ()

    def bias(self) -> Array:
        """By how many of its tolerances the re-fit moves each nominal value away from the truth where nothing is wrong
        (P,) [1]; 0 where that may be chance."""
        moved = np.array(self.moved)
        if len(moved) < 2:
            return np.zeros(moved.shape[-1])
        mean, deviation = moved.mean(axis=0), moved.std(axis=0, ddof=1) / math.sqrt(len(moved))
        return np.asarray(np.where(np.abs(mean) > SIGNIFICANT_STDS * deviation, mean, 0.0))

    def thresholds(self, criteria: Criteria) -> dict[str, float]:
        """By effect, the chi-square [1] that it has to gain on held-out motions to be more than chance."""
        return {name: max(criteria.min_gain, criteria.null_safety * max(gains)) for name, gains in self.gains.items()}

    @property
    def usual(self) -> tuple[float, ...]:
        """Chi-square per sample [1] that a complete model leaves of each record, the mean of the draws."""
        return tuple(np.mean(self.variance, axis=0).tolist())

    def spike(self, criteria: Criteria) -> float:
        """Standard deviations [1] beyond which a single innovation stands out."""
        return max(criteria.spike, criteria.spike_safety * max(self.largest))

    def floors(self, records: Sequence[Record]) -> Array:
        """Chi-square (draws,) [1] that a complete model leaves of these records."""
        return np.asarray(np.array(self.variance) @ [record.position.size - STARTING for record in records], float)

    def scatter(self, records: Sequence[Record]) -> float:
        """By how much the chi-square that a complete model leaves of these records differs from draw to draw, over its
        mean [1]: more than white noise makes it, where contacts slip within less than the scale can tell."""
        floors = self.floors(records)
        return float(np.std(floors, ddof=1) / np.mean(floors)) if floors.size > 1 and np.all(floors > 0) else 0.0

    def force_scatter(self, count: int) -> Array:
        """Unknown forces of complete models over those of others (count,) [1], drawn with a fixed seed: how far the
        noise floor of a record may be from that of a simulation."""
        if len(self.force) < 2 or not all(self.force):
            return np.ones(count)
        rng, force = np.random.default_rng(1), np.array(self.force)
        one = rng.integers(0, force.size, count)
        return np.asarray(force[one] / force[(one + rng.integers(1, force.size, count)) % force.size])


def simulated(candidate: Candidate, record: Record, index: int, seed: int) -> Record:
    """The record that a candidate would have made of the same references, from the same start, with other noise, and as
    rough as the candidate takes the record of this index to be."""
    return _simulated(candidate, record, index, seed)[0]


def simulated_with_starts(
    candidate: Candidate, records: Sequence[Record], seed: int
) -> tuple[tuple[Record, ...], Candidate]:
    """`simulated` for all records, and the candidate with its friction as it was at their first samples."""
    runs = parallel_map(lambda i, record: _simulated(candidate, record, i, seed + i), range(len(records)), records)
    made, states = zip(*runs, strict=True)
    theta = candidate.theta.copy()
    theta[candidate.layout.of("initial_friction_state")] = np.concatenate(states)
    return made, replace(candidate, theta=bounded(candidate.layout, theta))


def _simulated(candidate: Candidate, record: Record, index: int, seed: int) -> tuple[Record, Array]:
    """The record, and the displacements (N,) [m] of the friction's elements at its first sample: while the table comes
    to rest before it, contacts that were deflected against each other push it some way."""
    machine, layout = candidate.machine, candidate.layout
    effects = (*candidate.effects, *_white_force(candidate, index, seed))
    origin = float(record.reference[0])
    lead = round(SETTLING * loop_time(layout.machine) / record.sample_time)
    ahead = np.zeros(lead)
    given = References(
        np.concatenate([ahead + origin, record.reference]),
        np.concatenate([ahead, record.feedforward]),
        np.zeros(lead + record.reference.size),
    )
    run = simulate(
        replace(machine, scale=machine.scale.noisy(), effects=in_order(effects)),
        machine.feedback_only(),
        np.concatenate([ahead + origin, record.target]),
        given=given,
        seed=seed,
        initial_friction=initial_state(layout, candidate.theta, index),
        origin=origin,
    )
    made = run.record.last(record.position.size)
    if record.every > 1:  # as its log would have shown it
        made = made.thinned(record.every).filled(record.every)
    moved = run.position[: lead + 1] - origin
    state = deflections(machine.friction.limit, moved, initial_state(layout, candidate.theta, index))
    return Record(
        record.sample_time, record.target, record.reference, record.feedforward, made.command, made.position,
        every=record.every,
    ), state[-1]  # fmt: skip


def _white_force(candidate: Candidate, index: int, seed: int) -> tuple[WhiteForce, ...]:
    """What a simulation needs beside its model to be as rough as a record; the usual white force is not one but stands
    for the error of the friction along a smoothed path."""
    rough = candidate.roughness_of(index)
    if rough <= 1:
        return ()
    size = candidate.usual_white_force * math.sqrt(rough**2 - 1)
    return (WhiteForce(size, candidate.nominal.sample_time, float(seed * SEED_STRIDE % (1 << 31))),)


@dataclass(frozen=True)
class Drawn:
    """A table within the priors that runs the records' references: its re-fit, its records, what is left of them, and
    how far the re-fit moved each nominal value away from the truth (P,), in its tolerances [1]."""

    fitted: Fit
    records: Sequence[Record]
    left: NuisanceProjection
    moved: Array

    def scanned(self, known: Columns = MappingProxyType({})) -> tuple[list[Finding], Columns]:
        """What every effect gains on it [1], and the columns of the effects."""
        return scan(self.fitted, self.records, self.left, known=known)


@dataclass(frozen=True)
class StartedNull:
    """A null of which the first table is simulated and scanned, with the columns that the others share (`start`); or
    the whole of it, where it was kept in `place`."""

    layout: Parameters
    records: Sequence[Record]
    roughness: tuple[float, ...]
    draws: int
    place: Path | None
    start: Null | tuple[Chance, Columns]

    def drawn(self, seed: int) -> Drawn:
        """The table of a seed."""
        return _drawn(self.layout, self.records, self.roughness, seed)

    def usual(self) -> tuple[float, ...]:
        """`Null.usual` [1], which takes no scan of the tables."""
        if isinstance(self.start, Null):
            return self.start.usual
        (_, variance, *_), _ = self.start
        rest = parallel_map(lambda seed: variance_by_record(self.drawn(seed).fitted), range(1, self.draws))
        return tuple(np.mean([np.array(variance), *rest], axis=0).tolist())

    def completed(self, say: Callable[[str], None] = lambda _: None) -> Null:
        """The null of all tables, kept from now on."""
        if isinstance(self.start, Null):
            return self.start
        first, known = self.start
        results = [first]
        say(f"simulating the null, {min(2, self.draws)} of {self.draws}")
        for result in parallel_map(lambda seed: _draw(self.drawn(seed), known), range(1, self.draws)):
            results.append(result)
            say(f"simulating the null, {min(len(results) + 1, self.draws)} of {self.draws}")
        gains: dict[str, list[float]] = {}
        for found, *_ in results:
            for name, gain in found.items():
                gains.setdefault(name, []).append(gain)
        _, *rest = zip(*results, strict=True)
        made = Null({name: tuple(row) for name, row in sorted(gains.items())}, *rest)
        if self.place:
            _keep(made, self.place)
        return made


def start_null(
    layout: Parameters,
    records: Sequence[Record],
    *,
    roughness: tuple[float, ...] = (),
    cache: Path | None = None,
    draws: int = NULL_DRAWS,
    say: Callable[[str], None] = lambda _: None,
) -> StartedNull:
    """The gains [1] of every effect on `draws` simulated tables without any, begun with the first of them: on a drive
    that turns out rougher than its model, or with more contacts, all others would be simulated for nothing.

    roughness: the white force of each record over the usual one [1], which the tables have and their fits allow for.
    The cache is JSON in a folder of the user's, from which the null is read where it was kept. Where its file is
    damaged, or somebody else owns the folder, the tables are simulated again.
    """
    place = cache / f"{_key(layout.machine, records, draws, roughness)}.json" if cache else None
    kept = _kept(place, layout.machine.kinds, draws, len(records), _nominal(layout).size) if place else None
    if kept is not None:
        return StartedNull(layout, records, roughness, draws, place, kept)
    say(f"simulating the null, 1 of {draws}")
    table = _drawn(layout, records, roughness, 0)
    findings, columns = table.scanned()  # most of them are those of the tables that follow, too
    known = {effect: column for effect, column in columns.items() if _is_of_path(effect)}
    return StartedNull(layout, records, roughness, draws, place, (_gains(table, findings), known))


def _keep(made: Null, place: Path) -> None:
    """Puts the null into its file of the cache, with a hash of its content; where that can't be, it is not kept."""
    content = asdict(made)
    text = json.dumps({**content, "sha256": _hash_of(content)})
    part = place.with_suffix(f".{np.random.default_rng().integers(1 << 40)}.part")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        if not _users(place.parent):
            return
        try:
            part.write_text(text, encoding="utf-8")
            part.replace(place)
        finally:
            part.unlink(missing_ok=True)
    except OSError:  # a full disk, say: the answer does not depend on what is kept
        return


def _kept(place: Path, kinds: Collection[str], draws: int, records: int, values: int) -> Null | None:
    """The null in a file of the cache; None where there is none, or none that `_keep` wrote for such a search. values:
    how many nominal ones there are."""
    try:
        if not (_users(place.parent) and _users(place)) or place.stat().st_size > LARGEST_CACHE:
            return None
        content = json.loads(place.read_text(encoding="utf-8"))
        expected = content.pop("sha256")
        made = Null(
            {name: _numbers(row, draws) for name, row in content.pop("gains").items()},
            tuple(_numbers(row, records) for row in content.pop("variance")),
            _numbers(content.pop("largest"), draws),
            _numbers(content.pop("force"), draws),
            tuple(_numbers(row, values) for row in content.pop("moved")),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    whole = not content and set(made.gains) <= set(kinds) and bool(made.gains)
    whole &= len(made.variance) == len(made.moved) == draws
    return made if whole and expected == _hash_of(asdict(made)) else None


def _users(place: Path) -> bool:
    """Whether a file or folder, not a link, is the user's own and nobody else may write to it; as far as the system
    tells."""
    found = place.lstat()
    if stat.S_ISLNK(found.st_mode) or not hasattr(os, "getuid"):
        return not stat.S_ISLNK(found.st_mode)
    return found.st_uid == os.getuid() and not found.st_mode & stat.S_IWOTH


def _numbers(row: Sequence[object], count: int) -> tuple[float, ...]:
    """So many finite numbers. Raises ValueError."""
    if not isinstance(row, list) or len(row) != count:
        raise ValueError(f"expected {count} numbers")
    numbers = tuple(float(one) for one in row if isinstance(one, int | float) and not isinstance(one, bool))
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError("expected finite numbers")
    return numbers


def _hash_of(content: Mapping[str, object]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _drawn(layout: Parameters, records: Sequence[Record], roughness: tuple[float, ...], seed: int) -> Drawn:
    """The table of a seed."""
    rng = np.random.default_rng([seed, 1])
    theta = bounded(layout, layout.deviation * np.clip(rng.standard_normal(layout.count), -2, 2))
    truth = Candidate(layout, theta, in_order(layout.machine.effects), roughness=roughness)
    made, begun = simulated_with_starts(truth, records, 1000 * seed)
    fitted = one_step(begun, made, walk=slow_walk(layout.machine))
    left = partial_out(fitted, numbered(pieces(made, loop_time(layout.machine)), made))
    values = _nominal(layout)
    moved = (fitted.candidate.theta - begun.theta)[values] / layout.deviation[values]
    return Drawn(fitted, made, left, moved)


def _nominal(layout: Parameters) -> NDArray[np.int64]:
    """Which of theta are nominal values, not starts of the records."""
    return np.flatnonzero(np.array(layout.names) != "initial_friction_state")


def _gains(drawn: Drawn, findings: Sequence[Finding]) -> Chance:
    """Of a table without any effect: what each gains, the innovations' variance by record, the largest innovation, the
    unknown force [N], and how far the nominal values were moved."""
    fitted, made = drawn.fitted, drawn.records
    gains = {finding.effect.name: finding.held_out for finding in findings}
    gains |= gained_by_chance(fitted, made)
    variance, far = tuple(variance_by_record(fitted).tolist()), largest(fitted).deviations
    return gains, variance, far, force_left(fitted, made), tuple(drawn.moved.tolist())


def _draw(drawn: Drawn, known: Columns) -> Chance:
    return _gains(drawn, drawn.scanned(known)[0])


def _is_of_path(effect: Effect) -> bool:
    """Whether tables on nearly the same path have the same columns of it; a mode rings with what feedback makes of the
    noise, too, of which each table has its own."""
    return not any(item.is_resonance for item in parameters_of(type(effect)))


def _key(machine: Machine, records: Sequence[Record], draws: int, roughness: Sequence[float]) -> str:
    """A hash of all that the null depends on: machine and how well it is known, references, roughness, this program."""
    digest = hashlib.sha256(json.dumps(to_json(machine), sort_keys=True).encode())
    digest.update(parameters(machine, 1).deviation.tobytes())
    for record in records:
        for signal in (record.target, record.reference, record.feedforward):
            digest.update(np.ascontiguousarray(signal).tobytes())
        digest.update(repr(record.every).encode())
    for folder in ("diagnosis", "models"):
        for path in sorted((Path(__file__).parents[1] / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    digest.update(repr((draws, machine.priors.units, tuple(roughness))).encode())
    return digest.hexdigest()[:32]
