"""Deviations and rolling of a response in a file: used or refused, never ignored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models.identification.response import FrequencyResponse
from models.records.columns import Columns
from models.records.files import load
from models.records.tables.sizes import RecordError

FREQUENCY = np.geomspace(5, 400, 20)
MAGNITUDE = 1e-3 / FREQUENCY**2


def written(folder: Path, **more: np.ndarray) -> Path:
    """A response of falling magnitude with more columns."""
    columns = {"frequency_Hz": FREQUENCY, "magnitude_m_per_N": MAGNITUDE, "phase_deg": np.full(20, -180.0), **more}
    path = folder / "response.csv"
    np.savetxt(path, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="")
    return path


def content(path: Path, **columns: str) -> FrequencyResponse:
    found = load(path, Columns(**columns)).content
    assert isinstance(found, FrequencyResponse)
    return found


def test_a_deviation_is_relative_or_absolute(tmp_path: Path) -> None:
    relative = content(written(tmp_path, relative_deviation=np.full(20, 0.01)))
    assert np.sqrt(relative.variance) == pytest.approx(0.01 * MAGNITUDE)
    absolute = content(written(tmp_path, deviation_m_per_N=0.02 * MAGNITUDE))
    assert np.sqrt(absolute.variance) == pytest.approx(0.02 * MAGNITUDE)
    mapped = content(written(tmp_path, s=3e6 * MAGNITUDE), deviation="s [nm/N]")
    assert np.sqrt(mapped.variance) == pytest.approx(3e-3 * MAGNITUDE)
    mapped = content(written(tmp_path, s=np.full(20, 0.04)), deviation="s [1]")
    assert np.sqrt(mapped.variance) == pytest.approx(0.04 * MAGNITUDE)
    assert np.all(np.isnan(content(written(tmp_path)).variance))


@pytest.mark.parametrize(
    ("name", "values", "mapped", "says"),
    [
        ("sigma", 0.01, None, "column 'sigma' looks like a deviation, and is not used; map it"),
        ("relative_deviation", 0.0, None, "deviations that are not above 0"),
        ("deviation_m_per_N", np.nan, None, "deviations that are not above 0"),
        ("other", 0.01, "sd [1]", "column 'sd' for the deviation is missing"),
    ],
)
def test_a_deviation_that_is_not_used_is_refused(
    tmp_path: Path, name: str, values: float, mapped: str | None, says: str
) -> None:
    path = written(tmp_path, **{name: np.full(20, values)})
    with pytest.raises(RecordError, match=says):
        content(path, **({"deviation": mapped} if mapped else {}))


def test_a_file_says_that_the_axis_rolled(tmp_path: Path) -> None:
    assert content(written(tmp_path, rolled=np.ones(20))).rolling
    assert not content(written(tmp_path, rolled=np.zeros(20))).rolling
    assert not content(written(tmp_path)).rolling
    with pytest.raises(RecordError, match="must be 1 for all lines, or 0 for all"):
        content(written(tmp_path, rolled=np.arange(20.0) > 5))
