"""How many modes: on axes of an independent simulator, and on what only looks like a mode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.identification import modes
from models.identification.estimate import Estimate
from models.identification.joint.agreement import spanned
from models.identification.modal.fitting import trend, with_mode
from models.identification.modal.order import SAME_MODE_DISTANCE, Candidate, _sound, faults, fitted
from models.identification.modal.problem import Structure, problem_of
from models.identification.modal.remarks import ResponseStep, on_disagreement, on_one_alone, on_response
from models.identification.pipeline import identify
from models.identification.response import FrequencyResponse
from models.machine import load
from models.records.files import Loaded
from studies.identify_machine.shown import warnings_of
from tests.coverage.axis import Axis, drawn
from tests.coverage.records import first_file
from tests.coverage.trial import by_parameter, refused, tried

# 12 kg, one mode, a current loop of 1.1 kHz and 12 N s/m.
AXIS = replace(
    drawn(1, 1), mass=12.0, drag=12.0, lag=1 / (2 * np.pi * 1100), dead_time=325e-6, gain=np.array([0.011]),
    frequency=np.array([140.0]), damping=np.array([0.018]),
)  # fmt: skip


def measured(
    axis: Axis, seed: int, noise: float = 1e-3, *, lines: int = 150, rolling: bool = True
) -> FrequencyResponse:
    """Its response at so many lines with relative noise of that deviation, which is stated."""
    draw = np.random.default_rng(seed)
    f = np.geomspace(4, 500, lines)
    p = axis.response(f)
    scatter = draw.standard_normal((2, f.size)) * noise / np.sqrt(2)
    p_noisy = np.asarray(p * (1 + scatter[0] + 1j * scatter[1]), complex)
    return FrequencyResponse(f, p_noisy, (noise * np.abs(p)) ** 2, np.ones(f.size), 0.0, rolling)


def test_lag_and_drag_are_not_explained_by_modes() -> None:
    fit = modes.fit(measured(AXIS, 1))
    assert len(fit.plant.modes) == 2
    truth = {
        "rigid body gain": 1 / 12.0, "dead time": 325e-6, modes.LAG: AXIS.lag, modes.DRAG: 12.0,
        "mode 2 gain": 0.011, "mode 2 frequency": 140.0, "mode 2 damping": 0.018,
    }  # fmt: skip
    assert set(fit.estimate.names) == set(truth)
    for name, value in truth.items():
        assert abs(fit.estimate.value(name) - value) < 4 * fit.estimate.deviation(name), name
    assert 0.7 < fit.chi_square < 1.3
    stable = [bool(np.any(np.abs(one.triples[:, 1] / 140.0 - 1) < SAME_MODE_DISTANCE)) for one in fit.orders]
    assert stable == [False, *[True] * (len(fit.orders) - 1)]
    assert min(fit.worth, key=lambda part: part[1])[1] > 10


def test_what_the_lines_do_not_show_is_not_in_the_model() -> None:
    """The same axis where the noise hides lag and drag: what lags is late."""
    fit = modes.fit(measured(AXIS, 2, noise=0.2))
    assert (fit.lag, fit.drag, len(fit.plant.modes)) == (0.0, 0.0, 2)
    assert fit.plant.dead_time == pytest.approx(325e-6 + AXIS.lag, abs=4 * fit.estimate.deviation("dead time"))


def errors(axis: Axis, noise: float) -> dict[str, float]:
    """The rms error of rigid body and mode over 20 records whose lag, if any, is not found, in stated deviations."""
    truth, found = {"rigid body gain": 1 / 12.0, "mode 2 gain": 0.011}, dict[str, list[float]]()
    for seed in range(20):
        fit = modes.fit(measured(axis, seed, noise))
        for name, value in truth.items() if fit.lag == 0 and len(fit.plant.modes) == 2 else ():
            found.setdefault(name, []).append((fit.estimate.value(name) - value) / fit.estimate.deviation(name))
    assert all(len(one) >= 10 for one in found.values())
    return {name: float(np.sqrt(np.mean(np.square(one)))) for name, one in found.items()}


def test_deviations_allow_for_a_lag_that_is_not_worth_its_parameter() -> None:
    """Without that the gain of the rigid body was off by 2.1 of its deviations (rms), beside a lag that 10 % of noise
    hides; where there is none, deviations stay as the fit has them."""
    hidden = errors(replace(AXIS, drag=0.0), 0.1)
    assert max(hidden.values()) < 1.4
    none = errors(replace(AXIS, lag=0.0, drag=0.0), 0.1)
    assert min(none.values()) > 0.5


@pytest.mark.parametrize("ratio", [-1.0, 0.5, 1.5, 2.8])
def test_a_mode_that_is_larger_than_the_rigid_body_leaves_the_low_lines_of_use(ratio: float) -> None:
    """The motor of a belt axis sees a mode of m2/m1 times the rigid body's gain, the carriage over the rotor: no line
    of such a response was taken, with "friction bends the whole response", which has none."""
    belt = replace(AXIS, lag=0.0, drag=0.0, gain=np.array([ratio / 12.0]), frequency=np.array([38.0]))
    fit = modes.fit(measured(belt, 1, rolling=False))
    assert np.all(fit.used)
    assert fit.estimate.value("mode 2 gain") == pytest.approx(ratio / 12.0, rel=2e-3)


def test_an_order_that_loses_its_modes_with_what_is_none_gives_way_to_one_that_has_them() -> None:
    """A multisine on a telescope in the wind: the order with the best criterion had five modes, none of them seen
    beside the others, and without these a rigid body was left, where two modes alone were as good as none better."""
    one = measured(replace(AXIS, lag=0.0), 1)
    problem = problem_of([one], [np.ones(one.frequency.size, bool)])
    structure = Structure()
    rigid = fitted(problem, structure, trend(structure, problem))
    right = fitted(problem, structure, with_mode(rigid.theta, structure, problem))
    theta = np.concatenate([rigid.theta, [1e-6, np.log(7e3), np.log(0.01)], [1e-6, np.log(9e3), np.log(0.01)]])
    many = Candidate(structure, theta, np.eye(theta.size), 0.5 * right.cost)  # as good, by what is no mode
    assert [bool(fault) for fault in faults(problem, many)] == [True, True]
    orders = [rigid, right, many]
    found = _sound(problem, orders, [faults(problem, one) for one in orders], 1.0)
    assert found.triples[:, 1] == pytest.approx([140.0], rel=1e-3)


def test_a_lag_that_only_all_lines_together_show_is_found() -> None:
    """Of 6,000 lines, 600 decide how many modes there are; on as few the same lag can't be told from dead time."""
    quick = replace(AXIS, lag=AXIS.lag / 3)
    few, all_lines = (modes.fit(measured(quick, 4, noise=0.04, lines=n)) for n in (600, 6000))
    assert modes.LAG not in few.estimate.names
    assert modes.LAG in all_lines.estimate.names
    assert all_lines.lag == pytest.approx(quick.lag, abs=4 * all_lines.estimate.deviation(modes.LAG))
    assert [name for name, _ in all_lines.worth] == ["mode 0", "lag"] + ["drag"] * (all_lines.drag > 0)


def test_a_mode_that_moves_the_scale_as_far_as_the_rigid_body_but_against_it_is_found() -> None:
    """A belt between motor and scale, from a sweep that begins within its mode's slopes: from a start without a mode
    the search ends at a dead time of 26 ms."""
    belt = replace(
        AXIS, mass=14.0, drag=30.0, lag=0.6e-3, dead_time=1.6e-3, gain=np.array([-0.0697, -0.00094]),
        frequency=np.array([38.0, 160.0]), damping=np.array([0.036, 0.02]),
    )  # fmt: skip
    f, ts, draw = np.arange(7.0, 200.0, 0.05), 1e-3, np.random.default_rng(1)
    p = belt.response(f) * np.sinc(f * ts) * np.exp(-1j * np.pi * f * ts)  # held; what folds down is below the noise
    size = 0.008 * np.abs(p) * np.maximum(f / 60, 1) ** 3
    noise = size * (draw.standard_normal(f.size) + 1j * draw.standard_normal(f.size)) / np.sqrt(2)
    command = np.exp(3j * np.pi * np.arange(f.size) ** 2 / f.size)
    fit = modes.fit(FrequencyResponse(f, p + noise, size**2, np.ones(f.size), ts, rolling=True, command=command))
    truth = [1 / 14.0, 1.6e-3, 0.6e-3, 30.0, -0.0697, 38.0, 0.036, -0.00094, 160.0, 0.02]
    assert np.all(np.abs(fit.estimate.values - truth) < 4 * fit.estimate.deviations)
    assert fit.chi_square < 1.2


def test_a_number_that_is_asked_for_is_given() -> None:
    for count in (0, 2):
        fit = modes.fit(measured(AXIS, 1), count=count)
        assert len(fit.plant.modes) == count + 1


def test_a_dead_time_below_none_is_said() -> None:
    early = replace(AXIS, dead_time=-100e-6, lag=0.0)
    fit = modes.fit(measured(early, 3))
    assert fit.plant.dead_time == 0.0
    assert fit.early == pytest.approx(-100e-6, rel=0.1)
    assert any("was negative (-" in text and "was set to 0" in text for text in on_response(fit, measured(early, 3)))


def test_responses_of_one_axis_are_one_machine() -> None:
    steps = [ResponseStep(one, modes.fit(one)) for one in (measured(AXIS, 1), measured(AXIS, 2))]
    both = modes.fit_together([one.measured for one in steps], [one.fit.used for one in steps])
    assert both.estimate.names == steps[0].fit.estimate.names
    assert np.all(both.estimate.deviations < 0.85 * steps[0].fit.estimate.deviations)
    assert list(on_disagreement(["a", "b"], steps)) == []


def test_responses_that_disagree_are_named_with_parameter_and_cause() -> None:
    """A mode that is 0.5 Hz lower when it is excited with four times the force."""
    lower = replace(AXIS, frequency=np.array([139.5]))
    levels = (4.0, 16.0)
    steps = [
        ResponseStep(one, modes.fit(one), level=level)
        for one, level in zip((measured(AXIS, 1), measured(lower, 2)), levels, strict=True)
    ]
    said = list(on_disagreement(["a", "b"], steps))
    assert [text.split(",")[0] for text in said] == ["a and b disagree in the mode 2 frequency"]
    assert "depends on the amplitude" in said[0]
    joint = modes.fit_together([one.measured for one in steps], [one.fit.used for one in steps])
    wide = spanned(joint, [*steps]).estimate
    assert np.array_equal(wide.values, joint.estimate.values)
    frequency = wide.value("mode 2 frequency")
    for step in steps:
        assert abs(step.estimate.value("mode 2 frequency") - frequency) <= wide.deviation("mode 2 frequency")
    assert wide.deviation("dead time") == joint.estimate.deviation("dead time")
    assert np.all(np.linalg.eigvalsh(wide.correlation) > -1e-9)


def test_what_one_response_alone_shows_is_told_beside_that_of_all() -> None:
    """A user's sweep showed a drag of 419 N s/m; the machine file had 77 +- 16 from all of them, without a word."""
    steps = [ResponseStep(one, modes.fit(one)) for one in (measured(AXIS, 1), measured(AXIS, 2))]
    estimates = [_with_drag(steps[0].estimate, *drag) for drag in ((419.0, 15.0), (77.0, 16.0))]
    alone = [replace(steps[0], fit=replace(steps[0].fit, estimate=estimates[0])), _without_drag(steps[1])]
    (said,) = on_one_alone(["a", "b"], alone, estimates[1])
    assert said.startswith("a alone shows a viscous friction of 419 N s/m, and the fit to all together one of 77 N s/m")
    joint = replace(steps[0].fit, estimate=estimates[1])
    assert spanned(joint, alone).estimate.deviation(modes.DRAG) == pytest.approx(342.0)


def _with_drag(estimate: Estimate, size: float, std: float) -> Estimate:
    """The estimate with another drag [N s/m]."""
    place = estimate.names.index(modes.DRAG)
    values, covariance = estimate.values.copy(), estimate.covariance.copy()
    values[place], covariance[place], covariance[:, place] = size, 0.0, 0.0
    covariance[place, place] = std**2
    return replace(estimate, values=values, covariance=covariance)


def _without_drag(step: ResponseStep) -> ResponseStep:
    """The step as of a response that shows no drag."""
    estimate = step.estimate
    kept = [i for i, name in enumerate(estimate.names) if name != modes.DRAG]
    fewer = Estimate(
        tuple(estimate.names[i] for i in kept),
        tuple(estimate.units[i] for i in kept),
        estimate.values[kept],
        estimate.covariance[np.ix_(kept, kept)],
    )
    return replace(step, fit=replace(step.fit, estimate=fewer))


def test_a_response_that_no_plant_fits_does_not_move_that_of_another() -> None:
    """As of a gantry one side of which turned under a strong sweep: pooled, its mass had been 33 deviations off."""
    good = measured(AXIS, 1)
    bend = 1 + 0.1 * np.sin(9 * np.log(good.frequency)) * np.exp(0.3j)
    shaken = replace(measured(AXIS, 2), response=measured(AXIS, 2).response * bend)
    given = [Loaded(name, "12ab", one, (), ()) for name, one in (("shaken.csv", shaken), ("good.csv", good))]
    alone, both, bad = identify(load(), given[1:]), identify(load(), given), identify(load(), given[:1])
    assert both.machine.plant == alone.machine.plant != bad.machine.plant
    assert any("no rigid body with modes fits shaken.csv, which is left out" in said for said in both.remarks)
    (name, said), *more = warnings_of(both)
    assert (name, more) == ("shaken.csv", [])
    assert said.startswith("No rigid body with modes fits the response (reduced chi-square ")
    assert [name for name, _ in warnings_of(bad)] == ["shaken.csv"]
    assert not warnings_of(alone)


def test_a_sub_sample_of_the_coverage_trial() -> None:
    """`python -m tests.coverage` runs all of it; these axes have 0 to 4 modes, two of them in
    anti-phase, lag and drag, a cascade and a PID."""
    results = [tried(seed, "multisine") for seed in (5, 11, 12, 18, 29)]
    assert [one.found for one in results] == [one.there for one in results] == [0, 1, 2, 3, 4]
    assert [one.refusal for one in results] == [""] * 5
    pulls = np.concatenate(list(by_parameter(results).values()))
    assert 0.6 < np.sqrt(np.mean(pulls**2)) < 1.4
    assert np.mean(np.abs(pulls) < 1.96) > 0.88


def test_a_file_that_a_later_study_refuses_is_seen() -> None:
    """A mass of which friction takes all thrust; the same axis as it is passes."""
    machine = first_file(drawn(3, 3))
    assert refused(machine) == ""
    weak = replace(machine, drive=replace(machine.drive, rated_thrust=0.5 * machine.friction.coulomb_force))
    assert "friction takes" in refused(weak)


def test_a_mode_that_a_lag_makes_up_for_in_part_is_one() -> None:
    """Of a stepper on a screw, whose mode is as large as its rigid body, a lag left the residue uncertain by more than
    a third of it; so two sweeps together had no mode, where each had it and the whole fit needs it."""
    axis = replace(AXIS, lag=0.0)
    one = measured(axis, 3)
    problem = problem_of([one], [np.ones(one.frequency.size, bool)])
    structure = Structure()
    right = fitted(
        problem, structure, with_mode(fitted(problem, structure, trend(structure, problem)).theta, structure, problem)
    )
    unsure = replace(right, covariance=right.covariance * 1e8)
    assert unsure.triples[0, 0] < 3 * unsure.deviation(structure.before)
    assert faults(problem, unsure) == ("",)
    tiny = np.concatenate([right.theta, [1e-6, np.log(90.0), np.log(0.05)]])
    both = fitted(problem, structure, tiny)
    assert [bool(fault) for fault in faults(problem, both)] == [False, True]
