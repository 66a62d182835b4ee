"""From records to a machine: which value goes where, with which source, and what is said of a record of no use."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from models.effects.friction_laws import ViscousFriction
from models.identification import motion
from models.identification.estimate import Estimate
from models.identification.force import by_elements
from models.identification.into_machine import Found, holdable, with_drag, with_inertia, with_offset
from models.identification.joint.response_records import on_what_is_between
from models.identification.joint.steps import ForceStep
from models.identification.pipeline import identify
from models.identification.response import FrequencyResponse
from models.identification.unusable import UnusableError
from models.machine import Machine, Provenance, load
from models.plant import frequency_response
from models.records.columns import Columns
from models.records.files import Loaded
from models.records.record import Record
from models.records.tables.sizes import RecordError
from models.variation import Variation, varied
from studies.identify_machine import own_records
from studies.identify_machine.controllers import judged
from studies.identify_machine.shown import checks_of, warnings_of
from tests.diagnosis.slow import leg, moved

MACHINE = load()
FREQUENCY = np.geomspace(5, 400, 120)


def measured(machine: Machine) -> Loaded:
    """The machine's own frequency response, as a file would hold it, without stated deviations."""
    noise = 1 + 0.001 * np.random.default_rng(0).standard_normal(FREQUENCY.size)
    response = frequency_response(machine.plant, 2 * np.pi * FREQUENCY) * noise
    unknown = np.full(FREQUENCY.size, np.nan)
    return Loaded("frf.csv", "12ab", FrequencyResponse(FREQUENCY, response, unknown, unknown, 0.0), (), ())


FOUND = Found(replace(measured(MACHINE), name="fast.csv"), "dynamics")


def test_a_frequency_response_gives_the_plant_and_leaves_the_rest() -> None:
    truth = replace(MACHINE, plant=replace(MACHINE.plant, dead_time=0.9e-3))
    found = identify(MACHINE, [measured(truth)])
    assert [step.kind for step in found.steps] == ["response"]
    assert found.machine.plant.dead_time == pytest.approx(0.9e-3, rel=0.01)
    assert found.machine.plant.mass == pytest.approx(MACHINE.plant.mass, rel=0.01)
    assert found.machine.friction == MACHINE.friction
    source = found.machine.sources["plant.modes.1.gain"]
    assert (source.kind, source.record, source.sha256) == ("identified", "frf.csv", "12ab")
    assert source.std == found.estimates["frf.csv"].deviation("rigid body gain")
    assert found.machine.sources["friction.limit"] == MACHINE.sources["friction.limit"]
    assert any("no stated deviations" in remark for remark in found.remarks)


def test_the_viscous_friction_of_a_response_stays_when_a_slow_record_follows() -> None:
    """Slow loops show it worse by far, and their curve is found beside the known one."""
    drag = 60.0
    dragging = replace(MACHINE, effects=(ViscousFriction(drag),))
    rigid = frequency_response(MACHINE.plant, 2 * np.pi * FREQUENCY)
    one = measured(MACHINE)
    assert isinstance(one.content, FrequencyResponse)
    noise = one.content.response / rigid
    response = rigid / (1 + 2j * np.pi * FREQUENCY * drag * rigid) * noise
    shown = replace(one, content=replace(one.content, response=response, rolling=True))
    slow = Loaded("slow.csv", "34cd", own_records.hysteresis(dragging, 5), (), ())
    found = identify(MACHINE, [slow, shown], kinds=["hysteresis", "response"])
    alone = identify(MACHINE, [shown], kinds=["response"])
    assert [step.kind for step in found.steps] == ["response", "hysteresis"]
    (kept,), (given,) = found.machine.effects, alone.machine.effects
    assert kept == given
    assert kept.values()[0] == pytest.approx(drag, rel=0.1)
    assert found.machine.sources["effects.viscous_friction.coefficient"].record == "frf.csv"
    assert any("was taken off and stays" in remark for remark in found.remarks)


def test_a_response_that_shows_nothing_is_refused_with_the_reason() -> None:
    """One whose lines are ten times as uncertain as they are large."""
    one = measured(MACHINE)
    assert isinstance(one.content, FrequencyResponse)
    vague = replace(one.content, variance=100 * np.abs(one.content.response) ** 2, rolling=True)
    with pytest.raises(RecordError, match=r"frf\.csv: does not excite the axis: from 5 to 400 Hz it leaves"):
        identify(MACHINE, [replace(one, content=vague)])


@pytest.mark.parametrize("turned", [("command",), ("command", "feedforward"), ("reference", "position")])
def test_an_excitation_whose_command_is_turned_is_refused(turned: tuple[str, ...]) -> None:
    """A user's was fitted for minutes and then said to excite the axis too little."""
    record = own_records.excitation(MACHINE, 1)
    log = replace(record, **{name: -getattr(record, name) for name in turned})
    loaded = Loaded("sweep.csv", "0", log, (), ())
    with pytest.raises(RecordError, match=r"sweep\.csv: moves the axis against its command: the sign"):
        identify(MACHINE, [loaded], kinds=["excitation"])


def test_a_record_of_one_direction_shows_no_friction() -> None:
    """What is the friction's there may as well be an offset's, however much a force shakes the axis."""
    record = own_records.excitation(MACHINE, 1)
    unmapped = replace(record, feedforward=np.zeros(record.feedforward.size))
    for one, said in ((record, "name its kind excitation"), (unmapped, "map its column, --column feedforward=")):
        rolls = Loaded("one_way.csv", "0", one, (), ())
        with pytest.raises(RecordError, match=rf"one_way\.csv: never turns round: in one direction .* or {said}"):
            identify(MACHINE, [rolls], kinds=["dynamics"])


@pytest.mark.filterwarnings("error")
def test_a_record_that_no_machine_explains_is_refused_in_words_of_its_own() -> None:
    """A command whose sign is turned, which is trusted: no message and no warning of NumPy comes through."""
    record = own_records.motions(MACHINE, 1)
    turned = Loaded("turned.csv", "0", replace(record, command=-record.command), (), ())
    with pytest.raises(
        RecordError,
        match=r"turned\.csv: (no machine close to|the simulated loop leaves|the fit of its motions (does not|has not))",
    ):
        identify(MACHINE, [turned], kinds=["motion"])


def test_motions_that_no_machine_makes_are_left_out_beside_what_else_was_identified() -> None:
    """They had thrown away a response that was found before, and advised to add one."""
    record = own_records.motions(MACHINE, 1)
    turned = Loaded("turned.csv", "0", replace(record, command=-record.command), (), ())
    found = identify(MACHINE, [turned, measured(MACHINE)], kinds=["motion", "response"])
    assert [step.loaded.name for step in found.steps] == ["frf.csv"]
    assert found.machine.sources["plant.modes.1.gain"].record == "frf.csv"
    (left,) = found.left_out
    assert (left.name, left.kind) == ("turned.csv", "motion")
    assert found.remarks[0] == f"turned.csv: is left out: {left.why}."
    assert "add a frequency response" not in left.why


def test_motions_without_all_samples_of_the_controller_are_left_out() -> None:
    """All that a response and slow loops had given was lost with them; and no controller is blamed that can't be
    replayed on them."""
    thinned = Loaded("m.csv", "0", own_records.motions(MACHINE, 1).thinned(2), ("reference",), ())
    found = identify(MACHINE, [thinned, measured(MACHINE)], kinds=["motion", "response"])
    assert [step.loaded.name for step in found.steps] == ["frf.csv"]
    assert found.left_out[0].why == (
        "has a sample every 1 ms, where the controller, which is replayed on motions, runs every 500 µs; log all of "
        "its samples"
    )
    assert judged(MACHINE, [("motion", thinned)]) == ([], [])
    faster = replace(thinned, content=own_records.motions(MACHINE, 1).part(0, 2000).filled(4))
    with pytest.raises(RecordError, match="runs every 500 µs; take one row of 4"):
        identify(MACHINE, [faster], kinds=["motion"])


@pytest.mark.parametrize(("resolution", "every", "told"), [(1e-6, 2, True), (1e-6, 1, False), (1e-9, 2, False)])
def test_a_log_that_lacks_much_of_the_command_is_told(resolution: float, every: int, told: bool) -> None:
    """On a scale of 0.1 um, a machine tool's dead time came out ten deviations off from every second sample."""
    machine = replace(MACHINE, scale=replace(MACHINE.scale, resolution=resolution, noise=0.0))
    record = own_records.excitation(machine, 3)
    loaded = Loaded("e.csv", "0", record.thinned(every) if every > 1 else record, ("reference",), ())
    found = identify(machine, [loaded], kinds=["response"])
    said = [one for one in found.remarks if "has one of 2 samples of the controller" in one]
    assert bool(said) == told
    assert [name for name, one in warnings_of(found) if "has one of 2 samples" in one] == ["e.csv"] * told
    assert on_what_is_between(machine, replace(record.thinned(2), feedforward=record.thinned(2).command)) == []


def test_the_advice_on_motions_is_the_one_that_applies(monkeypatch: pytest.MonkeyPatch) -> None:
    def run_away(*_: object, **__: object) -> None:
        raise UnusableError("it runs away")

    monkeypatch.setattr(motion, "identify", run_away)
    record = own_records.motions(MACHINE, 1)
    own, other = (Loaded("m.csv", "0", replace(record, command=size * record.command), (), ()) for size in (1, -1))
    slow = Loaded("slow.csv", "34cd", own_records.hysteresis(MACHINE, 5), (), ())
    with pytest.raises(RecordError, match="or add a frequency response and slow loops"):
        identify(MACHINE, [own], kinds=["motion"])
    with pytest.raises(RecordError, match=r"the feedback in \[control\] does not make the logged command"):
        identify(MACHINE, [other], kinds=["motion"])
    found = identify(MACHINE, [own, slow, measured(MACHINE)], kinds=["motion", "hysteresis", "response"])
    assert "against those of the other records; where these are right" in found.left_out[0].why
    assert [step.kind for step in found.steps] == ["response", "hysteresis"]


def test_a_response_that_friction_bends_is_left_out_beside_one_that_it_does_not() -> None:
    """As of a galvo's first sweep, in which the axis moved backwards throughout."""
    one = measured(MACHINE)
    assert isinstance(one.content, FrequencyResponse)
    stuck = 1 / (1 / one.content.response + 1e9)
    bent = replace(one, name="bent.csv", content=replace(one.content, response=stuck))
    for order in ([one, bent], [bent, one]):
        found = identify(MACHINE, order)
        assert [step.loaded.name for step in found.steps] == ["frf.csv"]
        assert [left.name for left in found.left_out] == ["bent.csv"]
    with pytest.raises(RecordError, match=r"friction bends the whole response.*\(--rolling\)"):
        identify(MACHINE, [bent])
    sampled = replace(bent, content=replace(one.content, response=stuck, sample_time=5e-4))
    with pytest.raises(RecordError, match="friction bends the whole response") as said:
        identify(MACHINE, [sampled])
    assert "--rolling" not in str(said.value)


def test_the_words_of_a_library_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "identify", lambda *_, **__: np.linalg.inv(np.zeros((2, 2))))  # "Singular matrix"
    record = Loaded("flat.csv", "0", own_records.motions(MACHINE, 1), (), ())
    with pytest.raises(RecordError, match=r"flat\.csv: no machine close to that of the machine file reproduces"):
        identify(MACHINE, [record], kinds=["motion"])


def test_a_fault_in_a_method_that_needs_no_close_machine_is_told_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """A programming error had been blamed on the units, the signs and the mass in the machine file."""
    monkeypatch.setattr(by_elements, "identify", lambda *_, **__: np.zeros(3) @ np.zeros(4))
    record = Loaded("slow.csv", "0", own_records.hysteresis(MACHINE, 1), (), ())
    with pytest.raises(
        RecordError, match=r'slow\.csv: the method for records of the kind hysteresis fails on it, .*"matmul'
    ):
        identify(MACHINE, [record], kinds=["hysteresis"])


def test_no_record_leaves_the_machine_but_for_what_was_published_of_it() -> None:
    found = identify(MACHINE, [])
    assert found.steps == ()
    assert found.machine == replace(MACHINE, name=f"{MACHINE.name}, identified", published=None)


def test_a_record_of_another_kind_is_said_with_its_name() -> None:
    with pytest.raises(RecordError, match=r"frf\.csv: is a frequency response, not a record over time"):
        identify(MACHINE, [measured(MACHINE)], kinds=["motion"])
    for kinds in (["movement"], ["response", "response"]):
        with pytest.raises(ValueError, match="kinds: must be one of auto, response"):
            identify(MACHINE, [measured(MACHINE)], kinds=kinds)


def test_an_offset_widens_its_tolerance_only_where_it_is_known_worse_than_usual() -> None:
    usual = MACHINE.tolerances.offset
    vague = with_offset(MACHINE, -3.0, 2 * usual, FOUND)
    assert (vague.drive.offset, vague.tolerance.offset) == (-3.0, 2 * usual)
    assert vague.sources["drive.offset"] == vague.sources["tolerance.offset"]
    assert vague.sources["drive.offset"].std == 2 * usual
    sharp = with_offset(vague, -2.0, 0.1 * usual, FOUND)
    assert (sharp.drive.offset, sharp.tolerances.offset) == (-2.0, usual)
    assert "tolerance.offset" not in sharp.sources


def test_inertia_goes_to_the_rigid_body_wherever_it_stands() -> None:
    """With K_t = 2 the gain is half of what the mass alone would say."""
    modes = [MACHINE.plant.modes[i] for i in (*MACHINE.plant.flexible, MACHINE.plant.rigid)]
    machine = replace(MACHINE, plant=replace(MACHINE.plant, thrust_constant=2.0, modes=tuple(modes)))
    estimate = Estimate(("mass", "delay"), ("kg", "s"), np.array([40.0, 1e-3]), np.diag([4.0, 1e-10]))
    found = with_inertia(machine, estimate, FOUND)
    assert found.plant.mass == pytest.approx(40.0)
    assert found.plant.modes[:2] == machine.plant.modes[:2]
    assert found.plant.dead_time == pytest.approx(1e-3 - 0.5 * machine.sample_time)
    source = found.sources["plant.modes.3.gain"]
    assert source.std == pytest.approx(found.plant.modes[2].gain * 2.0 / 40.0)


def test_drag_takes_the_place_of_the_drag_that_was_there() -> None:
    once = with_drag(MACHINE, (80.0, 4.0), (0.1, 0.01), FOUND)
    assert [effect.name for effect in once.effects] == ["viscous_friction", "directional_friction"]
    assert once.sources["effects.directional_friction.asymmetry"].std == 0.01
    again = with_drag(once, (60.0, 3.0), None, FOUND)
    assert [effect.values().tolist() for effect in again.effects] == [[60.0]]
    assert {name for name in again.sources if name.startswith("effects")} == {"effects.viscous_friction.coefficient"}


def test_a_deviation_that_is_not_finite_is_not_known() -> None:
    assert FOUND.by(np.inf) == replace(FOUND.by(1.0), std=None)
    assert FOUND.by([1.0, np.nan]).std is None
    assert FOUND.by([1.0, 2.0]) == Provenance("identified", "inverse dynamics", "", "fast.csv", "12ab", (1.0, 2.0))


def test_a_record_of_too_many_motions_is_refused_before_the_work() -> None:
    nothing = np.zeros(motion.MOST_SAMPLES + 1)
    record = Record(MACHINE.sample_time, nothing, nothing, nothing, nothing, nothing)
    with pytest.raises(ValueError, match=r"700,001 samples are more than the 700,000 .* cut the record"):
        motion.identify(record, MACHINE)


def test_motions_of_a_derivative_of_the_position_are_replayed_as_they_ran(tmp_path: Path) -> None:
    """The PID that ran took the derivative of the position alone; without its reference's, the commands are the same.
    What is identified is the same, too, only where the columns' derivative reaches the replay."""
    control, truth = MACHINE.control, varied(MACHINE, Variation(mass=0.04))
    ran = own_records.motions(truth, 3, MACHINE)
    waits = np.concatenate([np.full(control.reference_delay, ran.reference[0]), ran.reference])[: ran.reference.size]
    keep = control.pid.pole(ran.sample_time)
    slope = lfilter([1.0, -1.0], [ran.sample_time / (1 - keep), -keep * ran.sample_time / (1 - keep)], waits)
    logged = replace(ran, feedforward=ran.feedforward + control.pid.kd * slope)  # so that u_fb + u_ff is the same
    columns = {"time_s": np.arange(ran.position.size) * ran.sample_time, "target_m": ran.target}
    columns |= {"reference_m": ran.reference, "feedforward_N": logged.feedforward}
    columns |= {"command_N": ran.command, "position_m": ran.position}
    path = tmp_path / "moves.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
    mapped = replace(MACHINE, record=replace(MACHINE.record or Columns(), derivative="position"))
    found, plain = (identify(one, [path], kinds=["motion"]).machine for one in (mapped, MACHINE))
    assert found.plant.mass == pytest.approx(truth.plant.mass, rel=2e-3)
    assert abs(plain.plant.mass / truth.plant.mass - 1) > 5 * abs(found.plant.mass / truth.plant.mass - 1)


def test_what_motions_do_not_show_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """On an axis with next to no friction a motion record gave a level of -0.13 +- 3.4, and the file negative
    stiffnesses. Of two motion records the one that knows a value better gives it."""
    record = own_records.motions(MACHINE, 1)
    names, units = ("mass", "friction level", "presliding length", "dead time", "offset"), ("1", "1", "1", "s", "N")

    def told(values: tuple[float, ...], deviations: tuple[float, ...]) -> motion.MotionFit:
        estimate = Estimate(names, units, np.array(values), np.diag(np.square(deviations)))
        friction = replace(
            MACHINE.friction,
            stiffness=tuple(k * values[1] / values[2] for k in MACHINE.friction.stiffness),
            limit=tuple(x * values[2] for x in MACHINE.friction.limit),
        )
        none = np.zeros(1)
        return motion.MotionFit(estimate, replace(MACHINE, friction=friction), none, none, none, (0.0, 1.0), (0, 0.0))

    sure = told((1.1, 1.2, 0.9, 3e-4, 0.2), (0.01, 0.05, 0.05, 1e-5, 0.01))
    loose = told((1.0, -0.13, 0.8, 3e-4, 0.5), (0.02, 3.4, 0.2, 1e-5, 0.3))
    files = [Loaded(name, "0", record, (), ()) for name in ("a.csv", "b.csv")]
    for fits, taken in (((loose, sure), "b.csv"), ((sure, loose), "a.csv"), ((loose, loose), None)):
        given = iter(fits)
        monkeypatch.setattr(motion, "identify", lambda *_, given=given, **__: next(given))
        found = identify(MACHINE, files, kinds=["motion", "motion"])
        sources, friction = found.machine.sources, found.machine.friction
        assert all(k > 0 for k in friction.stiffness)
        assert sources["plant.modes.1.gain"].record == (taken or "a.csv")
        if taken is None:
            assert friction == MACHINE.friction
            assert "b.csv: This record does not show the friction level: its standard deviation is more than 10" in (
                "".join(found.remarks)
            )
        else:
            assert sources["friction.stiffness"].record == sources["drive.offset"].record == taken


def test_a_slow_record_without_friction_is_left_out_beside_others() -> None:
    """An axis on air: whatever else was identified stays."""
    slow = own_records.hysteresis(MACHINE, 5)
    still = Loaded("slow.csv", "34cd", replace(slow, command=-slow.command), (), ())
    found = identify(MACHINE, [still, measured(MACHINE)], kinds=["hysteresis", "response"])
    assert [step.loaded.name for step in found.steps] == ["frf.csv"]
    (left,) = found.left_out
    assert "as on an axis without friction" in left.why
    assert next(checks_of(found, {})).name == "slow records that were left out"


def test_a_record_at_rest_shows_no_machine() -> None:
    slow = own_records.hysteresis(MACHINE, 5)
    still = np.full(slow.position.size, slow.reference[0])
    creeping = 1e-6 * np.sin(np.arange(still.size) / 900.0)
    rests = Record(slow.sample_time, still, still, 0 * still, 5e5 * creeping, still + creeping)
    loaded = Loaded("rest.csv", "34cd", rests, (), ())
    with pytest.raises(RecordError, match=r"rest\.csv: the axis rests in it"):
        identify(MACHINE, [loaded], kinds=["hysteresis"])
    found = identify(MACHINE, [loaded, measured(MACHINE)], kinds=["hysteresis", "response"])
    assert [one.name for one in found.left_out] == ["rest.csv"]


def test_what_contacts_may_carry_from_before_makes_the_offset_of_the_file_unsure() -> None:
    """A user's production log: "offset -0.596 +- 1.4 N" was told, and -0.584 +- 0.051 N written, where none was."""
    machine = leg(200.0)
    moves = Loaded("moves.csv", "0", moved(machine, count=1200), (), ())
    gave = identify(machine, [moves], kinds=["dynamics"]).steps[0].gave
    assert isinstance(gave, ForceStep)
    none, some = (holdable(replace(gave.fit, remembered=size)) for size in (0.0, 3.0))
    assert some.offset[0] == none.offset[0]
    assert some.offset[1] == pytest.approx(np.hypot(none.offset[1], 3**0.5))
