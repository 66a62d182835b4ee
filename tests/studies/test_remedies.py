"""What would do where motions are late: the advice, followed, gives the figures that it was given with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from design.controller import assemble, design_deadbeat
from design.deadbeat import Deadbeat
from design.pid.problem import TuningError
from design.validation import Validation, validate
from models.machine import Machine, load, with_pid
from models.machine_file import to_toml
from studies.as_known import on_allowed_machines
from studies.deadbeat_design import remedies as module
from studies.deadbeat_design.effects import Written
from studies.deadbeat_design.options import DeadbeatOptions
from studies.deadbeat_design.remedies import needed, remedies, told

TABLE = load()
PID = TABLE.control.pid
SOFT = with_pid(TABLE, replace(PID, kp=0.35 * PID.kp, ki=0.35 * PID.ki, kd=0.35 * PID.kd), "a test")
WANTED = {"stroke_m": SOFT.specification.stroke, "settling_time_s": SOFT.specification.reference_settling_time}
OPTIONS = DeadbeatOptions(quick=True)
LIMIT = SOFT.specification.settling_time


def sooner(machine: Machine, time: float) -> Deadbeat:
    return design_deadbeat(machine, settling_time=time)


def written(machine: Machine) -> Written:
    deadbeat = design_deadbeat(machine)
    controller = assemble(machine, deadbeat)
    return Written(controller, deadbeat, machine.plant, validate(machine, controller), {})


def allowed(machine: Machine, design: Written) -> dict[str, Any]:
    return on_allowed_machines(machine, design.controller, design.validation, OPTIONS, WANTED["stroke_m"])


def slowest(found: Validation) -> float:
    return max(one.settling_time for one in found.achieved)


@pytest.fixture(scope="module")
def soft() -> Written:
    return written(SOFT)


@pytest.fixture(scope="module")
def found(soft: Written) -> dict[str, Any]:
    """With a shortest settling time that leaves no room for a reference that rests sooner."""
    return remedies(SOFT, soft, WANTED, WANTED["settling_time_s"], OPTIONS, sooner)


def test_only_a_design_with_a_late_motion_needs_another(soft: Written) -> None:
    assert slowest(soft.validation) > LIMIT
    assert needed(SOFT, soft.validation, {"in_time": 10, "machines": 10})
    good = written(TABLE)
    assert not needed(TABLE, good.validation, allowed(TABLE, good))
    assert needed(TABLE, good.validation, {"in_time": 9, "machines": 10})


def test_a_feedback_that_was_made_soft_is_what_would_do(soft: Written, found: dict[str, Any]) -> None:
    best, now = found["rows"][found["best"]], allowed(SOFT, soft)
    assert best["name"] == "a PID tuned for Ms ≤ 2"
    assert best["settling_s"] <= LIMIT < slowest(soft.validation)
    assert best["in_time"] > now["in_time"]
    assert best["machines"] == now["machines"]  # the same ones
    ((_, line),) = told({"remedies": found})
    assert line.startswith("a PID tuned for Ms ≤ 2: ")


def test_who_follows_the_advice_gets_what_it_says(found: dict[str, Any], tmp_path: Path) -> None:
    """The number of elements, put into the machine file as the advice has it."""
    (row,) = (one for one in found["rows"] if "elements" in one["name"])
    given = row["how"].removesuffix(" in the machine file").removeprefix("control.")
    name, count = given.split(" = ")
    lines = [line for line in to_toml(SOFT).splitlines() if not line.startswith(name)]
    lines.insert(lines.index("[control]") + 1, f"{name} = {count}")
    file = tmp_path / "more.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    machine = load(file)
    assert machine.control.compensator_elements == int(count) != SOFT.control.compensator_elements
    judged = written(machine).validation
    assert (slowest(judged), judged.worst_dispersion) == (row["settling_s"], row["dispersion_m"])


def test_a_reference_that_rests_sooner_is_tried_where_the_thrust_allows_it(soft: Written) -> None:
    strong = replace(SOFT, drive=replace(SOFT.drive, rated_thrust=6 * SOFT.drive.rated_thrust))
    found = remedies(strong, soft, WANTED, 0.5 * WANTED["settling_time_s"], OPTIONS, sooner)
    names = [row["name"] for row in found["rows"]]
    assert "x_T* at rest after 15 ms" in names
    assert "a PID tuned for Ms ≤ 2, and x_T* at rest after 15 ms" in names
    (how,) = (row["how"] for row in found["rows"] if row["name"] == "x_T* at rest after 15 ms")
    assert how == '--settling-time "15 ms"'


def test_what_cannot_be_tried_is_said_with_its_reason(soft: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise TuningError("no PID", (), "no PID keeps to it")

    monkeypatch.setattr(module, "tune_pid", refuse)
    found = remedies(SOFT, soft, WANTED, WANTED["settling_time_s"], OPTIONS, sooner)
    assert found["refused"] == ["another PID: no PID keeps to it"]
    assert [row["name"] for row in found["rows"]] == ["a friction compensator of 10 elements"]


def test_what_saturates_or_does_not_repeat_is_no_remedy() -> None:
    good = {"settling_s": LIMIT, "in_time": 10, "machines": 10, "peak_thrust_N": 1.0, "repeats": True}
    rated = SOFT.drive.rated_thrust
    given = [{**good, "peak_thrust_N": 1.01 * rated}, {**good, "repeats": False}, {**good, "in_time": 9}]
    assert module._best(SOFT, given) == 2
    assert module._best(SOFT, given[:2]) is None


@pytest.mark.parametrize(
    ("rows", "best"),
    [
        ([], None),
        ([(1.1, 10), (0.9, 4)], None),  # late as the file has it; in time on too few
        ([(0.9, 6), (0.9, 8)], 1),
        ([(0.9, 8), (0.9, 8)], 0),  # the fewest changes come first
    ],
)
def test_the_best_is_in_time_as_the_file_has_it_and_on_most(rows: list[tuple[float, int]], best: int | None) -> None:
    given: list[Mapping[str, Any]] = [
        {"settling_s": share * LIMIT, "in_time": count, "machines": 10, "peak_thrust_N": 1.0, "repeats": True}
        for share, count in rows
    ]
    assert module._best(SOFT, given) == best  # type: ignore[arg-type]
    if best is None:
        told_none = told({"remedies": {"rows": given, "best": None}})
        assert told_none[0][1].startswith("none of the changes")
    assert told({}) == []
