"""Withheld machines: who works on them can open nothing sealed, keeps to limits, and is scored by what it achieved."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from studies.blind_trial.guard import SEALER_FOLDER
from studies.blind_trial.sealer.machines.cases import machine_of
from studies.command import BAD_INPUT, main
from studies.full_circle import scoring
from studies.full_circle.__main__ import STUDY
from studies.full_circle.benches import WORKER, benches
from studies.full_circle.trial import case_of
from studies.manifest import ROOT

QUIET = {"settling_s": 1e-3, "dispersion_m": 1e-9}


def outcome(settling: float, dispersion: float = 1e-6) -> dict[str, float]:
    return {"settling_s": settling, "dispersion_m": dispersion}


def case(before: float, after: float, truth: float, **more: Any) -> dict[str, Any]:
    return {
        "before": outcome(before),
        "after": outcome(after),
        "truth": outcome(truth),
        "tried": outcome(after),
        "beside": {},
        "noise": QUIET,
        "named": {"outcome": "attributed", "effects": ["cogging"], "equivalent": []},
        "label": {"kind": "single", "name": ["cogging"], "identifiable": True},
        "redesign": {
            "specified": {"settling_s": 50e-3},
            "unmet": ["because"],
            "designs": [
                {"taken": False},
                {"taken": True, "settling": {"low": 20e-3, "high": 30e-3}, "dispersion": {"low": 0.0, "high": 1e-6}},
            ],
        },
        **more,
    }


def test_the_share_recovered_is_of_what_the_truth_gains() -> None:
    assert scoring.recovered(case(100e-3, 40e-3, 20e-3), "after", "settling") == pytest.approx(0.75)
    assert scoring.recovered(case(100e-3, 110e-3, 20e-3), "after", "settling") == pytest.approx(-0.125)
    assert scoring.recovered(case(100e-3, 40e-3, 97e-3), "after", "settling") is None  # nothing to be gained
    assert scoring.recovered(case(100e-3, 40e-3, 20e-3), "after", "dispersion") is None
    assert scoring.recovered(case(100e-3, 40e-3, 20e-3), "pid", "settling") is None


def test_a_machine_is_worse_beyond_five_per_cent_and_noise() -> None:
    assert not scoring.is_worse(case(100e-3, 105e-3, 20e-3))
    assert scoring.is_worse(case(100e-3, 107e-3, 20e-3))
    assert scoring.is_worse(case(100e-3, 50e-3, 20e-3) | {"after": outcome(50e-3, 2e-6)})


def test_medians_have_an_interval_that_holds_the_true_one_and_rates_are_counted() -> None:
    cases = [case(100e-3, 100e-3 - 80e-3 * share, 20e-3) for share in (0.6, 0.7, 0.8, 0.9, 1.0)]
    found = scoring.shares(cases, 0)["after"]["settling"]
    assert (found["median"], found["count"]) == (pytest.approx(0.8), 5)
    assert found["low"] <= 0.7
    assert found["high"] >= 0.9
    rates = scoring.rates(cases)
    assert (rates["right_name"]["hits"], rates["worse"]["hits"], rates["inside_settling"]["tries"]) == (5, 0, 5)
    assert rates["inside_settling"]["hits"] == sum(20e-3 <= one["after"]["settling_s"] <= 31e-3 for one in cases)


def test_every_case_is_on_a_machine_of_its_own() -> None:
    assert [machine_of(case_of(number, quick=False)) for number in range(40)] == list(range(40))


def worked(task: dict[str, Any]) -> dict[str, Any]:
    """What the working process ends with."""
    done = subprocess.run(
        list(WORKER), input=json.dumps(task) + "\n", capture_output=True, text=True, cwd=ROOT, check=True
    )
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])["done"]
    return told


def test_who_works_on_a_machine_and_looks_at_what_is_sealed_has_no_answer(tmp_path: Path) -> None:
    """Planted: its nominal file is a link into the sealer's folder, or its truth."""
    key = tmp_path / "truth.json"
    key.write_text('{"label": "cogging"}', encoding="utf-8")
    limits = {"distance": 1.0, "speed": 1.0, "feedforward": 1.0, "machine_time": 90.0}
    for file in (SEALER_FOLDER / "nominal.json", key):
        link = tmp_path / f"link-{file.stem}.json"
        link.symlink_to(file)
        task = {"forbidden": [str(SEALER_FOLDER), str(key)], "nominal": str(link), "limits": limits, "seed": 0,
                "quick": True, "folder": str(tmp_path)}  # fmt: skip
        told = worked(task)
        assert told["failed"].startswith(("refused: open", "PermissionError")), told
        assert "cogging" not in json.dumps(told)


def test_a_request_beyond_the_limits_is_not_run_whoever_asks(tmp_path: Path) -> None:
    """Planted: a table that ignores what the machine allows, and benches without end."""
    rows = "\n".join(f"{k * 1.6e-3:.9g},{k},{k},0" for k in range(200))
    far = tmp_path / "far.csv"
    far.write_text(f"time_s,target_m,reference_m,feedforward_N\n{rows}\n", encoding="utf-8")
    with benches("0 6", tmp_path / "work") as found:
        main_bench = found.of("main")
        assert main_bench.nominal is not None
        told = found.run({"bench": "main", "table": str(far), "controller": None}, 1.6e-3)
        assert "distance" in told["refused"]
        assert main_bench.left.records == main_bench.limits.records
        with pytest.raises(ValueError, match="there is no bench"):
            found.of("../elsewhere")


def test_answers_that_were_changed_after_they_were_committed_stop_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a run in which nobody works: the working is put in place."""
    monkeypatch.setattr("studies.full_circle.trial._worked", lambda *_: {"failed": "nobody works here"})
    given = ["--cases", "2", "--no-report", "--output", str(tmp_path / "out")]
    main(STUDY, given)
    steps = tmp_path / "out" / "sealed" / "steps" / "machine-001.json"
    steps.write_text(steps.read_text(encoding="utf-8").replace("nobody works", "all is well"), encoding="utf-8")
    capsys.readouterr()
    assert main(STUDY, given) == BAD_INPUT
    assert "machine-001 is not the one that was committed" in capsys.readouterr().err
