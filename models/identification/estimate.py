"""What every identification gives: values with their covariance, and what the data can't tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from models.quantity import listed

Array = NDArray[np.float64]

MIN_CONFUSING_CORRELATION: Final = 0.95  # correlation from which on two parameters can hardly be told apart
STRONG: Final = 10.0  # by which BIC must fall for a parameter more: strong evidence (Kass and Raftery, 1995)
MAX_TOLD_RELATIVE_STD: Final = 10.0  # times its value: beyond, a deviation's share of it says nothing
LEAST_STD: Final = 1e-120  # any unit: none, whose square still is a number, and the sum of its inverses
LOOSE: Final = 0.5  # relative standard deviation from which on a record does not show a parameter


@dataclass(frozen=True)
class Estimate:
    """p parameters: names, units, values (p,) [SI] and their covariance (p, p) [SI]."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array

    @property
    def deviations(self) -> Array:
        """Standard deviations (p,) [SI]."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> Array:
        """Correlation matrix (p, p) [1]."""
        std = np.where(self.deviations > 0, self.deviations, 1.0)
        return np.asarray(self.covariance / np.outer(std, std))

    def value(self, name: str) -> float:
        """The value of one parameter [SI]."""
        return float(self.values[self.names.index(name)])

    def deviation(self, name: str) -> float:
        """The standard deviation of one parameter [SI]."""
        return float(self.deviations[self.names.index(name)])


def not_identifiable(estimate: Estimate, may_be_zero: Sequence[str] = ()) -> tuple[str, ...]:
    """Plain words on what the record can't identify [SI]: parameters that it hardly shows, and pairs that look alike.

    may_be_zero: parameters such as an offset, for which a large deviation beside the value means nothing.
    """
    said = []
    for name, value, std in zip(estimate.names, estimate.values, estimate.deviations, strict=True):
        if name not in may_be_zero and not std < LOOSE * abs(value):
            size = (
                f"{100 * std / abs(value):.0f} % of it"
                if std < MAX_TOLD_RELATIVE_STD * abs(value)
                else f"more than {MAX_TOLD_RELATIVE_STD:g} times it"
            )
            said.append(f"This record does not show the {name}: its standard deviation is {size}.")
    for group in connected(np.abs(estimate.correlation) > MIN_CONFUSING_CORRELATION):
        names = [estimate.names[i] for i in group]
        said.append(
            f"This record hardly tells {listed(names)} from each other (correlations beyond "
            f"{MIN_CONFUSING_CORRELATION:g}): only combinations of them are known well."
        )
    return tuple(said)


def combined(found: Sequence[tuple[float, float]]) -> tuple[float, float, float]:
    """One value from several (value, standard deviation) of the same parameter [any unit]: their mean, each weighted by
    the inverse of its variance, its deviation, and by how many deviations the two that differ most are apart [1].

    Values that scatter beyond their deviations widen the mean's by the root of their reduced chi-square (Birge, 1932).
    """
    if len(found) == 1:
        return *found[0], 0.0  # to the last digit
    values, stds = (np.array(column) for column in zip(*found, strict=True))
    stds = np.maximum(stds, LEAST_STD)
    weights = 1 / stds**2
    mean = float(weights @ values / np.sum(weights))
    chi_square = float(weights @ (values - mean) ** 2) / max(values.size - 1, 1)
    between = np.abs(values[:, None] - values) / np.hypot(stds[:, None], stds)
    return mean, float(np.sqrt(max(1.0, chi_square) / np.sum(weights))), float(np.max(between))


def connected(near: NDArray[np.bool_]) -> list[list[int]]:
    """Groups of two or more whose members hang together by pairs that are near (N, N) [-], the first members rising."""
    _, label = connected_components(near, directed=False)
    groups = (np.flatnonzero(label == number).tolist() for number in dict.fromkeys(label.tolist()))
    return [group for group in groups if len(group) > 1]


def newey_west(jacobian: Array, residual: Array, lags: int) -> Array:
    """Covariance (p, p) of a least-squares estimate [parameters squared] whose errors are coloured over `lags` samples.

    jacobian (n, p), residual (n,). Newey and West (1987), with Bartlett's weights.
    """
    n, p = jacobian.shape
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    scores = jacobian * residual[:, None]
    middle = scores.T @ scores
    for lag in range(1, min(lags, n - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1 - lag / (lags + 1)) * (cross + cross.T)
    return np.asarray(bread @ middle @ bread * n / max(n - p, 1))


def left_out(slopes: Array, errors: Array, part: NDArray[np.int64]) -> Array:
    """Covariance (p, p) [parameters squared] of a least-squares estimate by how it moves when parts are left out.

    slopes (n, p) of the errors (n,); part (n,): which part each sample belongs to. A formula that takes errors for
    noise is too sure of what a model lacks, which stays the same however often it is repeated; this one is not, if
    equal samples are in one part: the delete-a-group jackknife (Shao and Tu, 1995, 2.3).
    """
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    parts = [(slopes[part == one] / scale, errors[part == one]) for one in np.unique(part)]
    normal, pull = (np.array(sums) for sums in zip(*((a.T @ a, a.T @ e) for a, e in parts), strict=True))
    without = zip(normal.sum(0) - normal, pull.sum(0) - pull, strict=True)
    found = np.array([-np.linalg.pinv(matrix) @ right for matrix, right in without]) / scale
    apart = found - found.mean(axis=0)
    return np.asarray((len(parts) - 1) / len(parts) * apart.T @ apart)


def wider(one: Array, other: Array) -> Array:
    """The covariance (p, p) [parameters squared] that is in no direction surer than either; `one` has full rank."""
    values, vectors = np.linalg.eigh(one)
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values.max()))
    inverse = np.linalg.pinv(root)
    sizes, turned = np.linalg.eigh(inverse @ other @ inverse.T)
    spread = root @ turned
    return np.asarray(spread * np.maximum(sizes, 1.0) @ spread.T)
