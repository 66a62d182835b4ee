"""An angle that begins again after a turn goes on where it is read."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from models.records.columns import Columns
from models.records.files import load
from models.records.record import Record

Array = NDArray[np.float64]

COLUMNS = Columns(
    time="t [s]", command="torque [N m]", position="angle [deg]", reference="wanted [deg]", target="end [deg]"
)
SHARE = np.clip((np.arange(3000) - 200) / 2000, 0.0, 1.0)
WAY = SHARE**3 * (10 - 15 * SHARE + 6 * SHARE**2)


def read(
    tmp_path: Path, start: float, way: float, wrapped: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], Record, tuple[str, ...]]:
    """The signals of a move [deg], and what is read of them where those named begin again after a turn; findings."""
    signals = {
        "angle": start + way * WAY + 0.01 * np.sin(np.arange(WAY.size) / 40),
        "wanted": start + way * WAY,
        "end": np.where(np.arange(WAY.size) < 200, start, start + way),
    }
    logged = {name: signal % 360.0 if name in wrapped else signal for name, signal in signals.items()}
    columns = {"t": 1e-3 * np.arange(WAY.size), "torque": np.sin(np.arange(WAY.size) / 300), **logged}
    path = tmp_path / "turn.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    found = load(path, COLUMNS, trusted=True)
    assert isinstance(found.content, Record)
    return signals, found.content, found.findings


@pytest.mark.parametrize("wrapped", [("angle", "wanted", "end"), ("angle",), ("angle", "end")])
@pytest.mark.parametrize(
    ("start", "way"), [(330.0, 60.0), (20.0, -60.0), (355.0, 170.0), (355.0, 250.0), (20.0, -200.0), (0.0, 900.0)]
)
def test_an_angle_goes_on_over_a_turn(tmp_path: Path, start: float, way: float, wrapped: tuple[str, ...]) -> None:
    """A user's log of -10 to 370 degrees was refused, with the advice to turn the sign of the command."""
    signals, record, findings = read(tmp_path, start, way, wrapped)
    assert any(one.startswith("The position jumps by a turn") for one in findings)
    for signal, name in ((record.position, "angle"), (record.reference, "wanted"), (record.target, "end")):
        apart = np.rad2deg(signal) - signals[name]
        assert np.ptp(apart) < 1e-6, name
        assert apart[0] == pytest.approx(round(apart[0] / 360) * 360, abs=1e-6)


@pytest.mark.parametrize(("start", "way"), [(20.0, 60.0), (-200.0, 720.0)])
def test_an_angle_that_never_jumps_by_a_turn_stays_as_it_is(tmp_path: Path, start: float, way: float) -> None:
    signals, record, findings = read(tmp_path, start, way, ())
    assert not any("by a turn" in one for one in findings)
    np.testing.assert_allclose(record.position, np.deg2rad(signals["angle"]))
    np.testing.assert_allclose(record.target, np.deg2rad(signals["end"]))


def test_a_step_of_a_turn_beside_others_as_large_is_none_that_begins_again(tmp_path: Path) -> None:
    """As of counts in a wrong unit: what the record is refused for otherwise."""
    angle = math.tau * np.cumsum(np.random.default_rng(0).uniform(-0.6, 1.0, 400))
    path = tmp_path / "turn.csv"
    rows = np.column_stack([1e-3 * np.arange(400), np.sin(np.arange(400) / 9), np.rad2deg(angle)])
    np.savetxt(path, rows, delimiter=",", header="t,torque,angle", comments="")
    found = load(path, Columns(time="t [s]", command="torque [N m]", position="angle [deg]"), trusted=True)
    assert isinstance(found.content, Record)
    np.testing.assert_allclose(found.content.position, angle)
