"""From records to a machine file that every other study takes."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import chirp

from models.effects import catalogue
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.friction import elements
from models.identification import modes
from models.identification.estimate import Estimate
from models.identification.force.fit import DAMPING
from models.identification.joint.steps import Identified
from models.identification.motion import MotionFit
from models.identification.recognise import recognised
from models.machine import DEFAULT, Machine, load, parameters, with_derived_presliding
from models.machine_file import to_toml
from models.records.files import Loaded
from models.records.record import Record
from models.records.tables.sizes import RecordError
from reports import text
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, main
from studies.deadbeat_design.__main__ import STUDY as DESIGN
from studies.identify_machine import own_records
from studies.identify_machine.__main__ import STUDY
from studies.identify_machine.compute import relative_to
from studies.identify_machine.round_trip import errors_of_motion, true_modes
from studies.identify_machine.shown import checks_of

MACHINES = (DEFAULT, DEFAULT.parent / "emps.toml")


def write(path: Path, record: Record) -> Path:
    """A record in the agreed CSV format."""
    names = ("target", "reference", "feedforward", "command", "position")
    time = np.arange(record.position.size) * record.sample_time
    rows = np.column_stack([time, *(getattr(record, name) for name in names)])
    head = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.17g")
    return path


@pytest.fixture(scope="module")
def table() -> Machine:
    """A table unlike the default one."""
    table = own_records.another(own_records.noisy(load()), 77)
    return replace(table, drive=replace(table.drive, offset=0.4))


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory, table: Machine) -> list[Path]:
    """Its three records."""
    folder = tmp_path_factory.mktemp("records")
    return [
        write(folder / "slow.csv", own_records.hysteresis(table, 1)),
        write(folder / "moves.csv", own_records.motions(table, 2, load())),
        write(folder / "sweep.csv", own_records.excitation(table, 3)),
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, records: list[Path]) -> Path:
    """What one run over the records wrote."""
    output = tmp_path_factory.mktemp("identified") / "out"
    assert main(STUDY, [*map(str, records), "--output", str(output)]) in {DONE, CHECK_MISSED}
    return output


def read(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_a_written_machine_is_the_machine(path: Path, tmp_path: Path) -> None:
    machine = load(path)
    (tmp_path / "copy.toml").write_text(to_toml(machine), encoding="utf-8")
    again = load(tmp_path / "copy.toml")
    assert again == machine
    assert again.sources == machine.sources


def test_each_record_is_recognised(folder: Path) -> None:
    records = {record["name"]: record["kind"] for record in read(folder, "results.json")["results"]["records"]}
    assert records == {"slow.csv": "hysteresis", "moves.csv": "motion", "sweep.csv": "excitation"}


def test_an_excitation_that_does_not_repeat_is_recognised_by_the_straight_reference() -> None:
    table, size = load(), 8000
    wave = np.concatenate([np.zeros(2000), 5 * np.random.default_rng(1).standard_normal(size)])
    reference = own_records.SPEED * table.sample_time * np.arange(wave.size, dtype=float)
    record = own_records.run(table, reference, wave, 1)
    assert recognised(table, Loaded("random", "", record, (), ())) == "excitation"
    started = replace(record, reference=np.maximum(record.reference, record.reference[record.reference.size // 20]))
    assert recognised(table, Loaded("started", "", started, (), ())) == "excitation"
    slow = own_records.hysteresis(table, 1)
    assert recognised(table, Loaded("slow", "", replace(slow, feedforward=0.1 * slow.command), (), ())) == "hysteresis"


def test_strokes_that_are_repeated_under_their_own_feedforward_are_no_excitation() -> None:
    """They had been taken for one, of which 11 lines are too few to fit modes."""
    table, time = load(), np.arange(6000) / 2e3
    reference = 0.02 * np.sin(2 * np.pi * time) ** 3
    mass = 1 / table.plant.rigid_gain
    rest = np.zeros(time.size)
    force = mass * np.gradient(np.gradient(reference, time), time) + 5 * np.sign(np.gradient(reference))
    record = Record(5e-4, rest, reference, np.append(force[2:], force[:2]), force, reference)
    assert recognised(table, Loaded("strokes", "", record, (), ())) == "dynamics"
    beside = np.tile(np.random.default_rng(1).standard_normal(500), 12)
    assert recognised(table, Loaded("beside", "", replace(record, feedforward=beside), (), ())) == "excitation"


@pytest.mark.parametrize("count", [12, 200])
def test_a_record_shorter_than_the_usual_average_is_recognised_or_refused(count: int) -> None:
    """At 20 kHz a record of 10 ms ended in an error of NumPy."""
    table, time = load(), np.arange(count) / 2e4
    position = 20e-6 * np.sin(2 * np.pi * 100 * time)
    rest = np.zeros(count)
    command = np.gradient(np.gradient(position, time), time) / table.plant.rigid_gain
    record = Loaded("short.csv", "", Record(5e-5, rest, position, rest, command, position), (), ())
    if count == 12:
        with pytest.raises(RecordError, match=r"short\.csv: 12 samples are too few to tell slow loops"):
            recognised(table, record)
    else:
        assert recognised(table, record) == "dynamics"


@pytest.mark.parametrize("rate", [2e3, 2e4])
@pytest.mark.parametrize("frequency", [5.0, 40.0, 100.0])
def test_a_fast_motion_shows_its_inertia_at_any_sample_rate(frequency: float, rate: float) -> None:
    """The command is the inertial force alone, of a sine of 20 µm beside the reading's noise."""
    table = load()
    time, size = np.arange(round(2 * rate)) / rate, 20e-6
    rng, noise = np.random.default_rng(2), max(table.scale.noise, table.scale.resolution)
    position = size * np.sin(2 * np.pi * frequency * time)
    command = -((2 * np.pi * frequency) ** 2) * position / table.plant.rigid_gain
    rest = np.zeros(time.size)
    record = Record(1 / rate, rest, position, rest, command, position + noise * rng.standard_normal(time.size))
    assert recognised(table, Loaded("fast", "", record, (), ())) == "dynamics"


def test_what_identification_looks_for_counts_the_thrust_constant() -> None:
    """The same plant with K_t = 2, halved gains and the rigid body last: a record shows only K_t times the gains."""
    table = load()
    modes = [table.plant.modes[i] for i in (*table.plant.flexible, table.plant.rigid)]
    plant = replace(table.plant, thrust_constant=2.0, modes=tuple(replace(m, gain=m.gain / 2) for m in modes))
    assert true_modes(replace(table, plant=plant)) == pytest.approx(true_modes(table))


def test_the_table_comes_back(folder: Path, table: Machine) -> None:
    found = load(folder / "identified.toml")
    truth, got = table.plant, found.plant
    assert got.dead_time == pytest.approx(truth.dead_time, abs=1e-5)
    assert [mode.frequency for mode in got.modes] == pytest.approx([mode.frequency for mode in truth.modes], rel=2e-3)
    assert [mode.gain for mode in got.modes] == pytest.approx([mode.gain for mode in truth.modes], rel=0.05)
    assert found.friction.coulomb_force == pytest.approx(table.friction.coulomb_force, rel=0.01)
    assert found.friction.limit == pytest.approx(table.friction.limit, rel=0.1)
    rows = {(row["record"], row["name"]): row for row in read(folder, "results.json")["results"]["estimates"]}
    assert rows["motion", "offset"]["number"] == pytest.approx(0.4, abs=0.1)
    assert found.drive.offset == rows["hysteresis", "offset"]["number"] == pytest.approx(0.4, abs=0.1)


def test_every_identified_value_carries_hash_and_deviation(folder: Path) -> None:
    files = read(folder, "manifest.json")["inputs"]["files"]
    hashes = {file["sha256"] for file in files if file["option"] == "record"}
    assert len(hashes) == 3
    found = [p for p in parameters(load(folder / "identified.toml")) if p.provenance.kind == "identified"]
    found = [p for p in found if p.name.startswith(("plant", "friction"))]
    assert len(found) >= 10
    for parameter in found:
        assert parameter.provenance.std is not None, parameter.name
        assert parameter.provenance.sha256 in hashes, parameter.name
        assert parameter.provenance.record in {"slow.csv", "moves.csv", "sweep.csv"}, parameter.name


def test_damping_that_the_records_do_not_show_is_assumed_and_said(folder: Path) -> None:
    damping = load(folder / "identified.toml").sources["friction.damping"]
    assert damping.kind == "assumed"
    said = [text for text in read(folder, "results.json")["results"]["said"] if "damping of the elements" in text]
    assert [text.split()[:2] for text in said] == [["slow.csv:", "The"], ["moves.csv:", "Motions"]]
    assert all("at most" in text for text in said)


def test_damping_that_a_record_shows_is_written(tmp_path: Path, table: Machine, records: list[Path]) -> None:
    stiffness = np.array(table.friction.stiffness)
    damped = replace(table, friction=elements(stiffness, table.friction.limit, 3e-3 * stiffness))
    path = write(tmp_path / "damped.csv", own_records.hysteresis(damped, 1))
    main(STUDY, [str(path), str(records[2]), "--no-report", "--output", str(tmp_path / "both")])
    found = load(tmp_path / "both" / "identified.toml")
    assert found.sources["friction.damping"].kind == "identified"
    assert found.sources["friction.damping"].std is not None
    assert found.friction.damping == pytest.approx(damped.friction.damping, rel=0.5)
    main(STUDY, [str(path), "--no-report", "--output", str(tmp_path / "alone")])
    assert load(tmp_path / "alone" / "identified.toml").sources["friction.damping"].kind == "assumed"
    assert any("was not sought" in text for text in read(tmp_path / "alone", "results.json")["results"]["said"])


def test_the_identified_machine_goes_into_the_next_study(folder: Path, tmp_path: Path) -> None:
    arguments = ["--quick", "--no-report", "--machine", str(folder / "identified.toml"), "--output", str(tmp_path)]
    assert main(DESIGN, arguments) in {DONE, CHECK_MISSED}
    assert read(tmp_path, "results.json")["checks"][0]["holds"] is True


def test_the_example_of_the_readme_runs(tmp_path: Path, records: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """On a nominal file and records of the names there."""
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    identify, design = re.findall(
        r"-m studies\.(identify_machine .+|deadbeat_design --machine reports/out/identify_machine.+)", readme
    )
    monkeypatch.chdir(records[0].parent)
    (records[0].parent / "my_axis.toml").write_text(DEFAULT.read_text(encoding="utf-8"), encoding="utf-8")
    arguments = shlex.split(identify)[1:]
    assert main(STUDY, [*arguments, "--no-report", "--output", str(tmp_path)]) == DONE
    assert Path(shlex.split(design)[-1]).name == "identified.toml"
    assert (tmp_path / "identified.toml").is_file()


def test_with_friction_that_grows_with_speed_it_goes_into_others_too(tmp_path: Path, table: Machine) -> None:
    """Into those that optimise, too: tests/studies/test_improved_machine.py."""
    effects = catalogue.in_order([ViscousFriction(60.0), DirectionalFriction(0.05, 2e-6, 0)])
    path = tmp_path / "machine.toml"
    path.write_text(to_toml(with_derived_presliding(replace(table, published=None, effects=effects))), encoding="utf-8")
    assert load(path).effects == effects
    arguments = ["--quick", "--no-report", "--machine", str(path), "--output", str(tmp_path / "out")]
    assert main(DESIGN, arguments) in {DONE, CHECK_MISSED}


def test_viscous_friction_and_its_direction_are_written(tmp_path: Path, table: Machine) -> None:
    """From strokes of 20 mm at up to 0.1 m/s, whose friction is a tenth larger forwards; and an offset beside it."""
    effects = catalogue.in_order([ViscousFriction(80.0), DirectionalFriction(0.1, 2e-6, 0)])
    t = np.arange(round(10 / table.sample_time)) * table.sample_time
    path = 0.01 * np.sin(2 * np.pi * t * (0.5 + 0.05 * t))
    record = own_records.run(replace(table, effects=effects), path, np.zeros(t.size), 4)
    file = write(tmp_path / "fast.csv", record)
    main(STUDY, [str(file), "--kinds", "dynamics", "--no-report", "--output", str(tmp_path / "out")])
    found = load(tmp_path / "out" / "identified.toml")
    got = {effect.name: effect.values()[0] for effect in found.effects}
    assert got["viscous_friction"] == pytest.approx(80, rel=0.05)
    assert got["directional_friction"] == pytest.approx(0.1, rel=0.1)
    assert found.drive.offset == pytest.approx(table.drive.offset, abs=0.1)
    for name in ("effects.viscous_friction.coefficient", "effects.directional_friction.asymmetry", "drive.offset"):
        assert found.sources[name].std is not None


def test_the_report_is_written(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "identified.toml" in page
    assert "<math" in page
    assert {file.stem for file in (folder / "figures").iterdir()} == {"bode", "stabilisation", "hysteresis", "motion"}


@pytest.mark.parametrize(
    ("turned", "says", "not_said"), [(0.0061, "0.61 % of the samples", "throughout"), (0.0, "throughout", "backwards")]
)
def test_an_axis_that_moved_backwards_did_not_roll_throughout(
    turned: float, says: str, not_said: str, folder: Path
) -> None:
    whole = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    whole["results"]["response"] |= {"rolling": True, "turned": turned, "bent": turned > 0}
    report = STUDY.report(whole)
    captions = {figure.name: figure.caption for figure in report.figures}
    page = text.fill(report.template, whole, captions, report.filters)
    (told,) = (paragraph for paragraph in page.split("\n\n") if "The axis rolled in one direction" in paragraph)
    assert says in told
    assert not_said not in told


def test_what_is_relative_says_to_what_and_modes_are_those_of_the_machine_file(folder: Path) -> None:
    assert relative_to("presliding length", "1").startswith(" times")
    assert relative_to("mass", "kg") == relative_to("dead time", "s") == relative_to("mode 2 damping", "1") == ""
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]
    written = load(folder / "identified.toml").plant.modes
    found = {row["name"]: row["number"] for row in results["estimates"]}
    shown = [found[f"mode {i} frequency"] for i in range(2, len(written) + 1)]
    assert shown == pytest.approx([mode.frequency for mode in written[1:]])
    assert "mode 1 frequency" not in found


def test_a_measured_frequency_response_alone(tmp_path: Path, table: Machine) -> None:
    f = np.geomspace(5, 400, 120)
    p = modes.model(table.plant, f, 0.0)
    noise = 1 + 0.003 * np.random.default_rng(0).standard_normal(f.size)
    rows = np.column_stack([f, 20 * np.log10(np.abs(p) * noise), np.rad2deg(np.angle(p))])
    np.savetxt(tmp_path / "frf.csv", rows, delimiter=",", header="f,mag,phase", comments="")
    columns = ["--column", "frequency=f [Hz]", "--column", "magnitude=mag [dB]", "--column", "phase=phase [deg]"]
    out = tmp_path / "out"
    assert main(STUDY, [str(tmp_path / "frf.csv"), *columns, "--no-report", "--output", str(out)]) == DONE
    got = load(out / "identified.toml").plant
    assert [mode.frequency for mode in got.modes] == pytest.approx(
        [mode.frequency for mode in table.plant.modes], rel=5e-3
    )


def test_a_motion_record_alone_changes_the_nominal_machine(tmp_path: Path) -> None:
    nominal = load()
    heavier, _ = own_records.drawn_from(own_records.noisy(nominal), 5)
    path = write(tmp_path / "moves.csv", own_records.motions(heavier, 5, nominal))
    assert main(STUDY, [str(path), "--no-report", "--output", str(tmp_path / "out")]) == DONE
    found = load(tmp_path / "out" / "identified.toml")
    assert found.plant.modes[0].gain == pytest.approx(heavier.plant.modes[0].gain, rel=0.01)
    assert found.friction.coulomb_force == pytest.approx(heavier.friction.coulomb_force, rel=0.02)
    assert found.drive.offset == pytest.approx(heavier.drive.offset, abs=0.1)
    assert found.sources["drive.offset"].std is not None


def test_a_record_that_swings_at_rest_is_told_whether_it_can_be_used_or_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A user's limit cycle left its record out as one whose fit had not settled, with the advice to check signs."""
    nominal = load()
    record = own_records.motions(nominal, 5, nominal)
    swing = 3e-6 * np.sin(2 * np.pi * 180 * nominal.sample_time * np.arange(record.position.size))
    path = write(tmp_path / "moves.csv", replace(record, position=record.position + swing))
    main(STUDY, [str(path), "--no-report", "--output", str(tmp_path / "out")])
    said = capsys.readouterr()
    assert "the axis swings at 180 Hz while its reference stands still, by 3 µm" in said.out + said.err


def test_without_records_it_judges_itself(quick_run: Callable[[str], tuple[Path, int]]) -> None:
    trip = read(quick_run("identify_machine")[0], "results.json")["results"]["round_trip"]
    assert trip["tables"] == 3
    assert trip["intervals"] >= 3 * 15


def test_the_same_records_give_the_same_bytes(records: list[Path], tmp_path: Path) -> None:
    for name in ("a", "b"):
        main(STUDY, [str(records[1]), "--no-report", "--output", str(tmp_path / name)])
    for name in ("results.json", "identified.toml", "manifest.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_a_record_of_the_wrong_kind_is_said(
    records: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = load()
    flat = replace(own_records.motions(slow, 1), feedforward=np.zeros(own_records.motions(slow, 1).command.size))
    path = write(tmp_path / "flat.csv", flat)
    assert main(STUDY, [str(path), "--kinds", "excitation", "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert "has no excitation" in capsys.readouterr().err
    assert len(records) == 3


def test_one_sweep_alone_gives_the_plant_or_says_that_it_is_too_weak(
    table: Machine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ts = table.sample_time
    wave = chirp(np.arange(round(12 / ts)) * ts, 4, 12, 400, method="logarithmic", phi=-90)
    rolled = own_records.SPEED * ts * np.arange(round(13 / ts), dtype=float)
    for name, force, status in (("strong", 12.0, DONE), ("weak", 0.02, BAD_INPUT)):
        record = own_records.run(table, rolled, np.concatenate([np.zeros(round(1 / ts)), force * wave]), 3)
        path = write(tmp_path / f"{name}.csv", record)
        assert main(STUDY, [str(path), "--no-report", "--output", str(tmp_path / name)]) == status
    assert "the sweep is too weak" in capsys.readouterr().err
    got = load(tmp_path / "strong" / "identified.toml").plant
    assert [mode.frequency for mode in got.modes] == pytest.approx([m.frequency for m in table.plant.modes], rel=1e-3)
    assert len(read(tmp_path / "strong", "results.json")["results"]["response"]["frequency_Hz"]) < 1500


def test_a_damping_that_a_table_has_not_is_an_error_of_the_round_trip() -> None:
    truth, names = np.array([1.0, 1.0, 1.0, 0.0, 2.0]), ("mass", "level", "length", "dead_time", DAMPING, "offset")
    estimate = Estimate(names, ("1", "1", "1", "s", "s", "N"), np.array([1.0, 1.0, 1.0, 0.0, 3e-4, 2.5]), np.eye(6))
    nothing = np.zeros(0)
    found = MotionFit(estimate, load(), nothing, nothing, nothing, (3e-4, 1.0), (0, 0.0))
    assert errors_of_motion(found, truth) == pytest.approx([0, 0, 0, 0, 3e-4, 0.5])


def test_each_of_several_fast_records_is_judged_by_its_second_half() -> None:
    def ladder(*held_out: float) -> list[dict[str, float]]:
        return [{"held_out": error} for error in held_out]

    ladders = [{"record": "a", "ladder": ladder(4, 3, 2, 1, 1)}, {"record": "b", "ladder": ladder(4, 2, 2, 3, 1)}]
    checks = [*checks_of(Identified(load()), {"dynamics": {"ladders": ladders}})]
    assert [check.name.rpartition(": ")[2] for check in checks] == ["a", "a", "b", "b"]
    assert [check.value for check in checks] == pytest.approx([1 / 3, 1.0, 1.5, 1 / 3])
    alone = [*checks_of(Identified(load()), {"dynamics": {"ladders": ladders[:1]}})]
    assert [":" in check.name for check in alone] == [False, False]
