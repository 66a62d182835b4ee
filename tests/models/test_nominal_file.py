"""The nominal machine of a pack: what the file says, what it leaves out, and a sentence for every mistake."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from models import machine
from models import nominal_file as nominal
from models.feedback.forms import Cascade
from models.machine import MachineError, Tolerance
from models.machine_file import to_toml

CONTENT: dict[str, Any] = {
    "sample_time_s": 2.5e-4,
    "dead_time_s": 8e-4,
    "thrust_constant": 0.97,
    "modes": [
        {"gain_per_kg": 0.03, "frequency_Hz": 0.0, "damping": 0.0},
        {"gain_per_kg": 0.001, "frequency_Hz": 44.0, "damping": 0.01},
    ],
    "friction": {"stiffness_N_per_m": [4e5, 1e5], "limit_m": [1e-5, 5e-5]},
    "scale": {"resolution_m": 5e-8},
    "controller": {
        "kp_N_per_m": 1e6,
        "ki_N_per_ms": 2e7,
        "kd_Ns_per_m": 4e3,
        "derivative_filter_s": 3e-4,
        "reference_delay_samples": 3,
    },
}


def written(folder: Path, change: Callable[[dict[str, Any]], object] = lambda _: None) -> Path:
    content = json.loads(json.dumps(CONTENT))
    change(content)
    path = folder / "nominal.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_how_well_its_values_are_known_may_stand_in_it(tmp_path: Path) -> None:
    found = nominal.load(written(tmp_path, lambda content: content.update(tolerance={"offset_N": 2.0, "mass": 0.1})))
    assert found.tolerance == Tolerance(offset=2.0, mass=0.1)
    assert found.sources["tolerance.offset"].kind == "datasheet"
    assert nominal.load(written(tmp_path)).tolerance == Tolerance()


def test_the_sizes_that_effects_may_have_may_stand_in_it(tmp_path: Path) -> None:
    stated = {"cogging": {"pitch_m": [1e-3, 1e-2]}}
    found = nominal.load(written(tmp_path, lambda content: content.update(priors=stated)))
    assert machine.to_json(found)["priors"] == stated
    assert found.sources["priors.cogging.pitch"].kind == "datasheet"


def test_each_study_chooses_the_number_of_compensator_elements_that_it_leaves_out(tmp_path: Path) -> None:
    found = nominal.load(written(tmp_path))
    assert found.control.compensator_elements == "auto"
    source = found.sources["control.compensator_elements"]
    assert (source.kind, source.detail) == (
        "assumed",
        "not in nominal.json, so each study that compensates friction chooses it",
    )


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ({"coging": {"pitch_m": [1e-3, 1e-2]}}, "priors.coging: unknown; did you mean 'cogging'?"),
        ({"cogging": {}}, "priors.cogging: must hold a range"),
        ({"cogging": {"pitch_m": [1e-2, 1e-3]}}, "priors.cogging: pitch: must be a range"),
        ({"cogging": [1e-2, 1e-3]}, "priors.cogging: must be an object with names"),
        ({"cogging": {"pitch": [1e-3, 1e-2]}}, "priors.cogging.pitch: unknown; known here: amplitude_N, pitch_m"),
    ],
)
def test_sizes_that_are_none_are_refused(stated: dict[str, Any], says: str, tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=re.escape(says)):
        nominal.load(written(tmp_path, lambda content: content.update(priors=stated)))


def test_what_the_file_says_and_what_it_leaves_out(tmp_path: Path) -> None:
    found, default = nominal.load(written(tmp_path)), machine.load()
    assert found.sample_time == 2.5e-4
    assert (found.plant.dead_time, found.plant.thrust_constant) == (8e-4, 0.97)
    assert [(m.gain, m.frequency, m.damping) for m in found.plant.modes] == [(0.03, 0, 0), (0.001, 44, 0.01)]
    assert (found.friction.stiffness, found.friction.limit) == ((4e5, 1e5), (1e-5, 5e-5))
    assert list(found.friction.damping) == [0, 0]
    assert (found.scale.resolution, found.scale.noise) == (5e-8, 0)
    pid = found.control.pid
    assert (pid.kp, pid.ki, pid.kd, pid.derivative_filter) == (1e6, 2e7, 4e3, 3e-4)
    assert found.control.reference_delay == 3
    assert found.drive == replace(default.drive, rated_power=0.0, current_loop_bandwidth=0.0)  # optional ones
    assert found.specification == default.specification
    assert found.presliding.coulomb_force == pytest.approx(9.0)
    kinds = {name: provenance.kind for name, provenance in found.sources.items()}
    assert kinds["plant.dead_time"] == kinds["friction.stiffness"] == kinds["control.pid.kp"] == "datasheet"
    assert kinds["drive.rated_thrust"] == kinds["scale.noise"] == kinds["friction.damping"] == "assumed"
    assert "nominal.json" in found.sources["drive.rated_thrust"].detail


def test_what_the_file_adds_is_taken(tmp_path: Path) -> None:
    def add(content: dict[str, Any]) -> None:
        content["drive"] = {"rated_thrust_N": 99.0}
        content["friction"]["damping_Ns_per_m"] = [1.0, 2.0]
        content["scale"]["noise_m"] = 1e-8
        content["name"] = "a pack"

    found = nominal.load(written(tmp_path, add))
    assert (found.drive.rated_thrust, found.friction.damping, found.scale.noise) == (99.0, (1.0, 2.0), 1e-8)
    assert found.name == "a pack"


def test_a_nominal_machine_round_trips_through_a_machine_file(tmp_path: Path) -> None:
    found = nominal.load(written(tmp_path))
    path = tmp_path / "machine.toml"
    path.write_text(to_toml(found), encoding="utf-8")
    assert machine.load(path) == found


MISTAKES: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda c: c.pop("dead_time_s"), "dead_time_s: missing; add it"),
    (lambda c: c.pop("friction"), "friction: missing; add it"),
    (lambda c: c["friction"].pop("limit_m"), "friction.limit_m: missing; add it"),
    (lambda c: c["friction"]["limit_m"].pop(), "a friction needs as many stiffnesses as limits"),
    (lambda c: c["friction"].update(limit_m=3), "friction.limit_m: must be a list"),
    (lambda c: c["modes"][1].pop("damping"), "modes.2.damping: missing; add it, damping ratio zeta"),
    (lambda c: c["modes"].pop(0), "0 rigid-body modes"),
    (lambda c: c.update(modes=[]), "modes: must be a list with at least one entry"),
    (lambda c: c["controller"].update(kp_N_per_m="stiff"), "controller.kp_N_per_m: 'stiff' must be a number"),
    (lambda c: c["controller"].update(reference_delay_samples=1.5), "1.5 must be a whole number"),
    (lambda c: c["scale"].pop("resolution_m"), "scale.resolution_m: missing; add it, resolution"),
    (lambda c: c.update(scale=4), "scale: must be an object"),
    (lambda c: c.update(sample_time_s=0), "must be above 0"),
    (lambda c: c.update(thrust_constant=float("nan")), "is not a finite number"),
]


@pytest.mark.parametrize(("change", "sentence"), MISTAKES, ids=[sentence for _, sentence in MISTAKES])
def test_every_mistake_gets_its_sentence(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], sentence: str
) -> None:
    with pytest.raises(MachineError) as caught:
        nominal.load(written(tmp_path, change))
    assert sentence in str(caught.value)
    assert "nominal.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_file_and_no_json(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="can't be read"):
        nominal.load(tmp_path / "nominal.json")
    (tmp_path / "nominal.json").write_text("[1", encoding="utf-8")
    with pytest.raises(MachineError, match="is not valid JSON"):
        nominal.load(tmp_path / "nominal.json")
    (tmp_path / "nominal.json").write_text("[1]", encoding="utf-8")
    with pytest.raises(MachineError, match="the content: must be an object"):
        nominal.load(tmp_path / "nominal.json")


def test_a_cascade_may_stand_in_place_of_the_pid(tmp_path: Path) -> None:
    cascade = {
        "position_gain_per_s": 85.0,
        "velocity_gain_Ns_per_m": 4000.0,
        "integral_time_s": 0.012,
        "velocity_feedforward": 1.0,
    }
    control = {"reference_delay_samples": 1, "cascade": cascade}
    found = nominal.load(written(tmp_path, lambda content: content.update(controller=control))).control
    assert found.cascade == Cascade(85.0, 4000.0, 0.012, velocity_feedforward=1.0)
    assert found.reference_delay == 1
    control["cascade"] = {"position_gain_per_s": 85.0}
    with pytest.raises(MachineError, match=r"controller\.cascade\.velocity_gain_Ns_per_m: missing"):
        nominal.load(written(tmp_path, lambda content: content.update(controller=control)))


def test_set_point_weights_and_a_specification_may_stand_in_it(tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        content["controller"]["derivative_weight"] = 0.0
        content["specification"] = {"motions": 3, "stroke_m": 1e-4}

    found = nominal.load(written(tmp_path, change))
    assert found.control.pid.derivative_weight == 0.0
    assert (found.specification.motions, found.specification.stroke) == (3, 1e-4)
