"""What the search finds where nothing is missing, and what its simulated tables share."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis import null
from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, fit, one_step
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.start_states import static_equilibrium_start
from diagnosis.null import Null
from diagnosis.records.motions import numbered, pieces
from diagnosis.which.detectors.scan import NuisanceProjection, partial_out, scan
from models.records.record import Record
from models.simulation.simulator import simulate
from tests.diagnosis.tables import recorded, table
from tests.diagnosis.where.cases import fitted, schedules

MACHINE = table()
PLAN = schedules(MACHINE)
RECORDS = recorded(MACHINE, PLAN, seed=41)
CRITERIA = Criteria()


def test_columns_of_the_same_table_give_the_findings_that_it_gives_alone() -> None:
    found = fitted(MACHINE, RECORDS)
    projection = partial_out(found, numbered(pieces(RECORDS), RECORDS))
    alone, known = scan(found, RECORDS, projection)
    kinds = {effect.name for effect in known}
    assert "current_loop_lag" not in kinds  # the dead time explains nearly all of it
    assert {"cogging", "additional_mode", "viscous_friction"} <= kinds
    shared, _ = scan(found, RECORDS, projection, known=known)
    plain, again = ({one.effect.name: one.held_out for one in findings} for findings in (alone, shared))
    assert again == pytest.approx(plain, rel=1e-4, abs=1e-3)  # columns are kept in single precision


def test_what_tables_share_gives_the_thresholds_that_each_gives_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = parameters(MACHINE, len(RECORDS))
    shared = null.start_null(layout, RECORDS, draws=4).completed()

    def alone_scan(fitted: Fit, records: Sequence[Record], own: NuisanceProjection, known: object = None) -> object:
        del known
        return scan(fitted, records, own)

    monkeypatch.setattr(null, "scan", alone_scan)
    alone = null.start_null(layout, RECORDS, draws=4).completed()
    for name, gains in alone.gains.items():  # of the first table, they are the same by construction
        assert max(shared.gains[name][1:]) == pytest.approx(max(gains[1:]), rel=0.3, abs=0.1 * CRITERIA.min_gain), name


def test_what_complete_models_leave_takes_no_scan_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layout = parameters(MACHINE, len(RECORDS))
    first = null.start_null(layout, RECORDS, draws=3, cache=tmp_path / "null")
    scans = []

    def counted(*given: Any, **options: Any) -> Any:
        scans.append(given)
        return scan(*given, **options)

    monkeypatch.setattr(null, "scan", counted)
    usual = first.usual()
    assert not scans
    whole = first.completed()
    assert len(scans) == 2
    assert usual == whole.usual
    again = null.start_null(layout, RECORDS, draws=3, cache=tmp_path / "null")
    assert again.usual() == usual
    assert again.completed() == whole
    assert len(scans) == 2


def test_one_step_from_the_truth_is_as_good_as_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = parameters(MACHINE, len(RECORDS))
    start = Candidate(layout, static_equilibrium_start(layout, RECORDS))
    assert one_step(start, RECORDS).cost < fit(start, RECORDS, iterations=0).cost - CRITERIA.min_gain
    step = null.start_null(layout, RECORDS, draws=3).completed()
    monkeypatch.setattr(null, "one_step", fit)
    whole = null.start_null(layout, RECORDS, draws=3).completed()
    for name, gains in whole.gains.items():
        assert step.gains[name] == pytest.approx(gains, abs=0.1 * CRITERIA.min_gain), name
    assert np.array(step.variance) == pytest.approx(np.array(whole.variance), rel=1e-3)
    assert step.spike(CRITERIA) == pytest.approx(whole.spike(CRITERIA), rel=0.02)


def test_a_table_starts_where_its_contacts_are_at_the_first_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """It creeps by 2 um while it comes to rest before the record: contacts that can follow do, the others slip."""
    layout, limit = parameters(MACHINE, len(RECORDS)), np.array(MACHINE.friction.limit)
    theta = np.zeros(layout.count)
    theta[layout.of("initial_friction_state")] = np.tile(-0.5 * limit, len(RECORDS))

    def creeping(*given: Any, **options: Any) -> Any:
        run = simulate(*given, **options)
        lead = run.position.size - RECORDS[0].position.size
        return replace(run, position=np.minimum(np.arange(run.position.size) / lead, 1.0) * 2e-6)

    monkeypatch.setattr(null, "simulate", creeping)
    _, state = null._simulated(Candidate(layout, theta), RECORDS[0], 0, 1)
    assert state == pytest.approx(np.minimum(-0.5 * limit + 2e-6, limit), rel=1e-9)


def test_a_threshold_is_beyond_the_largest_gain_by_chance() -> None:
    found = Null({"cogging": (3.0, 50.0), "play": (0.0, 1.0)}, ((1.0,), (1.0,)), (4.0, 7.0))
    assert found.thresholds(CRITERIA) == {"cogging": CRITERIA.null_safety * 50.0, "play": CRITERIA.min_gain}
    assert found.spike(CRITERIA) == CRITERIA.spike_safety * 7.0


def test_complete_models_tell_how_well_a_floor_is_known() -> None:
    """Where contacts slip within less than the scale can tell, one simulation leaves more than another."""
    alike = Null({}, ((0.9, 1.0), (0.9, 1.0)), (4.0, 4.0), (0.1, 0.1))
    assert alike.scatter(RECORDS) == 0.0
    assert np.all(alike.force_scatter(100) == 1.0)
    apart = Null({}, tuple((one,) * len(RECORDS) for one in (0.9, 1.0, 1.1)), (4.0,) * 3, (0.1, 0.1, 0.3))
    assert apart.scatter(RECORDS) == pytest.approx(0.1)
    assert set(apart.force_scatter(1000).round(12)) == {round(1 / 3, 12), 1.0, 3.0}
    assert np.mean(np.log(apart.force_scatter(1000))) == pytest.approx(0.0, abs=0.1)
    unknown = Null({}, ((1.0,) * len(RECORDS),), (4.0,))
    assert unknown.scatter(RECORDS) == 0.0
    assert np.all(unknown.force_scatter(3) == 1.0)


VALUES = np.sum(np.array(parameters(MACHINE, 1).names) != "initial_friction_state")
KEPT = Null(
    {"cogging": (3.0, 50.0), "play": (0.0, 1.0)}, ((1.0, 2.0), (1.5, 1.0)), (4.0, 7.0), (0.1, 0.2),
    ((0.5,) * int(VALUES), (0.25,) * int(VALUES)),
)  # fmt: skip


def test_values_that_a_re_fit_moves_where_nothing_is_wrong_are_biased() -> None:
    draw = np.random.default_rng(0).standard_normal((8, 4))
    drawn = [(-5.0 + 0.1 * row[0], 3.0 * row[1], 0.2 + 0.01 * row[2], 0.0) for row in draw]
    found = Null({}, ((1.0,),) * 8, (4.0,) * 8, (), tuple(drawn)).bias()
    assert found == pytest.approx([-5.0, 0.0, 0.2, 0.0], abs=0.1)
    assert found[1] == 0.0  # chance
    assert Null({}, ((1.0,),), (4.0,), (), ((1.0, 2.0),)).bias() == pytest.approx([0.0, 0.0])


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a kept null of two draws; whoever simulates anew gets no further."""

    def simulates(*_: object) -> None:
        raise InterruptedError

    monkeypatch.setattr(null, "_drawn", simulates)
    layout = parameters(MACHINE, len(RECORDS))
    null._keep(KEPT, tmp_path / "kept" / f"{null._key(layout.machine, RECORDS, 2, ())}.json")
    return tmp_path / "kept"


def looked_up(cache: Path) -> Null:
    return null.start_null(parameters(MACHINE, len(RECORDS)), RECORDS, cache=cache, draws=2).completed()


def test_what_was_kept_is_read_again(cached: Path) -> None:
    assert looked_up(cached) == KEPT
    assert len(list(cached.iterdir())) == 1


def signed(change: Callable[[dict[str, Any]], object]) -> Callable[[str], str]:
    """Another content, with a hash that fits."""

    def spoil(text: str) -> str:
        content = json.loads(text)
        change(content)
        content.pop("sha256")
        return json.dumps({**content, "sha256": null._hash_of(content)})

    return spoil


SPOILED: dict[str, Callable[[str], str]] = {
    "empty": lambda _: "",
    "cut": lambda text: text[:40],
    "a list": lambda _: "[]",
    "a word": lambda _: '"gains"',
    "nested": lambda _: "[" * 100_000,
    "a digit": lambda text: text.replace("50.0", "51.0"),
    "no hash": lambda text: text.replace('"sha256"', '"sha512"'),
    "no gains": signed(lambda one: one.update(gains={})),
    "a key missing": signed(lambda one: one.pop("variance")),
    "a key more": signed(lambda one: one.update(more=1)),
    "an unknown effect": signed(lambda one: one["gains"].update(gremlins=[0.0, 0.0])),
    "a draw missing": signed(lambda one: one["gains"].update(cogging=[3.0])),
    "records of another table": signed(lambda one: one.update(variance=[[1.0], [1.5]])),
    "shifts of another table": signed(lambda one: one.update(moved=[[0.5], [0.25]])),
    "text": signed(lambda one: one.update(largest=["4.0", "7.0"])),
    "not a number": signed(lambda one: one.update(largest=[4.0, float("nan")])),
}


@pytest.mark.parametrize("how", SPOILED)
def test_what_is_spoiled_is_simulated_again(how: str, cached: Path) -> None:
    (file,) = cached.iterdir()
    file.write_text(SPOILED[how](file.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InterruptedError):
        looked_up(cached)


def linked(folder: Path) -> None:
    (file,) = folder.iterdir()
    file.rename(folder.parent / "elsewhere.json")
    file.symlink_to(folder.parent / "elsewhere.json")


@pytest.mark.parametrize("make", [linked, lambda folder: folder.chmod(0o777)], ids=["a link", "anybody's folder"])
def test_what_another_may_have_put_there_is_not_read(make: Callable[[Path], object], cached: Path) -> None:
    make(cached)
    with pytest.raises(InterruptedError):
        looked_up(cached)


def test_a_cache_of_somebody_else_is_neither_read_nor_written(cached: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    with pytest.raises(InterruptedError):
        looked_up(cached)
    null._keep(KEPT, cached / "other.json")
    assert not (cached / "other.json").exists()


def test_a_cache_that_cannot_be_written_stops_no_diagnosis(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    null._keep(KEPT, tmp_path / "file" / "kept.json")
