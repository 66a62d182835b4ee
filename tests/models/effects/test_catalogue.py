"""The catalogue: the agreed names, priors that make sense, one's own effect from one file, and machine files."""

from __future__ import annotations

import math
import re
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

import models.effects
from models.effects.base import FAMILIES, VISIBLE_SIGNALS, Place, parameters
from models.effects.catalogue import beyond, every, in_order, looked_for, named
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging
from models.effects.parameter import COORDINATES, ROLES, parameter, period
from models.machine import DEFAULT, MachineError, load, to_json
from models.machine import parameters as values
from models.machine_file import to_toml
from models.simulation.hooks import pack
from models.simulation.simulator import simulate
from tests.models.effects.paths import make
from tests.models.simulation.test_simulator import TARGET, controlled

AGREED = {
    "friction": "friction_relaxation dwell_breakaway viscous_friction stribeck directional_friction "
    "position_dependent_friction frictional_lag friction_drift play noncollocated_friction",
    "motor": "cogging thrust_ripple gain_asymmetry thrust_saturation current_loop_lag timing_jitter "
    "amplifier_deadband dac_quantisation",
    "structure": "additional_mode friction_driven_mode load_side_friction floor_vibration cable_spring",
    "scale": "scale_drift scale_periodic_error scale_gain_error",
    "protocol": "controller_mismatch",
}

# Looked for only where a machine file states their sizes, or a spring beside which there may be the last two.
ASKED = ("velocity_strengthening", "gravity", "thrust_fall_off", "hardening_spring")

GUIDE = (Path(__file__).parents[3] / "reports" / "guide" / "diagnosis.md").read_text(encoding="utf-8")
OWN = textwrap.dedent(GUIDE[GUIDE.index('    """Friction that grows') :].partition("\n\nThe simulator")[0]) + "\n"


def machine_file(folder: Path, effects: str) -> Path:
    path = folder / "machine.toml"
    path.write_text(DEFAULT.read_text(encoding="utf-8") + effects, encoding="utf-8")
    return path


def test_the_agreed_names_in_their_order() -> None:
    kinds = looked_for()
    assert list(kinds) == " ".join(AGREED.values()).split()
    assert all(kinds[name].family == family for family, names in AGREED.items() for name in names.split())
    assert tuple(AGREED) == FAMILIES
    assert set(every()) - set(kinds) == set(ASKED)


@pytest.mark.parametrize("name", [*" ".join(AGREED.values()).split(), *ASKED])
def test_an_effect_says_all_that_is_asked_of_it(name: str) -> None:
    kind = every()[name]
    assert kind.equation
    assert kind.__doc__
    assert re.search(r"\b(19|20)\d\d\b|assumed: ", kind.source)
    assert set(kind.hooks) <= set(Place)
    assert kind.hooks or kind.typical().modes()
    assert {item.role for item in parameters(kind)} & {"amplitude", "width"}
    for item in parameters(kind):
        assert item.role in ROLES
        assert item.low < item.typical < item.high or item.role == "switch"
        assert (item.role == "period") <= (item.periodic_in in COORDINATES)
        assert item.low > 0 or item.role in {"phase", "switch"} or item.low == -item.high
    further = [item for item in parameters(kind) if item.role == "amplitude"][1:]
    assert kind.typical().values().tolist() == [0.0 if one in further else one.typical for one in parameters(kind)]
    assert kind.coordinate
    assert kind.parity


def test_where_a_record_shows_an_effect() -> None:
    shown = {name: kind.shown_in() for name, kind in every().items()}
    assert {name for name, where in shown.items() if where == "reading"} == {"scale_drift", "scale_periodic_error"}
    assert {name for name, where in shown.items() if where == "log"} == {"timing_jitter", "controller_mismatch"}
    assert {name for name, where in shown.items() if where == "nothing"} == {"scale_gain_error"}
    assert set(shown.values()) == {*VISIBLE_SIGNALS, "log", "nothing"}


def test_a_role_that_is_none_and_a_field_that_is_no_parameter() -> None:
    with pytest.raises(
        ValueError, match="role 'size' is unknown; give one of amplitude, shape, period, phase, width, switch"
    ):
        parameter("N", "a size", 1.0, 2.0, "size")
    with pytest.raises(ValueError, match=r"role 'period': declare it with models\.effects\.base\.period"):
        parameter("m", "a lead", 1e-3, 1e-2, "period")
    with pytest.raises(ValueError, match="periodic_in='speed' is unknown; give one of position, reading, command, ti"):
        period("m/s", "a speed", 1e-3, 1e-2, "speed")
    with pytest.raises(ValueError, match="a period in position has the unit m or 1/m, not mm"):
        period("mm", "a lead", 1.0, 10.0, "position")
    assert parameters(every()["cogging"])[0].typical == pytest.approx(math.sqrt(0.5 * 5))


def test_ones_own_effect_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder added to the package's search path for the test: with machine file, loop and all."""
    (tmp_path / "bowed.py").write_text(OWN, encoding="utf-8")
    monkeypatch.setattr(models.effects, "__path__", [*models.effects.__path__, str(tmp_path)])
    try:
        assert every()["bowed_guide"].typical().values() == pytest.approx([math.sqrt(0.025), 1e-3])
        path = machine_file(tmp_path, '[effects.bowed_guide]\npart = "0.3"\nlength = "20 um"\n')
        machine = load(path)
        controller = controlled(machine)
        bowed = simulate(machine, controller, TARGET)
        nominal = simulate(replace(machine, effects=()), controller, TARGET)
        assert np.max(np.abs(bowed.record.command - nominal.record.command)) > 0.1
    finally:
        sys.modules.pop("models.effects.bowed", None)
        monkeypatch.undo()
    assert "bowed_guide" not in every()


def test_two_effects_of_one_name_in_a_package_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "twice.py").write_text(OWN.replace("bowed_guide", "cogging"), encoding="utf-8")
    monkeypatch.setattr(models.effects, "__path__", [*models.effects.__path__, str(tmp_path)])
    try:
        with pytest.raises(ValueError, match=r"the effect 'cogging' is in models\.effects\.twice already"):
            every()
    finally:
        sys.modules.pop("models.effects.twice", None)


def test_what_is_beyond_a_machines_own_effects() -> None:
    first, second, third = (Cogging(1.0, pitch, 0.0) for pitch in (0.02, 0.03, 0.04))
    assert beyond([first], [first, ViscousFriction(1.0), second]) == [ViscousFriction(1.0), second]
    assert beyond([first, third], [second, third]) == []
    assert beyond([first], [ViscousFriction(1.0)]) == [ViscousFriction(1.0)]


def test_a_machine_file_keeps_every_effect(tmp_path: Path) -> None:
    effects = [kind.typical() for kind in every().values()]
    effects += [make("friction_relaxation", 0.1, 0.8, 1)]  # one effect may have two members
    machine = replace(load(), effects=in_order(reversed(effects)))
    path = tmp_path / "machine.toml"
    path.write_text(to_toml(machine), encoding="utf-8")
    assert load(path).effects[2:] == machine.effects[2:]
    assert set(load(path).effects) == set(effects)
    assert load(path) == machine
    shown = to_json(machine)["effects"]
    assert shown["cogging"] == {
        "amplitude_N": pytest.approx(1.5811388),
        "pitch_m": pytest.approx(0.0346410),
        "phase": 1,
    }
    assert set(named(machine.effects)) >= {"friction_relaxation.1", "friction_relaxation.2", "play"}
    assert "effects" not in to_json(load())


def test_values_of_effects_have_sources(tmp_path: Path) -> None:
    text = '[effects.cable_spring]\nstiffness = { value = "0.2 N/mm", source = "identified: stroke.csv" }\n'
    machine = load(machine_file(tmp_path, text))
    assert machine.effects == (make("cable_spring", 200.0),)
    (found,) = [item for item in values(machine) if item.name.startswith("effects.")]
    assert (found.name, found.unit, found.number) == ("effects.cable_spring.stiffness", "N/m", 200.0)
    assert (found.provenance.kind, found.provenance.detail) == ("identified", "stroke.csv")
    assert 'source = "identified: stroke.csv"' in to_toml(machine).partition("[effects.cable_spring]")[2]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[effects.coging]\namplitude = "1 N"', "effects.coging: unknown; did you mean 'cogging'?"),
        ('[effects.cogging]\namplitude = "1 N"', "effects.cogging.pitch: missing; add it, pitch p, in m"),
        ("[effects]\nplay = 3", "effects.play: must be a table; write [effects.play] with its values below"),
        ('[effects.play]\nwidth = "1 N"', "effects.play.width: '1 N' is in N, but this is a quantity in m"),
        ('[effects.play]\nwidht = "1 um"', "effects.play.widht: unknown; did you mean 'width'?"),
        (
            '[effects.dac_quantisation]\nstep = "0.1 N"\nrise = "0.4"',
            "dac_quantisation.rise: '0.4' must be a whole number",
        ),
        ('[effects.dac_quantisation]\nstep = "0.1 N"\nrise = 3', "dac_quantisation.rise: 3 must be below 3"),
        ('[effects.play]\nwidth = "-1 um"', "effects.play.width: -1 µm must be at least 0 m"),
        (
            '[effects.additional_mode]\ngain = "1e-3 1/kg"\nfrequency = "2 kHz"\ndamping = "0.01"',
            "effects.additional_mode.frequency: 2000 Hz is not below the Nyquist frequency",
        ),
    ],
)
def test_every_mistake_gets_its_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(MachineError, match=re.escape(sentence)):
        load(machine_file(tmp_path, text + "\n"))


def test_pack_lays_out_parameters_and_memory_and_compiles_no_hook_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """A diagnosis packs an effect for every trial of its parameters, so a hook's address is looked up."""
    effects = [make("cogging", 1.0, 0.03, 0.0), make("friction_relaxation", 0.1, 0.2, 1.0)]
    hooks = pack(effects, 10)
    assert hooks.memory.size == 20
    assert hooks.parameters.tolist() == [1.0, 0.03, 0.0, 0.1, 0.2, 1.0]
    assert hooks.span.tolist() == [[3, 6, 0, 20], [0, 3, 0, 0]]

    def compiled_again(*_: object) -> NoReturn:
        raise AssertionError("a hook is compiled again")

    for effect in effects:
        for law in effect.hooks.values():
            monkeypatch.setattr(type(law), "compile", compiled_again)
    assert list(pack(effects, 10).law) == list(hooks.law)
