"""A diagnosis that asks for its records: the course of it, with the diagnosis itself replaced by a script."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.experiments import active
from diagnosis.experiments.active import Budget, NotRun, ask, to_json
from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.information import ExperimentInformation, information_of
from diagnosis.experiments.look import Found
from diagnosis.experiments.policy import Knowledge, Stop
from diagnosis.experiments.schedules import Schedule
from diagnosis.experiments.within_limits import Bounds, experiments
from diagnosis.verdict import Outcome
from models.machine import load
from models.records.record import Record

BUDGET = Budget(Bounds(0.05, 0.3, 100.0), 30.0, 4)
MACHINE = load()
NAMES = ("cogging", "viscous_friction", "play")


def answer(outcome: Outcome, *names: str) -> Any:
    return SimpleNamespace(found=Found(outcome, names, (), dict.fromkeys(names, 1e6)))


NOTHING, COGGING = answer(Outcome.NOTHING), answer(Outcome.ATTRIBUTED, "cogging")


@pytest.fixture(scope="module")
def menu() -> tuple[ExperimentInformation, ...]:
    """What the experiments tell about three effects, computed once."""
    return information_of(MACHINE, experiments(MACHINE, BUDGET.bounds), NAMES)


@pytest.fixture
def script(menu: tuple[ExperimentInformation, ...], monkeypatch: pytest.MonkeyPatch) -> Any:
    """Lets the looks give these answers, one after another, and each test of a name this e-value."""

    def prepared(answers: Sequence[Any], gain: float) -> None:
        left = list(answers)
        monkeypatch.setattr(active, "information_of", lambda *_: menu)
        monkeypatch.setattr(active, "names_of", lambda *_: NAMES)
        monkeypatch.setattr(active, "refit_and_null", lambda _machine, records, **_: SimpleNamespace(nominal=records))
        monkeypatch.setattr(active, "told_by", lambda _fitted, records, names, _sizes: told(records, names))
        monkeypatch.setattr(active, "look", lambda *_, **__: left.pop(0) if len(left) > 1 else left[0])

        def tested(before: Any, _now: Any, process: EProcess) -> EProcess:
            return process.after(gain, dict.fromkeys(before.found.names, gain)) if before.found.names else process

        monkeypatch.setattr(active, "tested", tested)

    return prepared


def told(records: Sequence[Record], names: Sequence[str]) -> np.ndarray:
    """That records which there were show the last effect plainly, and tell nothing else."""
    return 1e4 * len(records) * np.diag(np.arange(len(names)) == len(names) - 1)


class Bench:
    """A machine that follows exactly, or trips in its first runs, or refuses them."""

    def __init__(self, failing: int = 0, *, refuses: bool = False) -> None:
        self.asked: list[Schedule] = []
        self.failing, self.refuses = failing, refuses

    def run(self, references: Schedule) -> Record | NotRun:
        self.asked.append(references)
        if len(self.asked) <= self.failing:
            return NotRun("the door is open", spent=False) if self.refuses else NotRun("tripped", spent=True)
        given = references.given
        force = given.feedforward
        return Record(MACHINE.sample_time, references.target, given.position, force, force, given.position)

    @property
    def seconds(self) -> float:
        return sum(one.target.size for one in self.asked) * MACHINE.sample_time


def test_it_begins_with_the_own_test_and_ends_when_a_name_is_confirmed(script: Any) -> None:
    script([NOTHING, COGGING, COGGING], 40.0)
    bench = Bench()
    found = ask(MACHINE, bench.run, BUDGET)
    assert bench.asked[0].name == "own test"
    assert (found.stop, found.names, len(found.records)) == (Stop.NAMED, ("cogging",), 3)
    assert bench.seconds < BUDGET.seconds
    shown = to_json(found)
    assert [look["after"]["outcome"] for look in shown["looks"]] == ["nothing_to_explain", "attributed", "attributed"]
    assert [look["log10_e_value"] > np.log10(shown["needed"]) for look in shown["looks"]] == [False, False, True]
    assert shown["seconds"] == pytest.approx(bench.seconds)


@pytest.mark.parametrize(("answers", "stop"), [([NOTHING], Stop.NOTHING), ([COGGING], Stop.CANNOT_TELL)])
def test_it_takes_no_more_than_its_budget_and_gives_no_name_that_is_not_sure(
    answers: list[Any], stop: Stop, script: Any
) -> None:
    script(answers, 0.0)
    bench = Bench()
    found = ask(MACHINE, bench.run, BUDGET)
    assert (found.stop, found.names) == (stop, ())
    assert bench.seconds <= BUDGET.seconds
    assert len(bench.asked) <= BUDGET.records
    assert all(BUDGET.bounds.keep(one, MACHINE.sample_time) for one in bench.asked)


def test_what_the_machine_does_not_run_is_told_paid_for_and_not_asked_again(script: Any) -> None:
    script([NOTHING], 0.0)
    bench = Bench(failing=2)
    found = ask(MACHINE, bench.run, BUDGET)
    assert [look.failed for look in found.steps[:3]] == ["tripped", "tripped", ""]
    assert len({one.name for one in bench.asked[:3]}) == 3
    assert len(bench.asked) <= BUDGET.records
    assert found.stop is Stop.NOTHING


def test_a_machine_that_runs_nothing_cannot_tell(script: Any) -> None:
    script([NOTHING], 0.0)
    found = ask(MACHINE, Bench(failing=99).run, BUDGET)
    assert (found.stop, found.last) == (Stop.CANNOT_TELL, None)
    assert found.reason == "nothing that stays within the limits was run; the machine said: tripped"
    assert to_json(found)["seconds"] == pytest.approx(sum(one.seconds for one in found.steps))


def test_what_is_refused_costs_nothing(script: Any) -> None:
    script([NOTHING], 0.0)
    refused = ask(MACHINE, Bench(failing=99, refuses=True).run, BUDGET)
    assert (refused.stop, to_json(refused)["seconds"]) == (Stop.CANNOT_TELL, 0.0)
    assert refused.reason.endswith("the machine said: the door is open")
    bench = Bench(failing=1, refuses=True)
    found = ask(MACHINE, bench.run, BUDGET)
    assert [look.seconds > 0 for look in found.steps[:2]] == [False, True]
    assert len(found.records) == len(bench.asked) - 1


def test_records_that_there_are_come_first_and_cost_nothing(script: Any) -> None:
    script([COGGING, COGGING], 40.0)
    bench = Bench()
    had = Bench().run(experiments(MACHINE, BUDGET.bounds)[0].schedule)
    assert isinstance(had, Record)
    found = ask(MACHINE, bench.run, BUDGET, have=[had])
    assert found.steps[0].seconds == 0.0
    assert bench.asked[0].name != "own test"
    assert found.records[0] is had


def test_what_records_that_there_are_told_is_known_when_the_first_is_chosen(script: Any) -> None:
    script([NOTHING], 0.0)
    seen = []

    def none(known: Knowledge) -> None:
        seen.append(known)

    had = Bench().run(experiments(MACHINE, BUDGET.bounds)[0].schedule)
    assert isinstance(had, Record)
    found = ask(MACHINE, Bench().run, BUDGET, have=[had], choose=none)
    assert found.hidden == NAMES[:-1]
    np.testing.assert_array_equal(seen[0].distance, told([had], NAMES))
