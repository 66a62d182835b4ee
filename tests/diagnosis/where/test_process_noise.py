"""A force that follows no law, such as wind: what is told of it is in units of what it does, not of the scale's noise.

The scale is so fine that the force leaves hundreds of times what it promises, as on a telescope in the wind.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from diagnosis.criteria import Criteria
from diagnosis.experiments.confusability import confusability
from diagnosis.model.fit import Fit, weights
from diagnosis.model.residual import columns
from diagnosis.model.roughness import variance_by_record
from diagnosis.records.motions import pieces
from diagnosis.where.force import borne_out
from diagnosis.where.locate import locate
from diagnosis.where.side import force_or_reading
from models.effects.catalogue import every
from models.records.record import Record
from tests.diagnosis.where.cases import case, windy

AS_STATED = Criteria(rough_variance=np.inf)  # by which the weights of the scale's noise stay


def test_weights_that_hold_stay() -> None:
    records, fit = case("")
    assert borne_out(fit, records) is fit


@pytest.mark.parametrize("seed", range(3))
def test_beside_a_force_that_walks_the_wind_is_noise(seed: int) -> None:
    records, fit = windy(seed)
    assert np.min(variance_by_record(fit)) > 100
    assert variance_by_record(borne_out(fit, records)) == pytest.approx(1.0, abs=0.2)


def test_wind_is_never_called_an_error_of_the_scale() -> None:
    told, before = [], []
    for seed in (1, 4):
        records, fit = windy(seed)
        told.append(force_or_reading(locate(fit, records, pieces(records)).sides))
        before.append(force_or_reading(locate(fit, records, pieces(records), criteria=AS_STATED).sides))
    assert told == ["neither", "neither"]
    assert "scale" in before


@pytest.mark.parametrize("name", ["viscous_friction", "cogging", "directional_friction"])
def test_detection_limits_allow_for_what_wind_looks_like(name: str) -> None:
    """The size that wind alone takes for an effect, over its detection limit, which is of a chi-square of 40."""
    sizes, before = list[float](), list[float]()
    for seed in range(3):
        records, fit = windy(seed)
        for one, found in ((fit, before), (borne_out(fit, records), sizes)):
            limit = confusability(one, records, set(every()) - {name})
            found.append(looks_like(name, one, records) / dict(zip(limit.names, limit.limits, strict=True))[name][1])
    assert np.max(np.abs(sizes)) < 1
    assert np.max(np.abs(before)) > 1


def looks_like(name: str, fit: Fit, records: Sequence[Record]) -> float:
    """The size [SI] of an effect that fits best, together with the nominal values."""
    effect = every()[name].typical(fit.candidate.nominal.priors)
    column = columns(fit.candidate, [[effect]], records, fit.paths, fit.residuals, fit.walk)[:, 0] * weights(records)
    basis = fit.slopes * fit.candidate.layout.deviation
    normal = basis.T @ basis + np.eye(basis.shape[1])
    apart = column - basis @ np.linalg.solve(normal, basis.T @ column)
    return float(-(apart @ fit.innovations) / (apart @ column)) * effect.strength()
