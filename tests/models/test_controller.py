"""The sampled 2DoF law against the transfer functions that it stands for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from models.controller import PID, Controller, ControllerError, load, references, to_json
from models.feedback.forms import NO_FILTERS, law_of
from models.friction import elements, follow
from models.simulation.kernel import pid_step

TS = 5e-4
GAINS = PID(1.9e6, 7.8e7, 1.05e4, 2e-4)


def test_the_pid_is_its_transfer_function() -> None:
    """C(z) = kp + ki T_s / (1 - z^-1) + kd (1 - a) (1 - z^-1) / (T_s (1 - a z^-1))."""
    error = np.random.default_rng(0).standard_normal(300) * 1e-6
    a = GAINS.derivative_filter / (GAINS.derivative_filter + TS)
    expected = GAINS.kp * error + lfilter([GAINS.ki * TS], [1, -1], error)
    expected += lfilter(GAINS.kd * (1 - a) / TS * np.array([1, -1]), [1, -a], error)
    gains = np.array([GAINS.kp, GAINS.ki, GAINS.kd, GAINS.derivative_filter])
    integral = slope = previous = 0.0
    command = []
    for e in error:
        u, integral, slope = pid_step(e, previous, integral, slope, gains, TS)
        previous = e
        command.append(u)
    assert np.array(command) == pytest.approx(expected, rel=1e-10)
    assert GAINS.pole(TS) == a
    assert PID(1.0, 0.0, 0.0, 0.0).pole(TS) == 0.0


def test_references_are_the_filters_responses_and_keep_the_friction_history() -> None:
    rfm = elements([8e5, 1e5], [5e-6, 5e-5])
    controller = Controller(TS, GAINS, 2, (0.0, 0.25, 0.75), (3.0, -1.0, -2.0), rfm)
    target = np.repeat([1e-5, 2e-5, 0.0], 4)
    given = references(controller, target)
    assert given.position[:4] == pytest.approx([0, 0.25e-5, 1e-5, 1e-5])
    assert given.feedforward[:4] == pytest.approx([3e-5, 2e-5, 0, 0])
    assert given.position[4:8] == pytest.approx([1e-5, 1.25e-5, 2e-5, 2e-5])
    assert given.compensation == pytest.approx(follow(rfm, given.position)[0])
    assert not np.any(references(controller.without_compensation(), target).compensation)


def test_a_controller_file_comes_back_as_it_was(tmp_path: Path) -> None:
    controller = Controller(TS, GAINS, 2, (0.0, 0.25, 0.75), (3.0, -1.0, -2.0), elements([8e5, 1e5], [5e-6, 5e-5]))
    path = tmp_path / "controller.json"
    for one in (controller, controller.without_compensation()):
        path.write_text(json.dumps(to_json(one, 20e-6, 20e-3)), encoding="utf-8")
        assert load(path) == one


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"kp_N_per_m"', '"kp"', "kp_N_per_m is missing"),
        ("1900000.0", "NaN", "not finite"),
        ("1900000.0", "-1.0", "negative"),
        ('"sample_time_s": 0.0005', '"sample_time_s": 0', "sample_time_s must be above 0"),
        ("{", "[", "is not valid JSON"),
    ],
)
def test_a_wrong_controller_file_is_said(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = json.dumps(to_json(Controller(TS, GAINS, 2, (0.0, 1.0), (3.0, -3.0)), 20e-6, 20e-3))
    assert old in text
    path = tmp_path / "controller.json"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ControllerError, match=says):
        load(path)
    with pytest.raises(ControllerError, match="can't be read"):
        load(tmp_path / "nowhere.json")


def test_weights_run_with_their_law_or_not_at_all(tmp_path: Path) -> None:
    """Of a PID alone the error is all that the simulator, a file and a drive's code look at."""
    weighted = replace(GAINS, proportional_weight=0.5)
    with pytest.raises(ValueError, match="set-point weights other than 1 make another law"):
        Controller(TS, weighted, 2, (0.0, 1.0), (3.0, -3.0))
    law = law_of(weighted, NO_FILTERS, 0.0, TS)
    content = to_json(Controller(TS, weighted, 2, (0.0, 1.0), (3.0, -3.0), law=law), 20e-6, 20e-3)
    path = tmp_path / "controller.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    assert load(path).feedback == law
    del content["law"]
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ControllerError, match="set-point weights other than 1 make another law"):
        load(path)
