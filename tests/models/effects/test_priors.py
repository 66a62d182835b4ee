"""The sizes that a machine file states of effects, in place of their usual ones."""

from __future__ import annotations

import math
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.model.fit import OF_PERIOD, bounds_of, fine_step, parameters_at_bounds
from models.effects.base import Effect, parameters
from models.effects.catalogue import SIZES, every, looked_for, range_declarations
from models.effects.friction_laws import DirectionalFriction, Stribeck, VelocityStrengthening
from models.effects.motor import AmplifierDeadband, Cogging, DacQuantisation
from models.effects.parameter import POSITIVE
from models.effects.priors import USUAL, Priors
from models.effects.scale import ScalePeriodicError
from models.effects.structure import AdditionalMode, CableSpring
from models.machine import MachineError, load, to_json
from models.machine import parameters as values
from models.machine_file import to_toml
from models.records.record import Record
from tests.models.effects.test_catalogue import machine_file

SCREW = """
[priors.cogging]
pitch = { value = ["1 mm", "10 mm"], source = "datasheet: a lead of 10 mm" }

[priors.velocity_strengthening]
rise = [0.01, 0.4]

[priors.directional_friction]
asymmetry = ["0.05", "0.4"]

[effects.cogging]
amplitude = "1 N"
pitch = "5 mm"
phase = 0.5
"""


def ranges(kind: type[Effect], priors: Priors = USUAL) -> dict[str, tuple[float, float]]:
    return {item.name: (item.low, item.high) for item in parameters(kind, priors)}


def test_they_stand_in_the_place_of_the_usual_ones(tmp_path: Path) -> None:
    priors = load(machine_file(tmp_path, SCREW)).priors
    assert ranges(Cogging, priors) == ranges(Cogging) | {"pitch": (1e-3, 1e-2)}
    assert Cogging.typical(priors).values()[1] == pytest.approx(10**-2.5)
    assert ranges(DirectionalFriction, priors)["asymmetry"] == (-0.4, 0.4)  # of either sign, as ever
    assert parameters(Stribeck, priors) is parameters(Stribeck)
    assert [item.stated for item in parameters(Cogging, priors)] == [False, True, False]


def test_they_are_a_frozen_mapping(tmp_path: Path) -> None:
    priors = load(machine_file(tmp_path, SCREW)).priors
    assert priors["cogging", "pitch"] == (1e-3, 1e-2)
    assert ("cogging", "amplitude") not in priors
    assert list(priors) == [
        ("velocity_strengthening", "rise"),
        ("directional_friction", "asymmetry"),
        ("cogging", "pitch"),
    ]
    assert len(priors) == 3
    assert priors == Priors.of(dict(priors))
    assert hash(priors) == hash(Priors.of(dict(priors)))
    with pytest.raises(ValueError, match="cogging: pitch: must be a range"):
        Priors.of({("cogging", "pitch"): (2.0, 1.0)})


def test_they_ask_for_an_effect_that_is_not_common(tmp_path: Path) -> None:
    assert "velocity_strengthening" not in load().kinds
    machine = load(machine_file(tmp_path, SCREW))
    rare = {"gravity", "thrust_fall_off", "hardening_spring", "load_side_friction"}
    assert list(machine.kinds) == [name for name in every() if name not in rare]
    assert ranges(VelocityStrengthening, machine.priors)["rise"] == (0.01, 0.4)


def step(effect: Effect, records: list[Record], priors: Priors = USUAL) -> float:
    """What the fit takes for the linear range of the effect's period or width [1]."""
    items = [item for item in parameters(type(effect), priors) if item.role in POSITIVE]
    return fine_step(items[-1], effect, records)


def test_a_stated_period_is_told_by_the_travel(tmp_path: Path) -> None:
    """The last of 50 periods is moved by a part of one."""
    machine = load(machine_file(tmp_path, SCREW))
    (own,) = machine.effects
    still = np.zeros(100)
    moved = Record(1e-3, still, still, still, still, np.linspace(0.0, 0.25, 100))
    assert step(own, [moved], machine.priors) == pytest.approx(OF_PERIOD * 5e-3 / 0.25)
    assert step(Cogging(1.0, 0.03, 0.0), [moved]) == 0  # usual
    for short in (1e-5, 0.0):  # through less than one period the usual step will do
        assert step(own, [replace(moved, position=np.linspace(0.0, short, 100))], machine.priors) == OF_PERIOD
    assert step(VelocityStrengthening(0.1, 1e-3), [moved], machine.priors) == 0
    assert step(ScalePeriodicError(1e-8, 2e-5, 0.0), [moved]) == 1e-5
    assert step(DacQuantisation(0.01, 0), [moved]) == 1e-5
    for beyond in (ScalePeriodicError(1e-8, 1e-3, 0.0), Cogging(1.0, 1e-3, 0.0)):  # their usual ranges
        assert step(beyond, [moved]) == pytest.approx(OF_PERIOD * 1e-3 / 0.25)


def test_a_stated_period_at_its_bound_is_bent(tmp_path: Path) -> None:
    priors = load(machine_file(tmp_path, SCREW)).priors
    assert [item.name for item in parameters_at_bounds(Cogging(1.0, 1.5e-2, 0.0), priors)] == ["pitch"]
    assert not parameters_at_bounds(Cogging(1.0, 5e-3, 0.0), priors)


def test_another_process_can_have_the_machine(tmp_path: Path) -> None:
    machine, packed = load(machine_file(tmp_path, SCREW)), tmp_path / "machine.pickle"
    packed.write_bytes(pickle.dumps(machine))
    assert pickle.loads(packed.read_bytes()) == machine
    there = f"import pickle; print(pickle.load(open({str(packed)!r}, 'rb')).priors['cogging', 'pitch'])"
    asked = subprocess.run([sys.executable, "-c", there], capture_output=True, text=True, check=True)
    assert asked.stdout.strip() == "(0.001, 0.01)"


def test_a_file_keeps_them_with_their_sources(tmp_path: Path) -> None:
    machine = load(machine_file(tmp_path, SCREW))
    again = tmp_path / "again.toml"
    again.write_text(to_toml(machine), encoding="utf-8")
    assert load(again) == machine
    assert load(again).sources == machine.sources
    assert to_json(machine)["priors"] == {
        "velocity_strengthening": {"rise": [0.01, 0.4]},
        "directional_friction": {"asymmetry": [0.05, 0.4]},
        "cogging": {"pitch_m": [1e-3, 1e-2]},
    }
    assert "priors" not in to_json(load())
    rows = {row.name: row for row in values(machine) if row.name.startswith("priors.")}
    assert rows["priors.cogging.pitch"].number == (1e-3, 1e-2)
    assert rows["priors.cogging.pitch"].provenance.detail == "a lead of 10 mm"
    assert rows["priors.velocity_strengthening.rise"].provenance.kind == "assumed"
    assert len(rows) == 3


@pytest.mark.parametrize("name", every())
def test_every_effect_can_have_its_usual_sizes_stated(name: str) -> None:
    """Which leave the ranges as they are; no phase and no switch has a size."""
    kind = every()[name]
    usual = {item.name: (item.typical**2 / item.high, item.high) for item in parameters(kind) if item.role in SIZES}
    assert set(range_declarations(kind)) == set(usual)
    priors = Priors.of({(name, item): ends for item, ends in usual.items()})
    for ours, theirs in zip(parameters(kind, priors), parameters(kind), strict=True):
        assert ours.stated == (ours.name in usual)
        theirs_alone = replace(theirs, low=0, high=0, typical=0, sought=())
        assert replace(ours, low=0, high=0, typical=0, stated=False, sought=()) == theirs_alone
        assert [ours.low, ours.high, ours.typical] == pytest.approx([theirs.low, theirs.high, theirs.typical])
    assert kind.typical().strength() == pytest.approx(kind.typical(priors).strength())


def test_without_any_the_common_effects_are_looked_for() -> None:
    table = load()
    assert list(table.kinds.items()) == list(looked_for(plant=table.plant).items())
    assert set(looked_for()) - set(table.kinds) == {"load_side_friction"}  # its scale is on the load
    assert all("linear" in kind.common_on for kind in looked_for().values())


def test_what_turns_may_be_out_of_balance() -> None:
    assert set(looked_for(axis="rotary")) - set(looked_for()) == {"gravity"}


def test_a_stated_spring_may_harden() -> None:
    """And holds a voice coil, whose thrust falls off; a spring that is only looked for asks for neither."""
    held = replace(load(), effects=(CableSpring(1e4),))
    assert set(held.kinds) - set(load().kinds) == {"thrust_fall_off", "hardening_spring"}
    assert list(held.kinds) == [name for name in every() if name in held.kinds]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[priors.coging]\npitch = ["1 mm", "10 mm"]', "priors.coging: unknown; did you mean 'cogging'?"),
        ('[priors.cogging]\npich = ["1 mm", "10 mm"]', "priors.cogging.pich: unknown; did you mean 'pitch'?"),
        ('[priors.cogging]\nphase = ["0.1", "3"]', "priors.cogging.phase: unknown"),
        ('[priors.cogging]\npitch = ["10 mm", "1 mm"]', "priors.cogging: pitch: must be a range; give"),
        ('[priors.cogging]\npitch = ["0 mm", "1 mm"]', "priors.cogging: pitch: must be a range; give"),
        ('[priors.cogging]\npitch = ["1 mm", "2 mm", "3 mm"]', "priors.cogging: pitch: must be a range; give"),
        ('[priors.cogging]\npitch = "1 mm"', "priors.cogging.pitch: '1 mm' must be a list"),
        (
            '[priors.cogging]\npitch = ["1 N", "2 N"]',
            "priors.cogging.pitch: '1 N' is in N, but this is a quantity in m",
        ),
        ("[priors.directional_friction]\nasymmetry = [0.1, 1.5]", "asymmetry: 1.5 must be below 1"),
        (
            "[priors.cogging]",
            "priors.cogging: must hold a range; give the minimum and maximum of amplitude, say",
        ),
        ("[priors]\ncogging = 3", "priors.cogging: must be a table; write [priors.cogging] with its values below"),
        ("priors = 3", "priors: must be a table; write [priors.NAME]"),
        (
            '[[priors.cogging]]\npitch = ["1 mm", "2 mm"]\n[[priors.cogging]]\npitch = ["1 mm", "2 mm"]',
            "priors.cogging: is given twice; state an effect's ranges once, in [priors.cogging]",
        ),
    ],
)
def test_every_mistake_gets_its_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = machine_file(tmp_path, "")
    plain = path.read_text(encoding="utf-8")
    path.write_text(f"{text}\n{plain}" if text.startswith("priors") else f"{plain}\n{text}\n", encoding="utf-8")
    with pytest.raises(MachineError, match=re.escape(sentence)):
        load(path)


@pytest.mark.parametrize("ends", [(300.0, 400.0), (300.0, 950.0), (900.0, 4000.0), (2000.0, 4000.0)])
def test_a_mode_that_is_stated_stays_below_what_the_controller_samples(ends: tuple[float, float]) -> None:
    """A fit may go half beyond the range, but to no frequency that a machine file refuses."""
    machine = load()
    nyquist = 0.5 / machine.sample_time
    priors = Priors.of({("additional_mode", "frequency"): ends}, machine.priors.units)
    (item,) = (one for one in parameters(AdditionalMode, priors) if one.name == "frequency")
    low, high = bounds_of(item)
    assert 0 < low < high < nyquist
    assert high == pytest.approx(min(1.5 * ends[1], 0.99 * nyquist))
    assert item.low == (ends[0] if ends[0] < nyquist else pytest.approx(0.66 * nyquist))


@pytest.mark.parametrize("loop", [1e-3, 4.3e-3, 2e-2])
def test_a_mode_is_looked_for_from_well_below_the_crossover_on(loop: float) -> None:
    """The bed of a machine tool rocks at 18 Hz, where its loop crosses over at 37 Hz."""
    usual = load().priors
    priors = Priors.of({}, replace(usual.units, loop=loop))
    (item,) = (one for one in parameters(AdditionalMode, priors) if one.name == "frequency")
    least, most = item.widest
    assert least <= 0.25 / (2 * math.pi * loop) * (1 + 1e-12)
    assert most >= 0.39 / usual.units.sample


@pytest.mark.parametrize("factor", [0.1, 24.0])
def test_a_deadband_may_be_as_wide_as_the_scale_shows(factor: float) -> None:
    """Beside a scale whose noise makes 13 % of the friction, one of 21 % of it was refused at the end of its range."""
    usual = load().priors
    (plain,) = parameters(AmplifierDeadband, usual)
    (item,) = parameters(AmplifierDeadband, Priors.of({}, replace(usual.units, reading=factor * usual.units.reading)))
    assert (item.low, item.high) == pytest.approx((plain.low * min(1.0, factor), plain.high * max(1.0, factor)))
