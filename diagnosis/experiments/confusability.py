"""Which effects these records can distinguish: computed from their paths alone, before any residual is looked at.

An effect at its typical size changes the whitened innovations by one column. The distance of that column from the best
fit by another effect together with the nominal parameters, within their priors, is in units of the noise: its square is
the chi-square by which the right effect would win. Sizes of effects enter linearly; each shape is tried at three
points, a switch by every law.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, weights
from diagnosis.model.residual import columns
from diagnosis.where.controller import replayed
from diagnosis.which.detectors.command_jitter import lateness
from diagnosis.which.detectors.scan import BATCH, quadratures
from models.effects.base import Effect, Place, parameters
from models.effects.catalogue import every, in_order
from models.effects.parameter import POSITIVE, Parameter
from models.effects.priors import USUAL, Priors
from models.identification.estimate import connected
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

NOTHING: Final = 1e-3  # distance below which an effect shows at no size
PRIOR_ROOM_FACTOR: Final = 1.5  # factor by which a size may exceed its prior range


@dataclass(frozen=True)
class Confusability:
    """Distances [1] in units of the noise, effects in the catalogue's order.

    distance (E, E): of the row's effect at its typical size from the best fit by the column's effect and the nominal
    parameters; on the diagonal from the nominal parameters alone. limits: the detection limit of each effect, which is
    the size at which its squared distance from the nominal parameters reaches the threshold, as (parameter, SI value,
    typical value). equivalent: groups of detectable effects that cannot be distinguished. mistaken: for each effect the
    others that could be mistaken for it. not_identifiable: effects whose typical size is below the detection limit.
    """

    names: tuple[str, ...]
    distance: Array
    threshold: float
    limits: tuple[tuple[str, float, float], ...]
    equivalent: tuple[tuple[str, ...], ...]
    mistaken: Mapping[str, tuple[str, ...]]
    not_identifiable: tuple[str, ...]


@dataclass(frozen=True)
class Columns:
    """Inner products (K, K) of the effects' columns after partialling out the nominal parameters; `place` says which
    columns belong to which point of which effect's grid: name, effect, indices. priors: the machine's."""

    product: Array
    place: tuple[tuple[str, Effect, tuple[int, ...]], ...]
    priors: Priors = USUAL

    def of(self, name: str) -> list[tuple[Effect, list[int]]]:
        """The points of an effect's grid, the typical one first."""
        return [(effect, list(where)) for other, effect, where in self.place if other == name]


def confusability(
    fitted: Fit,
    records: Sequence[Record],
    left_out: Collection[str] = (),
    criteria: Criteria = Criteria(),
) -> Confusability:
    """The matrix for the fit's records, without the effects in `left_out`. Distances are [1].

    An effect that shows in the log only is neither a force nor an addition to the reading, so that no other effect can
    be mistaken for it, nor it for another: its distance from every other is that from the nominal parameters. A log
    that has only one of several samples of the controller doesn't show it at all.
    """
    kinds = fitted.candidate.nominal.kinds
    names = tuple(name for name in kinds if name not in left_out)
    logged = [name for name in names if kinds[name].shown_in() == "log"]
    distance = distances(products(fitted, records, [name for name in names if name not in logged]), names)
    of_log, machine = [names.index(name) for name in logged], fitted.candidate.nominal
    distance[of_log, :] = 0.0
    for i, name in zip(of_log, logged, strict=True):
        if all(record.every == 1 for record in records):
            distance[i, :] = np.sqrt(
                _squared_distance_in_log(kinds[name].typical(machine.priors), fitted, records, criteria)
            )
    distance[:, of_log] = np.diag(distance)[:, None]
    return _confusability(names, distance, machine, criteria.distinguishable)


def _confusability(names: tuple[str, ...], distance: Array, machine: Machine, threshold: float) -> Confusability:
    seen = np.diag(distance) ** 2 >= threshold
    near = distance**2 < threshold
    limits = []
    for i, name in enumerate(names):
        size = _size(machine.kinds[name], machine.priors)
        factor = np.sqrt(threshold) / distance[i, i] if distance[i, i] > NOTHING else np.inf
        limits.append((size.name, float(size.typical * factor), size.typical))
    mistaken = {
        name: tuple(names[j] for j in np.flatnonzero(near[i]) if j != i and seen[j])
        for i, name in enumerate(names)
        if seen[i]
    }
    alike = connected(near & near.T & seen & seen[:, None])
    groups = tuple(sorted(tuple(names[i] for i in group) for group in alike))
    hidden = tuple(name for i, name in enumerate(names) if not seen[i])
    return Confusability(names, distance, threshold, tuple(limits), groups, mistaken, hidden)


def products(fitted: Fit, records: Sequence[Record], names: Sequence[str], *, usual_only: bool = False) -> Columns:
    """The named effects' columns along the records' paths, the nominal parameters partialled out within their
    priors [1]; usual_only: at their typical shapes alone, which takes a fraction of the time."""
    place: list[tuple[str, Effect, tuple[int, ...]]] = []
    variants: list[Effect] = []
    machine = fitted.candidate.nominal
    for name in names:
        kind = machine.kinds[name]
        shapes = kind.placed(machine.plant) or grid(kind, machine.priors)
        for effect in shapes[: 1 if usual_only else None]:
            parts = quadratures(effect)
            place.append((name, effect, tuple(range(len(variants), len(variants) + len(parts)))))
            variants += parts
    weight = weights(records)[:, None]
    filtered = [
        columns(
            fitted.candidate,
            [in_order((*fitted.candidate.effects, variant)) for variant in variants[i : i + BATCH]],
            records,
            fitted.paths,
            fitted.residuals,
            fitted.walk,
        )
        * weight
        for i in range(0, len(variants), BATCH)
    ]
    whole = np.hstack([np.zeros((weight.size, 0)), *filtered])
    basis = fitted.slopes * fitted.candidate.layout.deviation
    onto = basis.T @ whole
    factor = cho_factor(basis.T @ basis + np.eye(basis.shape[1]))
    return Columns(whole.T @ whole - onto.T @ cho_solve(factor, onto), tuple(place), machine.priors)


def grid(kind: type[Effect], priors: Priors = USUAL) -> list[Effect]:
    """The effect at its typical shape first, then at the other points of a small grid [SI]."""
    typical = kind.typical(priors)
    axes = [
        [(item.name, point) for point in _points(item)]
        for item in parameters(kind, priors)
        if item.role in {*POSITIVE, "switch"}
    ]
    found = [replace(typical, **dict(point)) for point in itertools.product(*axes)]
    return [typical, *(other for other in found if other != typical)]


def _points(item: Parameter) -> list[float]:
    """The sizes [SI] of a small grid; every law of a switch."""
    return [*range(int(item.high) + 1)] if item.role == "switch" else sorted({item.low, item.typical, item.high})


def distances(found: Columns, names: Sequence[str]) -> Array:
    """(E, E) [1]: see Confusability; infinite for names without columns."""
    whole = np.full((len(names), len(names)), np.inf)
    known = {name for name, _, _ in found.place}
    for i, name in enumerate(names):
        if name not in known:
            continue
        effect, own = found.of(name)[0]
        size = _size(type(effect), found.priors)
        signs = (1.0, -1.0) if size.low < 0 else (1.0,)
        alone = float(np.mean(np.diag(found.product)[own]))
        for j, other in enumerate(names):
            if other not in known:
                continue
            nearest = [alone] if i == j else [
                min(_squared_distance(found, at, sign, point) for point in found.of(other) for sign in signs)
                for at in own
            ]  # fmt: skip
            whole[i, j] = np.sqrt(max(float(np.mean(nearest)), 0.0))
    return whole


def _size(kind: type[Effect], priors: Priors) -> Parameter:
    return next(item for item in parameters(kind, priors) if item.role in {"amplitude", "width"})


def _squared_distance(found: Columns, at: int, sign: float, point: tuple[Effect, list[int]]) -> float:
    """Squared distance of a column from the best fit by another effect, at one point of its grid, with a size and sign
    within its range."""
    effect, where = point
    gram, onto = found.product[np.ix_(where, where)], sign * found.product[where, at]
    size = _size(type(effect), found.priors)
    most = PRIOR_ROOM_FACTOR * size.high / getattr(effect, size.name)
    best = np.linalg.solve(gram + 1e-9 * (np.trace(gram) + 1e-12) * np.eye(len(where)), onto)
    if len(where) == 1:
        best = np.clip(best, -most if size.low < 0 else 0.0, most)
    else:
        best = best * min(1.0, most / max(float(np.linalg.norm(best)), 1e-300))
    return float(found.product[at, at] - 2 * best @ onto + best @ gram @ best)


def _squared_distance_in_log(typical: Effect, fitted: Fit, records: Sequence[Record], criteria: Criteria) -> float:
    """Squared distance [1] from the nominal parameters of an effect that shows in the log only: through the replay if
    it changes the controller's law, else through the scatter of equal motions."""
    seen = _by_replay if Place.CONTROL in typical.hooks else _by_lateness
    return seen(typical, fitted, records, criteria)


def _by_lateness(typical: Effect, fitted: Fit, records: Sequence[Record], criteria: Criteria) -> float:
    """Squared distance of late commands: their variance over its standard error where motions repeat and none is late,
    scaled so that the detector's own thresholds, of the gain and of the size, count as distinguishable."""
    variance = typical.strength() * records[0].sample_time ** 2
    by_gain = (variance / lateness(fitted, records).scatter) ** 2 / criteria.late_commands_min_gain
    by_size = (typical.strength() / criteria.late_commands_min_size**2) ** 2
    return float(criteria.distinguishable * min(by_gain, by_size))


def _by_replay(typical: Effect, fitted: Fit, records: Sequence[Record], criteria: Criteria) -> float:
    """Squared distance of a relative change of the feedback: the change of the command over the replay's tolerance."""
    total = 0.0
    for record in records:
        replay = replayed(fitted.candidate.nominal, record, criteria)
        if replay.checked:
            feedback = record.command - record.feedforward
            change = typical.strength() * (feedback - np.median(feedback))
            total += float(np.sum((change / replay.tolerance) ** 2))
    return total


def to_json(found: Confusability) -> dict[str, Any]:
    """The matrix and the limits as results.json holds them; SI. An infinite distance becomes null."""
    return {
        "names": list(found.names),
        "distance": found.distance.tolist(),
        "threshold": found.threshold,
        "limits": [
            {"effect": name, "parameter": parameter, "unit": _unit(name, parameter), "limit": limit, "typical": typical}
            for name, (parameter, limit, typical) in zip(found.names, found.limits, strict=True)
        ],
        "equivalent": [list(group) for group in found.equivalent],
        "mistaken": {name: list(others) for name, others in found.mistaken.items() if others},
        "not_identifiable": list(found.not_identifiable),
    }


def _unit(name: str, parameter: str) -> str:
    return next(item.unit for item in parameters(every()[name]) if item.name == parameter)
