"""Several records of one machine: one estimate of all, and in what they disagree."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from models.friction import elements
from models.identification.estimate import Estimate
from models.identification.force import by_elements
from models.identification.force.fit import ForceFit
from models.identification.pipeline import identify
from models.machine import load
from models.records.files import Loaded
from models.records.record import Record

MACHINE = load()


def test_slow_records_of_one_machine_give_one_estimate_and_their_disagreement(monkeypatch: pytest.MonkeyPatch) -> None:
    """Offset and elements are the means by the deviations, which are as wide as the records differ."""
    n = 8
    names, units = ("offset", "element 1 stiffness", "element 1 limit"), ("N", "N/m", "m")
    one, path = np.ones(n), np.linspace(0, 1e-4, n)

    def fit(offset: float, level: float, std: float) -> ForceFit:
        friction = elements([level * 1e6], [1e-5])
        values = np.array([offset, level * 1e6, 1e-5])
        covariance = np.diag([0.1**2, (std * 1e5) ** 2, 1e-20])
        return ForceFit(
            friction, Estimate(names, units, values, covariance), (0.0, -100.0), one, path, one, one, one, one > 0
        )

    drag = Estimate((*names, "viscous friction"), (*units, "N s/m"), np.ones(4), np.eye(4))
    fits = iter([fit(0.0, 1.0, 0.1), fit(1.0, 2.0, 0.3)])
    plain = replace(fit(0.0, 1.0, 0.1), estimate=drag)
    monkeypatch.setattr(by_elements, "identify", lambda _, terms, **__: plain if terms.viscous else next(fits))
    moved = np.linspace(0.0, 1e-3, n)
    record = Record(MACHINE.sample_time, moved, moved, np.zeros(n), np.zeros(n), moved)
    found = identify(
        MACHINE, [Loaded(name, name, record, (), ()) for name in ("a", "b")], kinds=["hysteresis", "hysteresis"]
    )
    assert found.machine.drive.offset == pytest.approx(0.5)
    assert found.machine.sources["drive.offset"].std == pytest.approx(0.5)
    assert found.machine.sources["drive.offset"].record == "a, b"
    assert found.machine.friction.stiffness == pytest.approx((1.1e6,), rel=0.02)  # of 1 +- 0.01 and 2 +- 0.03 N/um
    assert found.machine.sources["friction.stiffness"].record == "a, b"
    std = found.machine.sources["friction.stiffness"].std
    assert isinstance(std, tuple)
    assert std[0] == pytest.approx(0.3e6, rel=0.15)
    said = " ".join(found.remarks)
    assert "a and b disagree in the offset, 0 N ± 0.1 N and 1 N ± 0.1 N, by 7.1 standard deviations" in said
    assert re.search("a and b disagree in the slip force, 10 N ± [0-9.]+ N and 20 N ± [0-9.]+ N, by", said)
