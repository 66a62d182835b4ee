"""The proof's own means: a distance in units in the last place, and faults that the self-test has to catch."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from design.deployment.c_source import law_sources
from models.deployment.coefficients import load_coefficients
from studies.export.compute import sizes
from studies.export.faults import FAULTS
from studies.export.proof import missed_faults, ulps
from tests.design.deployment.compiling import NEEDS_CC, compiled, put, run
from tests.models.deployment.laws import written


def test_the_distance_counts_the_numbers_between_two() -> None:
    one = np.array([1.0, -2.0, 0.0, 5e-324])
    assert ulps(one, one) == 0
    assert ulps(np.array([0.0]), np.array([-0.0])) == 0
    assert ulps(one, np.array([np.nextafter(1.0, 2.0), -2.0, 0.0, 5e-324])) == 1
    assert ulps(np.array([5e-324]), np.array([-5e-324])) == 2
    assert ulps(one, np.array([math.nan, -2.0, 0.0, 0.0])) == math.inf


@NEEDS_CC
@pytest.mark.parametrize("kind", ["PID", "filters and anti-windup", "learning"])
def test_the_memory_that_is_stated_is_that_of_the_struct(kind: str, tmp_path: Path) -> None:
    known = load_coefficients(written(kind, tmp_path), math.nan, math.nan)
    main = (
        '#include "axis_law.h"\n#include <stdio.h>\nint main(void) { printf("%d", (int)sizeof(axis_law)); return 0; }\n'
    )
    put(tmp_path, {**law_sources(known, "a test"), "size.c": main})
    stated = sizes(known, 0.02)
    for flags, key in (((), "memory_double_bytes"), (("-DAXIS_FLOAT",), "memory_single_bytes")):
        assert int(run(compiled(tmp_path, ["size.c"], flags))[1]) == pytest.approx(stated[key], abs=8)


@NEEDS_CC
@pytest.mark.parametrize(("kind", "least"), [("PID", 23), ("filters and anti-windup", 18), ("learning", 33)])
def test_every_planted_fault_is_caught(kind: str, least: int, tmp_path: Path) -> None:
    known = load_coefficients(written(kind, tmp_path), math.nan, math.nan, 5e-3 if kind == "PID" else 0.0)
    put(tmp_path, law_sources(known, "a test"))
    missed, planted = missed_faults(tmp_path, known, 0)
    assert missed == []
    assert least <= planted <= len(FAULTS)
