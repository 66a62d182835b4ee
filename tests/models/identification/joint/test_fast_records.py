"""Fast records beside others: one viscous friction with a response, one offset with slow ones."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from models.identification.estimate import Estimate
from models.identification.joint.fast_records import _with_the_records_before, _with_the_response
from models.identification.joint.steps import Identified
from models.identification.modes import DRAG
from models.identification.pipeline import identify
from models.machine import Machine, load
from models.records.files import Loaded
from studies.identify_machine import own_records

NOMINAL = load()
TABLE = own_records.another(own_records.noisy(NOMINAL), 5)


def _after(*response: float) -> Identified:
    """What a response gave before: the drag and its deviation [N s/m], or nothing of it."""
    names = (DRAG,) if response else ()
    gave = Estimate(names, ("N s/m",) * len(names), np.array(response[:1]), np.diag(np.array(response[1:]) ** 2))
    return cast(Identified, SimpleNamespace(last=lambda _: SimpleNamespace(estimate=gave)))


def test_the_surer_drag_decides_and_a_disagreement_is_told() -> None:
    """A die bonder's axis (8 N s/m): 7.5 +- 1.2 of a sweep, and strokes of 40 um had put 41 +- 10 in its place."""
    together, said = _with_the_response(_after(7.53, 1.2), (41.1, 10.2))
    assert together is not None
    assert together[0] == pytest.approx(7.99, abs=0.01)
    assert together[1] == pytest.approx(3.9, abs=0.1)  # as wide as the two differ
    assert "41.1 N s/m ± 10 N s/m, and that of the frequency response, 7.53 N s/m ± 1.2 N s/m" in said[0]
    assert "differ by 3.3 standard deviations" in said[0]


def test_drags_that_agree_are_averaged_without_a_word() -> None:
    together, said = _with_the_response(_after(8.5, 1.0), (9.5, 1.0))
    assert together is not None
    assert together == pytest.approx((9.0, 2**-0.5))
    assert said == []


def test_what_one_of_them_does_not_show_the_other_does() -> None:
    """Strokes that show no drag had taken that of the response out of the file."""
    assert _with_the_response(_after(8.0, 1.0), None) == ((8.0, 1.0), [])
    assert _with_the_response(_after(), (8.0, 1.0)) == ((8.0, 1.0), [])
    assert _with_the_response(_after(), None) == (None, [])


def _short_strokes(machine: Machine) -> Loaded:
    """Strokes that do not leave presliding, so that the constant force may as well be one that friction holds."""
    t = np.arange(round(4 / machine.sample_time)) * machine.sample_time
    path = 0.6 * max(machine.friction.limit) * np.sin(2 * np.pi * 8 * t)
    return Loaded("strokes.csv", "34cd", own_records.run(machine, path, np.zeros(t.size), 7), (), ())


@cache
def _by_strokes(offset: float) -> Identified:
    """What the strokes alone show where a constant force [N] acts."""
    strokes = _short_strokes(replace(TABLE, drive=replace(TABLE.drive, offset=offset)))
    return identify(NOMINAL, [strokes], kinds=["dynamics"])


def test_strokes_that_hardly_tell_the_offset_leave_that_of_slow_loops() -> None:
    """They had put 2.6 N +- 4.3 N in place of -0.40 N +- 0.002 N, and a tolerance of 4.3 N with it."""
    slow = Loaded("slow.csv", "12ab", own_records.hysteresis(TABLE, 5), (), ())
    found = identify(NOMINAL, [slow, _short_strokes(TABLE)], kinds=["hysteresis", "dynamics"])
    loops = found.estimates["slow.csv"]
    source = found.machine.sources["drive.offset"]
    assert found.machine.drive.offset == pytest.approx(loops.value("offset"), abs=loops.deviation("offset"))
    assert source.std == pytest.approx(loops.deviation("offset"), rel=0.01)
    assert source.record == "slow.csv, strokes.csv"
    assert found.machine.tolerances.offset == NOMINAL.tolerances.offset


def test_an_offset_that_no_record_tells_is_not_handed_over() -> None:
    found = _by_strokes(TABLE.drive.offset)
    assert found.estimates["strokes.csv"].deviation("offset") > 10 * NOMINAL.tolerances.offset
    assert (found.machine.drive, found.machine.tolerance) == (NOMINAL.drive, NOMINAL.tolerance)
    assert found.machine.sources_of("drive") == NOMINAL.sources_of("drive")
    assert any("No record tells the offset better than to" in one for one in found.remarks)


def test_an_offset_that_surely_departs_from_the_files_is_handed_over_however_vague() -> None:
    """As of an axis that hangs, beside a file that knows of no weight."""
    machine = _by_strokes(60.0).machine
    assert machine.drive.offset == pytest.approx(60.0, abs=3 * machine.tolerances.offset)
    assert machine.tolerances.offset > 10 * NOMINAL.tolerances.offset
    assert machine.sources["tolerance.offset"].record == "strokes.csv"


def test_offsets_of_fast_records_and_others_that_differ_are_told() -> None:
    gave = Estimate(("offset",), ("N",), np.array([1.0]), np.array([[0.01]]))
    step = SimpleNamespace(kind="hysteresis", gave=SimpleNamespace(estimate=gave))
    (value, std), said = _with_the_records_before(cast(Identified, SimpleNamespace(steps=[step])), (0.0, 0.1))
    assert (value, std) == pytest.approx((0.5, 0.5))
    assert "The offset of the fast records, 0 N ± 0.1 N, and that of the records before them, 1 N ± 0.1 N, " in said[0]
