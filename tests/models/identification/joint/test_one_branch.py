"""One branch of several slow records: its errors are as large as its deviations say, and smaller than each record's."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from models.friction import branch, elements
from models.identification.estimate import Estimate
from models.identification.force.fit import ForceFit
from models.identification.joint.one_branch import one_branch

TRUTH = np.array([4e6, 1e6, 2e5, 1e-6, 6e-6, 4e-5])
WITH_ONE_MORE = np.array([4e6, 5e5, 5e5, 2e5, 1e-6, 6e-6, 6.0000001e-6, 4e-5])  # the same branch


def _fit(truth: NDArray[np.float64], relative: float, draw: np.random.Generator) -> ForceFit:
    """A fit whose parameters err independently by a relative deviation [1]."""
    values = truth * (1 + relative * draw.standard_normal(truth.size))
    count = truth.size // 2
    names = tuple(f"element {i + 1} {part}" for part in ("stiffness", "limit") for i in range(count))
    estimate = Estimate(names, ("N/m",) * count + ("m",) * count, values, np.diag((relative * truth) ** 2))
    one, path = np.ones(8), np.linspace(-1e-4, 1e-4, 8)
    friction = elements(values[:count], values[count:])
    return ForceFit(friction, estimate, (0.0,), one, path, one, one, one, one > 0)


@pytest.mark.parametrize("other", [TRUTH, WITH_ONE_MORE], ids=["as many elements", "one more"])
def test_one_branch_is_as_good_as_its_deviations_say(other: NDArray[np.float64]) -> None:
    draw, far = np.random.default_rng(1), np.array([3e-6, 3e-5, 2e-4])
    pulls, gains = [], []
    for _ in range(200):
        fits = [_fit(TRUTH, 0.02, draw), _fit(other, 0.02, draw), _fit(TRUTH, 0.03, draw)]
        force, std = one_branch(fits).curve(far)
        pulls.append((force - branch(elements(TRUTH[:3], TRUTH[3:]), far)) / std)
        gains.append(std / min((fit.curve(far)[1] for fit in fits), key=lambda each: float(each[-1])))
    assert np.sqrt(np.mean(np.square(pulls), axis=0)) == pytest.approx(1, abs=0.2)
    assert np.all(np.mean(gains, axis=0) < 0.85)


def test_one_record_keeps_its_elements_to_the_last_digit() -> None:
    fit = _fit(TRUTH, 0.02, np.random.default_rng(2))
    assert one_branch([fit]) is fit


def test_a_branch_of_records_that_disagree_is_as_uncertain_as_they_differ() -> None:
    draw = np.random.default_rng(3)
    weak, strong = _fit(TRUTH, 1e-3, draw), _fit(TRUTH * np.repeat([1.3, 1.0], 3), 1e-3, draw)
    slip, std = one_branch([weak, strong]).slip_force()
    apart = strong.slip_force()[0] - weak.slip_force()[0]
    assert weak.slip_force()[0] < slip < strong.slip_force()[0]
    assert 0.3 * apart < std < apart
