"""The sealer's machine against closed forms, and its effects, sizes and packs."""

from __future__ import annotations

import ast
import gzip
import json
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from models.records import files as record_file
from models.records.record import Record
from studies.blind_trial.sealer import draw, nominal, simulate
from studies.blind_trial.sealer.distance import contact_force, distance
from studies.blind_trial.sealer.effects import CATALOGUE, Change, Law
from studies.blind_trial.sealer.labels import IDENTIFIABLE
from studies.blind_trial.sealer.loop import POINTS, Log
from studies.blind_trial.sealer.outsiders import OUTSIDERS
from studies.blind_trial.sealer.pack import AGAIN, EXPERIMENTS, OTHER, Places, commitment, record, seal
from studies.blind_trial.sealer.physics import elements_force
from studies.blind_trial.sealer.schedule import Schedule, deadbeat, sampled, sequential, suite

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[3]
SEALER = ROOT / "studies" / "blind_trial" / "sealer"
TABLE = nominal.load()
ALLOWED = {"numpy", "scipy", "numba", "joblib", "studies"}


def test_it_imports_nothing_of_the_project_but_itself() -> None:
    for file in SEALER.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [f"{'.' * node.level}{node.module or ''}"] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                first = name.partition(".")[0]
                assert first in ALLOWED or first in sys.stdlib_module_names, f"{file.name} imports {name}"
                assert first != "studies" or name.startswith("studies.blind_trial.sealer"), f"{file.name}: {name}"


def test_files_stay_short() -> None:
    assert all(len(file.read_text(encoding="utf-8").splitlines()) < 400 for file in SEALER.rglob("*.py"))


def without_friction() -> nominal.Table:
    """The nominal table, rolling freely and without feedback."""
    return replace(TABLE, stiffness=np.zeros(10), gains=(0.0, 0.0, 0.0, 1e-3))


def pushed(force: Array, table: nominal.Table) -> Log:
    rest = np.zeros(force.size)
    return simulate.simulate(table, Schedule(rest, rest, force), 1, exact=True)


def test_a_step_of_force_moves_the_modes_as_their_closed_form_says() -> None:
    n, force = 400, 3.0
    log = pushed(np.full(n, force), without_friction())
    t = np.maximum(np.arange(n) * TABLE.sample_time - TABLE.dead_time, 0.0)
    x = TABLE.gain[0] * force * t**2 / 2
    for gain, frequency, damping in zip(TABLE.gain[1:], TABLE.frequency[1:], TABLE.damping[1:], strict=True):
        w, z = 2 * np.pi * frequency, damping
        wd = w * np.sqrt(1 - z**2)
        x += gain * force / w**2 * (1 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)))
    assert np.abs(log.position[:, 0] - x).max() < 1e-9 * np.abs(x).max() + 1e-13


def test_work_done_is_kinetic_energy_and_what_friction_took() -> None:
    rigid = replace(TABLE, gain=TABLE.gain * np.array([1.0, 0.0, 0.0]), gains=(0.0, 0.0, 0.0, 1e-3), dead_time=0.0)
    force = np.concatenate([np.full(100, 40.0), np.full(100, -25.0), np.full(100, 5.0), np.zeros(100)])
    log = pushed(force, rigid)
    x = log.position[:, 0]
    start = log.start @ simulate.spread(rigid)[0]  # the integral holds the table where it begins
    work = np.sum((force + start)[:-1] * np.diff(x))
    last = log.position[-1]
    speed = (last[-1] - last[-3]) / (2 * TABLE.sample_time / POINTS)
    inside = (force[-1] + start) * (last[2] - last[0])
    kinetic = 0.5 / TABLE.gain[0] * speed**2
    assert log.energy == pytest.approx(work + inside - kinetic, rel=2e-3)
    assert log.energy > 0.1 * work


def force_along(path: Array) -> Array:
    """Friction [N] of the whole table along points of a path, from rest."""
    fine = np.repeat(path[:, None], 1, axis=1)
    stiffness, limit = simulate.spread(TABLE)
    return np.asarray(contact_force(fine, stiffness, limit, np.zeros(limit.size)))


def moved_to(*places: float) -> float:
    """Friction [N] after a path through these places [m], in small steps."""
    path = np.concatenate(
        [np.linspace(a, b, 4001)[:-1] for a, b in zip((0.0, *places), (*places, places[-1]), strict=True)]
    )
    return float(force_along(path)[-1])


@pytest.mark.parametrize("amplitude", [1.5e-6, 8e-6, 60e-6, 300e-6])
def test_friction_follows_masings_rule(amplitude: float) -> None:
    """From a reversal on, force and way are the virgin curve's, twice as large."""
    for share in (0.1, 0.5, 1.0):
        way = 2 * amplitude * share
        assert moved_to(amplitude) - moved_to(amplitude, amplitude - way) == pytest.approx(
            2 * moved_to(way / 2), rel=1e-9
        )


def test_a_loop_dissipates_what_slipping_contacts_do() -> None:
    """4 K L (A - L) a cycle from each element whose limit L is below the amplitude A."""
    amplitude = 50e-6
    turn = np.concatenate([np.linspace(-1, 1, 20001), np.linspace(1, -1, 20001)[1:]]) * amplitude
    path = np.concatenate([np.linspace(0, -amplitude, 2001)[:-1], turn, turn])
    force = force_along(path)
    last = slice(path.size - turn.size, path.size - 1)
    lost = np.sum(force[last] * np.diff(path)[path.size - turn.size :])
    stiffness, limit = simulate.spread(TABLE)
    slips = limit < amplitude
    assert lost == pytest.approx(np.sum(4 * stiffness * limit * (amplitude - limit) * slips), rel=1e-3)


def test_the_friction_is_fitted_to_the_nominal_curve() -> None:
    """Between the nominal corners the curves agree; a corner is rounded by less than 1 % of the friction."""
    way = np.geomspace(1e-7, 5e-4, 400)
    exact = (TABLE.stiffness[:, None] * np.minimum(way, TABLE.limit[:, None])).sum(axis=0)
    stiffness, limit = simulate.spread(TABLE)
    own = (stiffness[:, None] * np.minimum(way, limit[:, None])).sum(axis=0)
    assert np.abs(own - exact).max() < 0.01 * exact.max()
    assert np.abs(own - exact).max() > 0
    assert own[-1] == pytest.approx(exact[-1], rel=1e-12)


def test_the_deadbeat_moves_end_at_rest() -> None:
    a, b, c = sampled(TABLE)
    u, x = deadbeat(40)
    state = np.zeros(b.size)
    for k, force in enumerate(u):
        assert c @ state == pytest.approx(x[k], abs=1e-12)
        state = a @ state + b * force
    assert np.abs(state - np.array([1, 0, 0, 0, 0, 0])).max() < 1e-6


def test_schedules_hold_what_a_pack_is_said_to_hold() -> None:
    assert sequential().target.size == 30000
    assert np.abs(np.diff(sequential().target, prepend=0.0)).max() == pytest.approx(20e-6)
    steps = np.abs(np.diff(suite().target))
    for stroke, count in ((2e-6, 2), (200e-6, 2), (20e-3, 2), (60e-3, 6)):
        assert np.count_nonzero(np.isclose(steps, stroke)) == count
    assert abs(suite().reference[-1] - suite().target[-1]) < 1e-9
    assert np.abs(suite().feedforward).max() < 200


NAMED = {**CATALOGUE, **OUTSIDERS}


@cache
def moves() -> Schedule:
    """The first 3 s of the suite, its ladder of moves, and the fast strokes at its end: a third of its time."""
    whole, first, last = suite(), round(3.0 / TABLE.sample_time), round(2.76 / TABLE.sample_time)
    parts = ((one[:first], one[-last:]) for one in (whole.target, whole.reference, whole.feedforward))
    return Schedule(*(np.concatenate(part) for part in parts))


@pytest.fixture(scope="module")
def silent() -> Log:
    """Those moves on the nominal table."""
    return simulate.simulate(TABLE, moves(), 5, exact=True)


@pytest.mark.parametrize("name", sorted(NAMED))
def test_every_effect_moves_the_command(name: str, silent: Log) -> None:
    law = NAMED[name]
    change = law.change(law.middle, law.shape(np.random.default_rng(2)))
    log = simulate.simulate(TABLE, moves(), 5, change.fields, change.signals, exact=True)
    assert np.abs(log.command - silent.command).max() > 0.01
    assert np.all(np.isfinite(log.command))
    assert np.abs(log.position).max() < 0.1


@pytest.mark.parametrize("speed", [1e-4, 1e-3, 1e-2])
def test_directional_friction_is_by_the_speed_of_the_table(speed: float) -> None:
    """Both ways it takes a F_c v/(v^2 + v_d^2)^(1/2) more of the motor, F_c all elements slipping."""
    way = np.arange(1, round(max(5e-4 / speed, 0.4) / TABLE.sample_time)) * speed * TABLE.sample_time
    there = np.concatenate([way, np.full(400, way[-1])])
    path = np.concatenate([there, way[-1] - there])
    schedule = Schedule(path, path, np.zeros(path.size))
    fields = {"directional": 0.1, "turn_speed": 1e-3}
    with_it, without = (simulate.simulate(TABLE, schedule, 5, one, exact=True) for one in (fields, {}))
    more = with_it.command - without.command
    stiffness, limit = simulate.spread(TABLE)
    expected = 0.1 * float(stiffness @ limit) * speed / np.hypot(speed, 1e-3)
    for begin in (0, there.size):
        last = slice(begin + way.size - way.size // 5, begin + way.size)  # all elements slip by then
        assert np.mean(more[last]) == pytest.approx(expected, rel=0.03)


def seen(change: Change) -> float:
    logs = [
        simulate.simulate(TABLE, schedule(), 5, change.fields, change.signals, exact=True)
        for schedule in (sequential, suite)
    ]
    return distance(TABLE, logs)


@pytest.mark.parametrize("name", ["reading_dropouts", "gusts"])
def test_the_label_tells_how_visible_an_effect_is_in_the_cases_own_records(name: str) -> None:
    """A random event may occur where it is invisible, so another draw's distance does not apply."""
    found = draw.plan("case-1", "outsider", "high", list(OUTSIDERS).index(name), [7, 1, 1])
    (part,) = found.parts
    logs = [
        simulate.simulate(TABLE, EXPERIMENTS[each](), found.seed + i, part.change.fields, part.change.signals, True)
        for i, each in enumerate(EXPERIMENTS)
    ]
    assert part.distance == pytest.approx(distance(TABLE, logs), rel=1e-9)
    other = replace(found, seed=found.seed + 1)
    assert record(found, sequential(), 0) != record(other, sequential(), 0)


def test_distance_is_none_without_an_effect_and_grows_with_its_size() -> None:
    law: Law = CATALOGUE["viscous_friction"]
    shape = law.shape(np.random.default_rng(0))
    one, two = (seen(law.change(size, shape)) for size in (10.0, 20.0))
    assert seen(Change()) < 3
    assert two / one == pytest.approx(2, rel=0.05)


def test_nominal_errors_within_tolerance_are_explained() -> None:
    """Their residual is of second order: far below that of an effect of the same energy."""
    shift = nominal.shift_of(np.random.default_rng(1))
    table = nominal.shifted(TABLE, shift)
    logs = [simulate.simulate(table, schedule(), 5, exact=True) for schedule in (sequential, suite)]
    assert 3 < distance(TABLE, logs) < 50


@pytest.mark.parametrize("count", [1, 7, 60, 300])
def test_a_draw_is_balanced(count: int) -> None:
    kinds = Counter(kind for kind, _, _ in draw.order(count, 3))
    assert all(abs(kinds[kind] - share * count) <= 1.5 for kind, share in draw.KINDS.items())


def test_a_large_draw_has_every_effect_at_every_severity() -> None:
    cases = draw.order(300, 3)
    assert len({(severity, entry) for kind, severity, entry in cases if kind == "single"}) == 3 * len(CATALOGUE)
    assert {entry for kind, _, entry in cases if kind == "outsider"} == set(range(len(OUTSIDERS)))
    assert len(OUTSIDERS) >= 8


def test_sizes_reach_their_distance_and_what_is_below_need_not_be_found() -> None:
    plans = [draw.plan("case-01", "single", severity, 2, [4, 4]) for severity in draw.SEVERITIES]
    for plan, goal in zip(plans, draw.SEVERITIES.values(), strict=True):
        (part,) = plan.parts
        assert part.distance is not None
        assert part.distance == pytest.approx(goal, rel=0.2)
        assert plan.body()["identifiable"] == (part.distance >= IDENTIFIABLE)


def test_nothing_wrong_means_exactly_the_nominal_table() -> None:
    shift = draw.plan("case-01", "clean", "", 0, [1, 2]).shift
    true = nominal.shifted(TABLE, shift)
    assert true.dead_time == TABLE.dead_time
    assert np.array_equal(true.gain, TABLE.gain)
    assert np.array_equal(true.stiffness, TABLE.stiffness)


def test_nominal_draws_are_bounded_at_two_deviations() -> None:
    draws = nominal.bounded(np.random.default_rng(0), 20000)
    assert 1.9 < np.abs(draws).max() <= 2.0
    shift = draw.plan("case-01", "parameters", "", 2, [1, 2])
    assert abs(shift.shift["dead_time"]) > nominal.LATENESS


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A pack of two and its key, made by the program."""
    place = tmp_path_factory.mktemp("sealed")
    done = run_sealer(
        "--cases", "2", "--seed", "224", "--output", str(place / "pack"), "--key", str(place / "key.json")
    )
    assert done.returncode == 0, done.stderr
    return place / "pack", place / "key.json"


def run_sealer(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "studies.blind_trial.sealer", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_the_program_writes_the_layout_of_a_pack(sealed: tuple[Path, Path]) -> None:
    pack, key = sealed
    assert sorted(one.name for one in pack.iterdir()) == ["case-01", "case-02", "commitments.json", "nominal.json"]
    for case in ("case-01", "case-02"):
        assert {"sequential.csv.gz", "suite.csv.gz"} <= {one.name for one in (pack / case).iterdir()}
        assert json.loads(json.loads(key.read_text(encoding="utf-8"))[case]["body"])["case"] == case


@pytest.mark.parametrize("module", ["pack", "on_request"])
def test_it_computes_on_one_thread_as_the_studies_do(module: str) -> None:
    """Threads of the matrices would take the other processes' cores, and sum in another order by their number."""
    script = f"""
        import importlib, threadpoolctl
        importlib.import_module("studies.blind_trial.sealer.{module}")
        print(*{{one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}})
    """
    free = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", dedent(script)]
    done = subprocess.run(command, cwd=ROOT, env=free, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1"]


def test_a_key_in_the_pack_is_refused(tmp_path: Path) -> None:
    done = run_sealer("--cases", "1", "--seed", "1", "--output", str(tmp_path), "--key", str(tmp_path / "key.json"))
    assert done.returncode == 2
    assert "lies in the pack" in done.stderr
    assert not (tmp_path / "case-01").exists()


def test_records_are_readable_and_their_controller_replays(sealed: tuple[Path, Path]) -> None:
    for name in ("sequential", "suite"):
        found = record_file.load(sealed[0] / "case-01" / f"{name}.csv.gz").content
        assert isinstance(found, Record)
        kp, ki, kd, tau = TABLE.gains
        ts = TABLE.sample_time
        late = np.concatenate([np.zeros(TABLE.reference_delay), found.reference[: -TABLE.reference_delay]])
        error = late - found.position
        share = tau / (tau + ts)
        derivative = lfilter([(1 - share) / ts, -(1 - share) / ts], [1, -share], error)
        law = kp * error + ki * ts * np.cumsum(error) + kd * derivative + found.feedforward
        rest = (found.command - law)[60:]
        assert np.abs(rest - rest.mean()).max() < 1e-5
        assert np.abs(found.position / 1e-7 - np.round(found.position / 1e-7)).max() < 1e-4


def test_the_same_seed_gives_the_same_bytes() -> None:
    plans = [draw.plan("case-01", "single", "high", 4, [9, 9]) for _ in range(2)]
    assert record(plans[0], sequential(), 0) == record(plans[1], sequential(), 0)


def test_an_interrupted_seal_keeps_what_it_sealed_and_no_file_of_it_holds_a_label(tmp_path: Path) -> None:
    pack, key = tmp_path / "pack", tmp_path / "key.json"
    places = Places(pack, key, tmp_path / "again")
    done: list[str] = []

    class InterruptedError(Exception):
        """An interruption of the sealer."""

    def plug(count: int, case: str) -> None:
        done.append(case)
        if count == 1:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        seal(2, 224, places, jobs=1, tell=plug)
    assert not key.exists()
    named = "|".join([*CATALOGUE, *OUTSIDERS, "nominal_shift"])
    for file in tmp_path.rglob("*"):
        text = gzip.decompress(file.read_bytes()) if file.suffix == ".gz" else file.is_file() and file.read_bytes()
        assert not re.search(named.encode(), text or b""), file
    records = pack / done[0] / "suite.csv.gz"
    before = records.stat().st_mtime_ns
    seal(2, 224, places, jobs=1)
    assert records.stat().st_mtime_ns == before
    opened = json.loads(key.read_text(encoding="utf-8"))
    commitments = json.loads((pack / "commitments.json").read_text(encoding="utf-8"))
    assert {case: commitment(one["nonce"], one["body"]) for case, one in opened.items()} == commitments
    assert sorted(one.name for one in tmp_path.iterdir()) == ["again", "key.json", "pack"]


def test_the_key_can_be_drawn_after_the_answers(sealed: tuple[Path, Path], tmp_path: Path) -> None:
    """By another process, from the numbers alone; another seed has other nonces, as it has other records."""
    done = run_sealer("--cases", "2", "--seed", "224", "--key", "/dev/stdout")
    assert json.loads(done.stdout) == json.loads(sealed[1].read_text(encoding="utf-8"))
    seal(1, 9, Places(key=tmp_path / "key.json"), jobs=1)
    other = json.loads((tmp_path / "key.json").read_text(encoding="utf-8"))
    assert other["case-01"]["nonce"] not in done.stdout


def test_second_measurements_can_be_made_after_the_answers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Nothing else is drawn for them, and they are of the cases that are measured twice when all is made at once."""
    drawn: list[str] = []

    def plan(case: str, *_: object) -> draw.Plan:
        drawn.append(case)
        return clean([1, 2])

    def write_case(place: Path, _: draw.Plan) -> None:
        place.mkdir()

    monkeypatch.setattr("studies.blind_trial.sealer.pack.plan", plan)
    monkeypatch.setattr("studies.blind_trial.sealer.pack.write_case", write_case)
    seal(60, 3, Places(again=tmp_path / "later"), jobs=1)
    assert drawn
    assert [one.name for one in sorted((tmp_path / "later").glob("case-*"))] == drawn
    kinds = draw.order(60, 3)
    assert {kinds[int(case[5:]) - 1][:2] for case in drawn} == {AGAIN}
    seal(60, 3, Places(tmp_path / "pack", again=tmp_path / "at_once"), jobs=1)
    assert [one.name for one in sorted((tmp_path / "at_once").glob("case-*"))] == drawn[: len(drawn) - 60]


def test_the_seed_of_a_cases_records_is_known_without_its_whole_draw() -> None:
    assert draw.seed_of([1, 2]) == clean([1, 2]).seed


def clean(seed: list[int]) -> draw.Plan:
    return draw.plan("case-01", "clean", "", 0, seed)


def test_a_second_measurement_is_of_the_same_table_and_not_the_same() -> None:
    plan = draw.plan("case-01", "clean", "", 0, [1, 2])
    one, two = (record(replace(plan, seed=plan.seed + more), sequential(), 0) for more in (0, OTHER))
    assert one != two


def test_a_lopsided_contact_slips_at_the_same_force_both_ways() -> None:
    """Otherwise it would be directional friction, which is in the catalogue."""
    machine = simulate.physics_of(TABLE, {"lopsided": 0.3})
    z = np.zeros(machine.limit.size)
    far, near = (elements_force.py_func(machine, way, 1.0, z) for way in (1e-3, 1e-7))
    back, close = (elements_force.py_func(machine, -way, 1.0, z) for way in (1e-3, 1e-7))
    assert far == pytest.approx(-back, rel=1e-12)
    assert near / -close == pytest.approx(1.3 / 0.7, rel=1e-9)
