"""Machines drawn at random: their integrator against closed forms, draws within their ranges and free of the number of
cases, what is written of them."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib import parallel_config
from numpy.typing import NDArray

from models import nominal_file
from models.controller import References
from models.effects.catalogue import looked_for
from models.effects.motor import DacQuantisation
from models.feedback.law import advance, arrays, output
from models.friction import Friction
from models.records import files as record_file
from models.records.record import Record
from models.simulation.effect_kernel import Path as Course
from models.simulation.effect_kernel import replay
from models.simulation.simulator import simulate as run
from studies.blind_trial.guard import SEALER_FOLDER, shared_code
from studies.blind_trial.sealer import pack
from studies.blind_trial.sealer.loop import Log
from studies.blind_trial.sealer.machines import cases, drawing, mechanics, places, simulation, writing
from studies.blind_trial.sealer.machines.axis import Axis, beyond, shift_of, shifted
from studies.blind_trial.sealer.machines.cases import KINDS, Bench, bench, dealt, kind_of, machine_of, sized
from studies.blind_trial.sealer.machines.drawing import draw_axis, sensitivity, stable
from studies.blind_trial.sealer.machines.forms import Form
from studies.blind_trial.sealer.machines.laws import EFFECTS, LAWS, laws_of
from studies.blind_trial.sealer.machines.motions import PROFILES, Schedule, profile
from studies.blind_trial.sealer.machines.simulation import Change, elements, simulate
from studies.blind_trial.sealer.machines.strangers import STRANGERS
from studies.blind_trial.sealer.machines.truth import NAMES
from studies.blind_trial.sealer.machines.visibility import distance, missed, predictor

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[3]


def free(**changed: Any) -> Axis:
    """A machine with two modes, one of them negative, that rolls without friction or feedback."""
    axis = draw_axis(np.random.default_rng(1))[0]
    whole = {
        "sample_time": 5e-4,
        "dead_time": 7e-4,
        "gain": np.array([0.05, 0.01, -0.004]),
        "frequency": np.array([0.0, 40.0, 130.0]),
        "damping": np.array([0.0, 0.01, 0.03]),
        "stiffness": np.zeros(3),
        "limit": np.array([1e-6, 1e-5, 1e-4]),
        "control": {"kind": 0.0, "kp": 0.0, "ki": 0.0, "kd": 0.0, "tau": 1e-3, "b": 1.0, "c": 1.0},
        "delay": 0,
        "rated": 1e9,
    }
    return replace(axis, **{**whole, **changed})


def pushed(axis: Axis, force: Array, change: Change | None = None) -> Log:
    rest = np.zeros(force.size)
    return simulate(axis, Schedule(rest, rest, force, ()), 1, change, exact=True)


def test_a_step_of_force_moves_modes_of_either_sign_as_their_closed_form_says() -> None:
    axis, n, force = free(), 300, 3.0
    x = pushed(axis, np.full(n, force)).position[:, 0]
    t = np.maximum(np.arange(n) * axis.sample_time - axis.dead_time, 0.0)
    wanted = axis.gain[0] * force * t**2 / 2
    for gain, frequency, z in zip(axis.gain[1:], axis.frequency[1:], axis.damping[1:], strict=True):
        w = 2 * np.pi * frequency
        wd = w * np.sqrt(1 - z**2)
        wanted += gain * force / w**2 * (1 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)))
    assert np.abs(x - wanted).max() < 1e-4 * np.abs(wanted).max()


def test_the_integrator_agrees_with_the_sampled_plant() -> None:
    """To the last digits but one, as both are exact or nearly so: the dead time is a fraction of a sample."""
    axis, n = free(), 200
    force = np.random.default_rng(0).standard_normal(n)
    a, b, c = drawing.delayed(axis)
    state, x = np.zeros(b.size), np.empty(n)
    for k in range(n):
        x[k], state = c @ state, a @ state + b * force[k]
    seen = pushed(axis, force).position[:, 0]
    assert np.abs(seen - x).max() < 1e-3 * np.abs(x).max()


@pytest.mark.parametrize("late", [0.0, 1e-9, 0.11, 0.4035, 0.5, 0.99])
def test_a_command_moves_a_mass_from_the_moment_it_begins_to_act(late: float) -> None:
    """To a hundred-thousandth of a nanometre, where a drawn machine's scale reads nanometres: its mean over a quarter
    of a sample, which had acted, left 0.87 nm at 140 N, and that passed for a mode."""
    ts, gain = 5e-4, 1 / 298.0
    axis = free(gain=np.array([gain]), frequency=np.zeros(1), damping=np.zeros(1), dead_time=(2 + late) * ts)
    force = np.random.default_rng(0).uniform(-140.0, 140.0, 200)
    seen = pushed(axis, force).position[:, 0]
    begins = (np.arange(force.size) + 2 + late) * ts
    since = np.maximum(np.arange(force.size)[:, None] * ts - begins, 0.0)
    wanted = gain * (since**2 / 2) @ np.diff(force, prepend=0.0)
    assert np.max(np.abs(seen - wanted)) < 1e-14


def test_a_slow_push_meets_the_elements_and_then_rolls() -> None:
    """A spring of all stiffnesses while nothing slips; Newton's law with all limits once everything does."""
    limit = np.array([2e-6, 1e-5, 5e-5])
    axis = free(stiffness=np.array([2e5, 5e4, 2e4]), limit=limit, gain=np.array([0.05]), frequency=np.zeros(1),
                damping=np.zeros(1), dead_time=0.0)  # fmt: skip
    log = pushed(axis, np.concatenate([np.full(400, 40.0), np.full(10, 40.0)]))
    v = np.gradient(log.position[:, 0], axis.sample_time)
    start = elements(axis)[0] @ log.start
    a = np.gradient(v, axis.sample_time)[300:390]
    friction = float(axis.stiffness @ axis.limit)
    assert log.position[-1, 0] > 100 * limit.max()
    assert np.mean(a) == pytest.approx(axis.gain[0] * (40.0 + start - friction), rel=1e-6)


@pytest.mark.parametrize("form", [form for form in LAWS if form.effect == "cogging"], ids=lambda form: form.text)
def test_cogging_is_a_force_along_the_guide(form: Form, small: Bench) -> None:
    """On a free body, Newton's law turns the acceleration back into a force that only the place tells."""
    axis = free(gain=np.array([0.05]), frequency=np.zeros(1), damping=np.zeros(1), dead_time=0.0)
    shape = {"cog_pitch": 0.01, "cog_phase": 0.4}
    log = pushed(axis, np.full(2000, 0.6), form.change(0.1, shape, small.units))
    x = log.position[:, 0]
    a = np.diff(x, 2) / axis.sample_time**2
    force, place = a / axis.gain[0] - 0.6, x[1:-1]
    again = np.interp(place % 0.01, np.sort(place % 0.01), force[np.argsort(place % 0.01)])
    assert 0.05 < np.abs(force).max() < 0.25
    if form.text == "three harmonics":
        assert np.abs(force - again).max() < 0.02


@pytest.fixture(scope="module")
def small() -> Bench:
    """A machine whose records are short."""
    return next(one for number in range(40) if (one := quick(number)) is not None)


@pytest.fixture(scope="module")
def silent(small: Bench) -> Log:
    """Its run with the long moves, without an effect."""
    return simulate(replace(small.axis, rated=1e9), far_and_no_further(small), 5, exact=True)


def far_and_no_further(small: Bench) -> Schedule:
    """The record with the long moves until it was at the far end."""
    whole = next(one for one in small.schedules if "long" in one.parts)
    end = int(np.argmax(whole.reference > 0.95 * whole.reference.max())) + 300
    return Schedule(whole.target[:end], whole.reference[:end], whole.feedforward[:end], whole.parts)


def quick(number: int) -> Bench | None:
    axis = draw_axis(np.random.default_rng([5, 1, number]))[0]
    if axis.sample_time < 1.5e-3:
        return None
    found = bench(5, number)
    return found if any("long" in one.parts for one in found.schedules) else None


def test_draws_are_within_their_ranges_and_can_run() -> None:
    styles, negative, modes = Counter[str](), 0, set()
    for number in range(40):
        axis, _ = draw_axis(np.random.default_rng([3, number]))
        styles[axis.style] += 1
        negative += int(np.any(axis.gain < 0))
        modes.add(axis.gain.size - 1)
        for value, (low, high) in (
            (axis.mass, drawing.MASS),
            (axis.friction, drawing.FRICTION),
            (axis.reach, drawing.REACH),
            (axis.resolution, drawing.RESOLUTION),
            (axis.crossover, drawing.CROSSOVER),
            (axis.limit.size, drawing.ELEMENTS),
            (2 * axis.known.mass, drawing.OFF),
            (axis.dead_time / axis.sample_time, (0.0, 3.0)),
            *((one, drawing.FREQUENCIES) for one in axis.frequency[1:]),
        ):
            assert low * (1 - 1e-12) <= value <= high * (1 + 1e-12)
        for stiffness in (0.0, float(axis.stiffness.sum())):
            assert stable(axis, stiffness)
            assert sensitivity(axis, stiffness) <= drawing.PEAK
    assert set(styles) == set(drawing.STYLES)
    assert negative > 3
    assert modes == set(range(drawing.MODES + 1))


def test_every_drawn_machine_has_a_nominal_file_that_is_taken(tmp_path: Path) -> None:
    for number in range(25):
        axis, _ = draw_axis(np.random.default_rng([6, number]))
        (tmp_path / "nominal.json").write_text(json.dumps(axis.nominal("drawn")), encoding="utf-8")
        machine = nominal_file.load(tmp_path / "nominal.json")
        assert machine.plant.mass == pytest.approx(axis.mass)
        assert machine.tolerance.mass == axis.known.mass


def test_an_unstable_machine_is_rejected_for_that() -> None:
    axis = draw_axis(np.random.default_rng(2))[0]
    stiff = {name: (100.0 * one if name in ("kd", "kp", "ki", "kvel") else one) for name, one in axis.control.items()}
    assert drawing.unfit(replace(axis, control=stiff, rated=1e12)) == "the loop is unstable"


def test_nothing_of_a_case_depends_on_how_many_there_are() -> None:
    """Kind, deck and machine follow from the seed and the number of the case alone; shares hold in every twenty."""
    kinds = [kind_of(9, k) for k in range(100)]
    for block in range(5):
        counts = Counter(kind for kind, _ in kinds[20 * block : 20 * block + 20])
        assert counts == Counter(KINDS)
    for kind in KINDS:
        assert [turn for name, turn in kinds if name == kind] == list(range(5 * KINDS[kind]))
    assert sorted(dealt(9, 1, 7, turn) for turn in range(7)) == list(range(7))
    assert sorted(dealt(9, 1, 7, turn) for turn in range(7, 14)) == list(range(7))
    machines = Counter(machine_of(k) for k in range(96))
    assert machines == Counter(dict.fromkeys(range(16), cases.EACH))


def test_every_effect_has_two_forms_or_more() -> None:
    assert set(EFFECTS) == set(looked_for()) - {
        "scale_gain_error",
        "noncollocated_friction",
        "friction_driven_mode",
        "load_side_friction",
    }  # as in test_forms.py
    assert all(len({form.text for form in laws_of(name)}) >= 2 for name in EFFECTS)
    assert not {form.effect for form in STRANGERS} & set(looked_for())


@pytest.mark.parametrize("kind", PROFILES)
def test_a_move_goes_to_its_end_and_never_back(kind: str) -> None:
    path = profile(kind, 50)
    assert path[-1] == pytest.approx(1.0, abs=1e-12)
    assert np.all(np.diff(path) >= 0)


def test_an_experiment_keeps_to_travel_speed_and_time(small: Bench) -> None:
    axis = small.axis
    assert 10.0 * 0.8 < small.units.lasts < 60.0 * 1.2
    for one in small.schedules:
        assert one.target.shape == one.reference.shape == one.feedforward.shape
        assert np.abs(one.reference).max() < 2.0 * axis.travel
        assert np.abs(np.diff(one.reference)).max() < 1.1 * axis.speed * axis.sample_time
        assert one.reference[-1] == pytest.approx(one.target[-1], abs=1e-12)


def test_sizes_reach_their_distance_and_without_an_effect_there_is_none(small: Bench) -> None:
    assert cases._distance(small, Change(), 3) == pytest.approx(0.0, abs=1e-9)
    form = laws_of("cogging")[0]
    part = sized(small, form, 45.0, np.random.default_rng(1), 11)
    assert part.distance == pytest.approx(45.0, rel=0.2)
    logs = [
        simulate(small.axis, one, 11 + i, part.change(small.units), start=cases.START + i, exact=True)
        for i, one in enumerate(small.schedules)
    ]
    assert distance(small.known, logs) == pytest.approx(part.distance)


def test_a_force_that_was_there_before_the_record_is_no_distance(small: Bench) -> None:
    """However much larger than the offset's tolerance: nobody knows what the drive held."""
    pulled = replace(small.axis, offset=0.3 * small.axis.friction)
    logs = [simulate(pulled, one, 11 + i, start=cases.START + i, exact=True) for i, one in enumerate(small.schedules)]
    assert distance(small.known, logs) < 3.0


def test_distances_are_in_units_of_what_the_friction_at_a_reading_leaves(small: Bench) -> None:
    """Where the contacts are so stiff that the scale's noise is noise of the friction."""
    shaky = replace(small.axis, noise=0.02 * small.axis.friction / small.axis.stiffness.sum(), resolution=1e-12)
    log = simulate(shaky, small.schedules[0], 5)
    at_readings = np.repeat(log.reading[:, None], log.position.shape[1], axis=1)
    left = missed(predictor(shaky), replace(log, position=at_readings))[200:]
    assert 0.5 < np.var(left) < 2.0


@pytest.mark.parametrize("form", [*LAWS, *STRANGERS], ids=lambda form: f"{form.effect}: {form.text}")
def test_every_form_changes_the_command(form: Form, small: Bench, silent: Log) -> None:
    size = float(np.clip(form.sizes(small.units)[1], *form.sizes(small.units)[::2]))
    schedule = far_and_no_further(small)
    axis = replace(small.axis, rated=1e9)
    change = form.change(size, form.shape(small.units, np.random.default_rng(4)), small.units)
    with_it = simulate(axis, schedule, 5, change, exact=True)
    assert np.abs(with_it.command - silent.command).max() > 1e-11 * small.units.peak  # else equal bit by bit


def test_true_values_are_off_by_what_the_nominal_file_says(small: Bench) -> None:
    axis = small.axis
    shifts = [shift_of(axis, np.random.default_rng(seed)) for seed in range(200)]
    off = [abs(shifted(axis, shift).mass / axis.mass - 1) for shift in shifts]
    assert 1.5 * axis.known.mass < max(off) <= 2.1 * axis.known.mass
    assert abs(beyond(axis, "payload_mass", np.random.default_rng(1))) > 2 * axis.known.mass


@pytest.fixture(scope="module", params=drawing.STYLES)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A written case without effects on a machine with each kind of controller, its records cut short."""
    rng = np.random.default_rng(8)
    axis = next(one for _ in range(99) if (one := draw_axis(rng)[0]).style == request.param and one.sample_time > 4e-4)
    w = np.concatenate([np.zeros(50), 50 * axis.reach * profile("quintic", 300), np.full(300, 50 * axis.reach)])
    schedule = Schedule(w, w, np.zeros(w.size), ())
    own = Bench(3, replace(axis, rated=1e9), (schedule, schedule), None, None, Counter())  # type: ignore[arg-type]
    plain = {name: np.zeros_like(one) for name, one in shift_of(axis, rng).items()}
    place = tmp_path_factory.mktemp("case") / "case-0001"
    writing.write(place, cases.Plan("case-0001", "clean", "", own, (), plain, (), 77))
    return place


def test_the_nominal_file_holds_the_controller_that_ran(written: Path) -> None:
    """The project's own law, from the file, gives the logged command to the last logged digit but the integral's
    start."""
    machine = nominal_file.load(written / "nominal.json")
    found = record_file.load(written / "first.csv.gz").content
    assert isinstance(found, Record)
    control = machine.control
    law = control.law or replace(control, pid=replace(control.pid, derivative_weight=1.0 - 1e-12)).law
    rows, delay = arrays(law), control.reference_delay
    goal = np.concatenate([np.zeros(delay), found.reference[: found.reference.size - delay]])
    replayed = np.empty(goal.size)
    for k, (r, x) in enumerate(zip(goal, found.position, strict=True)):
        replayed[k] = output(rows, r, x)
        advance(rows, r, x, 0.0)
    rest = found.command - found.feedforward - replayed
    settled = 40 + round(10 * control.pid.derivative_filter / machine.sample_time)
    assert np.ptp(rest[settled:]) < 1e-5 * np.ptp(found.command)


@pytest.mark.parametrize("style", drawing.STYLES)
def test_the_projects_own_simulator_agrees(style: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two programs that share nothing, one from the object and one from its nominal file, give one motion, as long as
    the sealer's contacts are as sharp as the nominal ones."""
    monkeypatch.setattr(simulation, "SEEN", 0.0)
    rng = np.random.default_rng(21)
    axis = next(one for _ in range(99) if (one := draw_axis(rng)[0]).style == style and one.gain.size > 1)
    axis = replace(axis, rated=1e9)
    there = 5 * axis.reach * profile("quintic", round(0.2 / axis.sample_time))
    path = np.concatenate([np.zeros(20), there, there[::-1], np.zeros(20)])
    log = simulate(axis, Schedule(path, path, np.zeros(path.size), ()), 3, exact=True)
    (tmp_path / "nominal.json").write_text(json.dumps(axis.nominal("drawn")), encoding="utf-8")
    machine = nominal_file.load(tmp_path / "nominal.json")
    machine = replace(machine, scale=replace(machine.scale, resolution=0.0, noise=0.0))
    lead = np.zeros(round(0.3 / axis.sample_time))
    goal = np.concatenate([lead, path])
    given = References(goal, np.zeros(goal.size), np.zeros(goal.size))
    theirs = run(machine, machine.feedback_only(), goal, given=given, initial_friction=log.start[1::3]).record
    difference = theirs.command[lead.size :] - log.command
    assert np.abs(difference).max() < 0.01 * np.ptp(log.command)
    assert np.abs(theirs.position[lead.size :] - log.reading).max() < 1e-3 * axis.reach


def test_what_is_written_tells_no_label(written: Path) -> None:
    assert sorted(one.name for one in written.iterdir()) == ["first.csv.gz", "nominal.json", "second.csv.gz"]
    text = (written / "nominal.json").read_text(encoding="utf-8")
    assert "kind" not in json.loads(text)
    assert not any(name in text for name in EFFECTS)


@dataclass(frozen=True)
class Stub:
    """What a pack needs of a plan."""

    case: str
    seed: int

    def body(self) -> dict[str, Any]:
        return {"case": self.case, "name": [], "seed": self.seed}


@pytest.fixture
def stubbed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Cases that take no time to make, by the names of those that were written."""
    made: list[str] = []

    def put(place: Path, found: Any) -> None:
        place.mkdir(exist_ok=True)
        made.append(found.case)

    monkeypatch.setattr(cases, "plan", lambda seed, k, case: Stub(case, seed + k))
    monkeypatch.setattr(writing, "write", put)
    monkeypatch.setattr(pack, "parallel_config", lambda **_: parallel_config(backend="sequential"))
    return made


def sealed(folder: Path, count: int, tell: Callable[[int, str], None] | None = None) -> Any:
    places = pack.Places(folder / "pack", folder / "key.json")
    pack.seal(count, 4, places, jobs=1, tell=tell, machines="random")
    return json.loads((folder / "key.json").read_text(encoding="utf-8"))


def test_a_larger_pack_begins_with_the_cases_of_a_smaller_one(stubbed: list[str], tmp_path: Path) -> None:
    few, many = tmp_path / "few", tmp_path / "many"
    for one in (few, many):
        one.mkdir()
    small_key, large_key = sealed(few, 3), sealed(many, 5)
    assert {case: large_key[case] for case in small_key} == small_key
    assert len(stubbed) == 8
    assert not (few / "pack" / "nominal.json").exists()


def test_an_interrupted_seal_goes_on_where_it_was(stubbed: list[str], tmp_path: Path) -> None:
    def stop(done: int, _: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sealed(tmp_path, 4, stop)
    begun = list(stubbed)
    key = sealed(tmp_path, 4)
    assert sorted(key) == sorted(stubbed) == ["case-0001", "case-0002", "case-0003", "case-0004"]
    assert begun == ["case-0001", "case-0002"]


def test_the_sealer_shares_no_code_with_what_it_judges() -> None:
    packages = ("models", "design", "diagnosis")
    assert shared_code(SEALER_FOLDER / "machines", [ROOT / one for one in packages], packages) == []


@pytest.mark.parametrize("form", [1.0, 2.0])
def test_no_converter_is_one_of_the_catalogue(form: float) -> None:
    """Whatever of its laws, and with steps of a half, the same or twice the height."""
    machine, u = np.zeros(len(NAMES)), np.linspace(-0.52, 0.53, 2101)
    machine[places.DAC], machine[places.DAC_FORM] = 0.05, form
    out = np.array([mechanics.amplified(machine, float(command)) for command in u])
    path = Course(1e-3, u[:, None], u[:, None], u, u)
    for law, factor in itertools.product((0, 1, 2), (0.5, 1.0, 2.0)):
        stepped = replay(Friction((1.0,), (1.0,), (0.0,)), (DacQuantisation(0.05 * factor, law),), path, 0.0).sent[:, 0]
        assert np.std(out - stepped) > 0.3 * np.std(out - u)
