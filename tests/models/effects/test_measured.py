"""A table of measured values as an effect: what it does along a path and in the loop, and how files hold it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models import controller as controllers
from models.effect_feedforward import EffectFeedforward
from models.effects.base import parameters
from models.effects.catalogue import every, readable
from models.effects.friction_laws import ViscousFriction
from models.effects.measured import Measured
from models.effects.motor import Cogging
from models.friction import Friction, elements
from models.machine import MachineError, Provenance, load, to_json
from models.machine import parameters as values
from models.machine_file import to_toml
from models.simulation.effect_kernel import Replayed, replay
from models.simulation.simulator import simulate
from tests.models.effects.paths import TS, Array, through
from tests.models.effects.test_catalogue import machine_file
from tests.models.simulation.test_simulator import TARGET, controlled, exact_scale

TABLE = exact_scale(load())
SOFT: Friction = elements([1e4, 4e4], [20e-6, 5e-6])
COURSE = 1e-3 * np.sin(2 * np.pi * np.arange(400) / 200) + 2e-7 * np.arange(400)
COMMAND = 5.0 * np.cos(np.arange(400) / 30)


def along(law: Measured, course: Array = COURSE) -> Replayed:
    return replay(SOFT, [law], through(course, 4, command=COMMAND[: course.size]), 0.0)


def oracle(law: Measured, coordinate: Array) -> Array:
    """The table by numpy's interpolation, which shares nothing with the compiled hook."""
    size = np.abs(coordinate) if law.symmetry in {"even", "odd"} else coordinate
    force = np.interp(size, law.knots, law.force)
    return np.asarray(force * np.sign(coordinate) if law.symmetry == "odd" else force)


PATH = through(COURSE, 4, command=COMMAND)
ALONG = {
    "time": (np.arange(400)[:, None] + (np.arange(4) + 0.5) / 4) * TS,
    "position": PATH.position,
    "speed": PATH.speed,
    "command": along(Measured("time", (0.0, 1.0), (0.0, 0.0))).sent,
}


SIGNED = [(one, symmetry) for one in ("speed", "command") for symmetry in ("plain", "even", "odd")]


@pytest.mark.parametrize(("coordinate", "symmetry"), [("time", "plain"), ("position", "plain"), *SIGNED])
def test_the_force_is_that_of_the_table_and_stays_at_its_ends(coordinate: str, symmetry: str) -> None:
    most = 0.6 * float(np.max(np.abs(ALONG[coordinate])))  # so that the path goes beyond the last knot
    first = 0.0 if symmetry != "plain" else -0.3 * most
    knots = (first, 0.1 * most, 0.4 * most, most)
    law = Measured(coordinate, knots, (0.0, 1.0, -2.0, 0.5), symmetry)  # type: ignore[arg-type]
    found = along(law)
    assert found.force == pytest.approx(oracle(law, ALONG[coordinate]), abs=1e-12)
    assert np.ptp(found.force) > 1.0


@pytest.mark.parametrize(("symmetry", "factor"), [("drag", "speed"), ("thrust", "command")])
@pytest.mark.parametrize("coordinate", ["time", "position"])
def test_a_drag_and_a_part_of_the_thrust_go_with_these(coordinate: str, symmetry: str, factor: str) -> None:
    most = 0.6 * float(np.max(np.abs(ALONG[coordinate])))
    law = Measured(coordinate, (-0.3 * most, 0.1 * most, most), (0.3, -2.0, 0.5), symmetry)  # type: ignore[arg-type]
    found = along(law).force
    assert found == pytest.approx(oracle(law, ALONG[coordinate]) * ALONG[factor], abs=1e-12)
    assert np.ptp(found) > 0


def test_in_the_loop_a_constant_drag_is_viscous_friction_and_a_part_of_the_thrust_a_thrust_constant() -> None:
    controller = controlled(TABLE)
    drag = Measured("position", (-1.0, 1.0), (-40.0, -40.0), "drag")
    fade = Measured("time", (0.0, 1e3), (-0.05, -0.05), "thrust")
    friction = replace(TABLE.friction, stiffness=tuple(one / 0.95 for one in TABLE.friction.stiffness))
    weaker = replace(  # the thrust constant is of all that acts where the thrust does
        TABLE,
        plant=replace(TABLE.plant, thrust_constant=0.95),
        friction=replace(friction, damping=tuple(one / 0.95 for one in friction.damping)),
        drive=replace(TABLE.drive, offset=TABLE.drive.offset / 0.95),
    )
    bare = simulate(TABLE, controller, TARGET).position
    for law, other in ((drag, replace(TABLE, effects=(ViscousFriction(40.0),))), (fade, weaker)):
        one, two = (
            simulate(machine, controller, TARGET).position for machine in (replace(TABLE, effects=(law,)), other)
        )
        assert np.max(np.abs(one - two)) < 1e-6 * np.max(np.abs(bare - two))


@pytest.mark.parametrize("coordinate", ["speed", "command", "acceleration"])
def test_a_law_over_the_speed_or_the_thrust_is_in_proportion_to_neither(coordinate: str) -> None:
    with pytest.raises(ValueError, match=f"does not go with {coordinate}; give one of plain, even, odd, directional"):
        Measured(coordinate, (0.0, 1.0), (0.0, 1.0), "drag")  # type: ignore[arg-type]


def test_a_directional_law_turns_with_what_the_contacts_hold() -> None:
    law = Measured("position", (-1e-3, 0.0, 1e-3), (-1.0, -3.0, -1.0), "directional")
    plain, found = replay(SOFT, [], PATH, 0.0), along(law)
    held = plain.friction / float(np.dot(SOFT.stiffness, SOFT.limit))
    assert found.friction - plain.friction == pytest.approx(-oracle(law, PATH.position) * held, abs=1e-12)
    assert np.max(np.abs(held)) == pytest.approx(1.0)
    assert np.all(found.force == 0.0)


def test_acceleration_rest_and_path_since_a_reversal() -> None:
    ramp = np.concatenate([np.zeros(50), np.linspace(0, 1e-3, 51)[1:], np.full(100, 1e-3), np.linspace(1e-3, 4e-4, 60)])
    line = (0.0, 1e3)
    rest = along(Measured("rest", line, line, slow=1e-6), ramp).force
    assert rest[98, 3] == 0.0
    assert rest[150, 0] == pytest.approx(51.25 * TS)  # since the middle of the last substep in motion
    assert rest[-2, 3] == 0.0
    gone = along(Measured("path", line, line, turn=1e-6), ramp).force
    assert gone[99, 3] == pytest.approx(1e-3, rel=0.01)
    assert gone[-2, 3] == pytest.approx(6e-4, rel=0.02)
    squares = 1.5 * np.square(np.arange(100) * TS)  # 3 m/s^2, the speed of each substep that of its sample
    found = along(Measured("acceleration", (-100.0, 100.0), (-100.0, 100.0)), squares).force
    assert np.mean(found[1:-1]) == pytest.approx(3.0)


def test_a_period_repeats_the_curve() -> None:
    law = Measured("position", (0.0, 1e-4, 3e-4), (0.0, 2.0, 0.0), period=3e-4)
    wrapped = np.interp(np.mod(PATH.position, 3e-4), law.knots, law.force)
    assert along(law).force == pytest.approx(wrapped, abs=1e-9)


def test_in_the_loop_a_straight_line_over_the_speed_is_viscous_friction() -> None:
    drag, fast = 40.0, 0.1
    line = Measured("speed", (0.0, fast), (0.0, -drag * fast), "odd")
    controller = controlled(TABLE)
    one, other, without = (
        simulate(replace(TABLE, effects=effects), controller, TARGET).position
        for effects in ((line,), (ViscousFriction(drag),), ())
    )
    assert np.max(np.abs(one - other)) < 1e-6 * np.max(np.abs(without - other))


def test_in_the_loop_a_sine_comes_within_the_interpolation_s_error() -> None:
    """A piecewise linear curve is off by at most h^2/8 of the second derivative, a part of that of a sine's size."""
    size, pitch, count = 3.0, 60e-6, 25
    knots = np.linspace(-pitch, pitch, count)
    # the law pulls as cogging pushes: its sign and phase are told by the replay, not assumed
    pull = replay(SOFT, [Cogging(size, pitch, 0.4)], through(knots, 1), 0.0)
    table = Measured("position", tuple(through(knots, 1).position[:, 0]), tuple(pull.force[:, 0]))
    controller = controlled(TABLE)
    one, other, without = (
        simulate(replace(TABLE, effects=effects), controller, TARGET).position
        for effects in ((table,), (Cogging(size, pitch, 0.4),), ())
    )
    off = (2 * np.pi * float(knots[1] - knots[0]) / pitch) ** 2 / 8
    assert np.max(np.abs(one - other)) < 2 * off * np.max(np.abs(without - other))


LAWS = (
    Measured("time", (0.0, 10.0), (1.0, 2.0)),
    Measured("position", (-1e-3, 0.0, 2e-3), (1.0, 2.0, 1.0), "directional"),
    Measured("position", (0.0, 1e-3, 2e-3), (1.0, 2.0, 1.0), period=2e-3),
    Measured("position", (0.0, 1e-3, 2e-3), (0.0, -20.0, 0.0), "drag"),
    Measured("time", (0.0, 10.0), (0.0, -0.05), "thrust"),
    Measured("acceleration", (0.0, 3.0), (0.0, 1.0), "odd"),
    Measured("command", (-20.0, 20.0), (0.3, -0.2)),
    Measured("rest", (0.0, 3.0), (0.0, 1.0), "directional", slow=2e-5),
    Measured("path", (0.0, 3e-5), (0.0, 1.0), turn=3e-7),
)


def test_a_machine_file_keeps_every_table(tmp_path: Path) -> None:
    machine = replace(load(), effects=LAWS)
    path = tmp_path / "machine.toml"
    path.write_text(to_toml(machine), encoding="utf-8")
    assert load(path) == machine
    shown = to_json(machine)["effects"]["measured.2"]
    assert shown == {
        "coordinate": "position",
        "knots_m": [-1e-3, 0.0, 2e-3],
        "force_N": [1.0, 2.0, 1.0],
        "symmetry": "directional",
    }
    assert to_json(machine)["effects"]["measured.4"]["force_Ns_per_m"] == [0.0, -20.0, 0.0]
    assert to_json(machine)["effects"]["measured.6"]["knots_m_per_s^2"] == [0.0, 3.0]


def test_its_values_have_units_and_sources(tmp_path: Path) -> None:
    text = """[effects.measured]
coordinate = "position"
knots = { value = ["-1 mm", "2 mm"], source = "identified: moves.csv" }
force = { value = ["1 N", "-1 N"], std = ["0.1 N", "0.2 N"], source = "identified: moves.csv" }
"""
    machine = load(machine_file(tmp_path, text))
    assert machine.effects == (Measured("position", (-1e-3, 2e-3), (1.0, -1.0)),)
    rows = {row.name: row for row in values(machine)}
    assert rows["effects.measured.knots"].unit == "m"
    assert rows["effects.measured.force"].provenance.std == (0.1, 0.2)
    moved = machine.with_value("effects.measured.force", (2.0, 3.0), Provenance("assumed", "a trial"))
    assert moved.effects == (Measured("position", (-1e-3, 2e-3), (2.0, 3.0)),)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('coordinate = "sped"', "effects.measured.coordinate: 'sped' is unknown; did you mean 'speed'?"),
        ("", "effects.measured.coordinate: missing; add it, coordinate that the force is a function of"),
        ('coordinate = "speed"\nknots = ["1 mm", "2 mm"]\nforce = ["1 N", "2 N"]', "knots: '1 mm' is in m"),
        ('coordinate = "speed"\nknots = "1 m/s"\nforce = ["1 N"]', "knots: '1 m/s' must be a list"),
        ('coordinate = "position"\nknots = ["1 m", "2 m"]\nforce = ["1 N"]', "2 knots and 1 forces"),
        ('coordinate = "position"\nknots = ["2 m", "1 m"]\nforce = ["1 N", "1 N"]', "or more that increase"),
        (
            'coordinate = "position"\nsymmetry = "odd"\nknots = ["1 m", "2 m"]\nforce = ["1 N", "1 N"]',
            "symmetry 'odd' does not go with position; give one of plain, directional, drag, thrust",
        ),
        (
            'coordinate = "speed"\nsymmetry = "odd"\nknots = ["0 m/s", "1 m/s"]\nforce = ["1 N", "1 N"]',
            "an odd law has no force at 0",
        ),
        ('coordinate = "rest"\nknots = ["1 s", "2 s"]\nforce = ["1 N", "1 N"]', "slow is missing"),
        (
            'coordinate = "position"\nperiod = "2 m"\nknots = ["1 m", "2 m"]\nforce = ["1 N", "1 N"]',
            "period must be the distance of the last knot from the first",
        ),
    ],
)
def test_every_mistake_gets_its_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(MachineError, match=re.escape(sentence)) as error:
        load(machine_file(tmp_path, f"[effects.measured]\n{text}\n"))
    assert "\n" not in str(error.value)


def test_it_is_no_candidate_of_the_catalogue() -> None:
    assert "measured" not in every()
    assert "measured" in readable()
    assert "measured" not in replace(load(), effects=LAWS[:1]).kinds
    assert parameters(Measured) == ()
    assert LAWS[1].off().strength() == 0.0
    assert LAWS[1].strength() == 2.0


def test_a_controller_file_keeps_the_tables_that_it_meets(tmp_path: Path) -> None:
    controller = replace(controlled(TABLE), effect_compensation=EffectFeedforward(LAWS[1:3], 0.0))
    path = tmp_path / "controller.json"
    path.write_text(json.dumps(controllers.to_json(controller, 2e-5, 0.02)), encoding="utf-8")
    assert controllers.load(path).effect_compensation == controller.effect_compensation
    path.write_text(
        path.read_text(encoding="utf-8").replace("[0.0, 0.001, 0.002]", "[0.0, NaN, 0.002]"), encoding="utf-8"
    )
    with pytest.raises(controllers.ControllerError, match=r"effects\.measured.*knots"):
        controllers.load(path)
