"""Which law of which size goes into which record: the whole design, in an order of which any beginning is balanced.

Every law is drawn in three sizes, by how well the record could show it, and three phases for each record. A law that
is a wrong nominal value has its size from the machine file's tolerance instead.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.injection.distance import LIMIT, SIZES, Noise, distance, unexplained
from studies.blind_trial.injection.laws import LAWS, Chance, Injected, Ranges
from studies.blind_trial.injection.motion import Course

Array = NDArray[np.float64]

THIRDS: Final = 3
OF_TOLERANCE: Final = {"low": 1 / 3, "middle": 1.0, "high": 2.0}  # sizes of what is a wrong nominal value
PROBE_FORCE_SHARE: Final = 1e-3  # of the largest force: at this size a law is measured that is not linear in it
STEEPEST: Final = 0.3  # largest size of a law that divides the thrust
# Of the record's own command: an injected force beyond, both as rms, would be no small change.
MAX_FORCE_SHARE: Final = 0.3
MIN_CUT: Final = 1e-9  # of a force: by less it is not cut, as that is rounding


@dataclass(frozen=True)
class Known:
    """What is known of the records before anything is injected: each one's motion and roughness, that also with any
    friction over speed explained (`free`); the ranges that the machine gives to laws; the names that it searches for;
    effects that it states already; the sizes of one tolerance of nominal values; the rated thrust [N]."""

    courses: tuple[Course, ...]
    noises: tuple[Noise, ...]
    free: tuple[Noise, ...]
    ranges: Ranges
    searched: tuple[str, ...]
    stated: tuple[str, ...]
    tolerances: Mapping[str, float]
    rated: float


@dataclass(frozen=True)
class Plan:
    """One case: the record it goes into, the law, its severity, which third of its phases, and the seed."""

    case: str
    record: int
    law: Injected
    severity: str
    third: int
    seed: tuple[int, ...]


@dataclass(frozen=True)
class Drawn:
    """A force (n,) [N] and what is sealed of it."""

    force: Array
    body: Mapping[str, Any]


def laws_for(known: Known) -> tuple[Injected, ...]:
    """The laws that can be told apart from the nominal model of this machine, or whose name it does not search for."""
    return tuple(
        law for law in LAWS if law.kind != "single" or (law.name in known.searched and law.name not in known.stated)
    )


def size_of_design(known: Known) -> int:
    """The number of cases of the whole design."""
    return len(known.courses) * len(laws_for(known)) * len(SIZES) * THIRDS


def plans(known: Known, seed: int, cases: int) -> tuple[Plan, ...]:
    """The first so many cases of the design in the order of this seed: every law comes once before any comes again."""
    rng, records = np.random.default_rng([seed, 11]), len(known.courses)
    laws = laws_for(known)
    order = rng.permutation(len(laws))
    pairs = [(severity, third) for third in range(THIRDS) for severity in SIZES]
    found = []
    for turn in range(len(pairs)):
        for shift in range(records):
            for k, which in enumerate(order.tolist()):
                severity, third = pairs[(turn + 2 * k + 4 * shift) % len(pairs)]
                record = (k + turn + shift) % records
                found.append((record, laws[which], severity, third))
    width = max(2, len(str(cases)))
    return tuple(Plan(f"case-{i + 1:0{width}d}", *what, (seed, 12, i)) for i, what in enumerate(found[:cases]))


def draw(plan: Plan, known: Known) -> Drawn:
    """The force of a case, and its label's body."""
    path, noise, law = known.courses[plan.record], known.noises[plan.record], plan.law
    shape = law.draw(Chance(np.random.default_rng(plan.seed), plan.third, known.ranges), path)
    if law.kind == "parameters":
        size = OF_TOLERANCE[plan.severity] * known.tolerances[law.name]
    else:
        seen = distance(law.force(path, PROBE_FORCE_SHARE, shape), noise) / PROBE_FORCE_SHARE
        size = SIZES[plan.severity] / seen
        size = min(size, STEEPEST) if law.unit == "1" else size
    force = law.force(path, size, shape)
    while (part := _part_that_fits(force, path.command, known.rated)) < 1 - MIN_CUT:
        size *= part
        force = law.force(path, size, shape)
    apart, beside = distance(force, noise), distance(force, known.free[plan.record])
    is_force = law.kind != "parameters"
    body = {
        "name": [law.name],
        "kind": law.kind,
        "severity": plan.severity,
        "identifiable": is_force and apart >= LIMIT * (1 - 1e-9),
        "identifiable_beside_speed": is_force and beside >= LIMIT * (1 - 1e-9),
        "record": plan.record,
        "force_N": _rms(force),
        "unexplained_force_N": _rms(unexplained(force, noise)),
        "effects": [
            {
                "name": law.name,
                "form": law.form,
                "size": size,
                "unit": law.unit,
                "distance": apart,
                "distance_beside_speed": beside,
                "shape": shape,
                "period": {law.period: shape["period"]} if law.period else {},
            }
        ],
    }
    return Drawn(force, body)


def _part_that_fits(force: Array, command: Array, rated: float) -> float:
    """The part of a force (n,) [N] beside which the command (n,) [N] stays within the rating [N], and which is no more
    than the largest share of the command; up to 1 [1]."""
    beyond = np.abs(command + force) > rated
    room = rated - command[beyond] * np.sign(force[beyond])
    most = MAX_FORCE_SHARE * _rms(command) / max(_rms(force), 1e-300)
    return float(min(1.0, most, np.min(room / np.abs(force[beyond]), initial=1.0)))


def _rms(force: Array) -> float:
    return float(np.sqrt(np.mean(force**2)))


def secrets(bodies: Mapping[str, Mapping[str, Any]], seed: int) -> dict[str, dict[str, str]]:
    """Nonce and body of every case's label; the nonces follow from the seed, so that they need not be kept."""
    root = hashlib.scrypt(str(seed).encode(), salt=b"nonces of an injection", n=2**14, r=8, p=1)
    return {
        case: {
            "nonce": hmac.new(root, case.encode(), "sha256").hexdigest(),
            "body": json.dumps({"case": case, **body}, sort_keys=True),
        }
        for case, body in bodies.items()
    }


def commitments(secret: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """What is published of every label before it is opened: SHA-256 of nonce + body."""
    return {case: hashlib.sha256((one["nonce"] + one["body"]).encode()).hexdigest() for case, one in secret.items()}


def ranges_of(rows: Sequence[tuple[str, str, float, float]]) -> Ranges:
    """Ranges of positive sizes by effect and parameter, from (effect, parameter, low, high) [their units]."""
    return {(effect, name): (low, high) for effect, name, low, high in rows if 0 < low < high}
