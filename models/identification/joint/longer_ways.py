"""A spring to ground that short loops show, judged by the records of the same call that go a longer way.

What friction lacks as a model passes over a short way for a spring, and times a travel that is hundreds of times as
long it is a force that no record has. Over a longer way a spring's force is as many times larger: friction by the short
loops' elements (one factor for all), inertia, drag, offset and k x are fitted to the command there by least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from models.friction import Friction
from models.identification.estimate import newey_west
from models.identification.force.by_elements import TOGETHER
from models.identification.force.fit import SPRING
from models.identification.force.linear import LAGS, linear_columns, parameter_names, prepared
from models.identification.force.signals import Terms, fast_band
from models.quantity import show
from models.records.files import Loaded
from models.records.record import Record


@dataclass(frozen=True)
class Stiffness:
    """A spring to ground: its stiffness and the standard deviation [N/m], and the record that shows it."""

    value: float
    std: float
    loaded: Loaded

    def said(self) -> str:
        """The stiffness, and over which way it was seen."""
        return f"{show(self.value, 'N/m', 3)} ± {show(self.std, 'N/m', 2)} over a way of {show(way(self.loaded), 'm')}"


def surest(
    records: Sequence[Loaded], shorter: float, terms: Terms, friction: Friction, lowest_mode: float
) -> Stiffness | None:
    """What the record of a way beyond `shorter` [m] shows that knows a spring best; None without such a record. terms:
    what is known beside friction; lowest_mode [Hz]: of the plant."""
    shown = list(
        _shown(records, shorter, replace(terms, viscous=True, spring=True, damped=False), friction, lowest_mode)
    )
    return min(shown, key=lambda one: one.std, default=None)


def way(loaded: Loaded) -> float:
    """How far a record goes from end to end [m]; 0 for a frequency response."""
    return float(np.ptp(loaded.content.position)) if isinstance(loaded.content, Record) else 0.0


def _shown(
    records: Sequence[Loaded], shorter: float, terms: Terms, friction: Friction, lowest_mode: float
) -> Iterator[Stiffness]:
    for one in records:
        if isinstance(one.content, Record) and way(one) > shorter:
            with suppress(ValueError):  # a record that shows nothing judges nothing
                yield Stiffness(*_over_the_way(one.content, terms, friction, lowest_mode), one)


def _over_the_way(record: Record, terms: Terms, friction: Friction, lowest_mode: float) -> tuple[float, float]:
    """The stiffness and its standard deviation [N/m]. Raises ValueError for a record that shows no force."""
    count = len(friction.limit)
    data = prepared(record, terms, fast_band(record, lowest_mode), np.inf)
    columns, force = linear_columns(data, np.array(friction.limit), np.zeros(len(LAGS)))
    columns = np.column_stack([columns[:, :-count], columns[:, -count:] @ np.array(friction.stiffness)])
    scale = np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, force, rcond=None)[0]
    covariance = newey_west(columns / scale, force - columns / scale @ weights, TOGETHER)
    at = parameter_names(terms, count)[0].index(SPRING)
    return float(weights[at] / scale[at]), float(np.sqrt(covariance[at, at]) / scale[at])
