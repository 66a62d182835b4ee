"""The friction effects along given paths: each does what its equation says, and keeps what physics asks of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.effects.base import Effect
from models.effects.catalogue import every
from models.effects.friction_laws import FORGOTTEN, STILL_TIME
from models.machine import load
from models.simulation.effect_kernel import Path, replay
from tests.models.effects.paths import TS, Array, make, steady, through

FRICTION = load().friction
COULOMB = FRICTION.coulomb_force
SLIDE = np.linspace(0.0, 4e-4, 41)  # well beyond the presliding region
MOVES = st.lists(st.floats(-4e-5, 4e-5), min_size=3, max_size=30)


def test_the_equations_state_the_constants_that_the_laws_have() -> None:
    directional, healing = (every()[name].equation for name in ("directional_friction", "dwell_breakaway"))
    assert rf"\tau_0={1e3 * FORGOTTEN:g}\,\mathrm{{ms}}" in directional
    assert rf"v_0=\lambda/{1e3 * STILL_TIME:g}\,\mathrm{{ms}}" in healing


def rubbing(path: Path, *effects: Effect) -> Array:
    return replay(FRICTION, effects, path, 0.0).friction


@given(
    MOVES,
    st.sampled_from(
        [("play", 1e-6), ("directional_friction", 0.07, 2e-6, 0.0), ("position_dependent_friction", 0.1, 3e-3, 2.0)]
    ),
    st.floats(0.1, 10),
)
def test_laws_without_a_time_constant_are_independent_of_the_rate(
    moves: list[float], law: tuple[str, *tuple[float]], pace: float
) -> None:
    points, effect = np.cumsum([0.0, *moves]), make(*law)
    usual, slow = through(points), through(points, sample_time=TS * pace)
    assert np.array_equal(rubbing(usual, effect), rubbing(slow, effect))


@pytest.mark.parametrize(
    "law",
    [
        ("friction_relaxation", 0.2, 0.1, 1.0),
        ("dwell_breakaway", 0.2, 0.1, 3e-6),
        ("viscous_friction", 50.0),
        ("stribeck", 0.2, 1e-2),
        ("velocity_strengthening", 0.2, 1e-3),
        ("directional_friction", 0.07, 2e-4, 1.0),
        ("frictional_lag", 1e-3),
        ("friction_drift", 5e-3),
    ],
)
def test_laws_with_a_time_constant_depend_on_the_rate(law: tuple[str, *tuple[float]]) -> None:
    effect = make(*law)
    usual, slow = through(SLIDE), through(SLIDE, sample_time=3 * TS)
    assert np.max(np.abs(rubbing(usual, effect) - rubbing(slow, effect))) > 1e-3


@pytest.mark.parametrize("name", [name for name, kind in every().items() if kind.family == "friction"])
@pytest.mark.parametrize("speed", [0.02, 0.1])
def test_what_an_effect_states_of_drag_and_direction_is_what_its_law_does(name: str, speed: float) -> None:
    """What it states of neither it may still do in another form, but no effect states what its law does not do."""
    effect = every()[name].typical()
    (part, further), drag = effect.larger_forwards(), effect.viscous_drag()
    forwards, backwards = (float(rubbing(steady(way, 400), effect)[-1, -1]) for way in (speed, -speed))
    if part or further:
        assert forwards + backwards == pytest.approx(2 * (part * COULOMB + further * speed))
    if drag:
        assert forwards - backwards == pytest.approx(2 * (COULOMB + drag * speed))
    assert bool(part or further) == (name == "directional_friction")
    assert bool(drag) == (name == "viscous_friction")


@given(st.floats(0.05, 0.3), st.floats(0.05, 1.0))
def test_relaxation_decays_by_its_part_with_its_time(part: float, time: float) -> None:
    """Slipped to the end in no time, then held: (1 - b) T_fc + b T_fc exp(-t / tau)."""
    held = through(np.concatenate([[0.0], np.full(2000, 1e-3)]), parts=2)
    force = rubbing(held, make("friction_relaxation", part, time, 1.0))[1:].ravel()  # its first is where the slip ends
    decayed = COULOMB * (1 - part + part * np.exp(-np.arange(force.size) * TS / 2 / time))
    assert np.max(np.abs(force - decayed)) < 1e-9


def test_relaxation_of_no_time_to_leak_is_the_nominal_friction() -> None:
    path = through(np.cumsum(2e-5 * np.sin(np.arange(100.0))))
    assert rubbing(path, make("friction_relaxation", 0.3, 1e9, 1.0)) == pytest.approx(rubbing(path), abs=1e-6)


@given(st.floats(0.02, 0.3), st.floats(0.1, 2.0), st.floats(1e-6, 1e-5), st.floats(0.01, 0.3))
def test_a_rest_lets_contacts_hold_more_until_they_have_moved(
    a: float, time: float, length: float, rest: float
) -> None:
    """T_fc (1 + a (1 - exp(-t_r / tau))) behind a rest, less by exp(-s / lambda) after a fast move by s."""
    halt = round(rest / TS)
    fast = 1e-4 * np.arange(1, 4)  # 200 mm/s: no time to heal
    path = through(np.concatenate([np.zeros(halt + 1), fast]), parts=200)
    force = rubbing(path, make("dwell_breakaway", a, time, length))[halt:].ravel()
    s = 1e-4 / 200 * (np.arange(force.size) + 0.5)
    theta = (1 - math.exp(-halt * TS / time)) * np.exp(-s / length)
    sliding = slice(200, 600)
    assert force[sliding] == pytest.approx(COULOMB * (1 + a * theta[sliding]), rel=1e-3)
    early = rubbing(
        through(np.concatenate([np.zeros(halt + 1), [1e-6]]), parts=40), make("dwell_breakaway", a, time, length)
    )
    assert early[halt, -1] >= rubbing(through([0.0, 1e-6], parts=40))[0, -1] * (1 - 1e-12)


def test_contacts_do_not_heal_while_they_move() -> None:
    slid = rubbing(steady(0.02, 400), make("dwell_breakaway", 0.3, 0.1, 1e-6))
    assert slid[-1, -1] == pytest.approx(COULOMB, rel=1e-3)


@given(st.floats(-0.2, 0.2), st.floats(0, 100))
def test_viscous_friction_is_proportional_to_speed(speed: float, coefficient: float) -> None:
    path = steady(speed, 20)
    assert rubbing(path, make("viscous_friction", coefficient)) == pytest.approx(rubbing(path) + coefficient * speed)


@given(st.floats(1e-4, 0.1), st.floats(0.05, 0.3), st.floats(5e-4, 5e-3))
def test_stribeck_falls_with_speed(speed: float, rise: float, over: float) -> None:
    force = rubbing(steady(speed, 1 + math.ceil(4e-4 / speed / TS)), make("stribeck", rise, over))
    assert force[-1, -1] == pytest.approx(COULOMB * (1 + rise * math.exp(-((speed / over) ** 2))))


@given(st.floats(1e-3, 0.1), st.floats(0.02, 0.5), st.floats(1e-4, 1e-2))
def test_velocity_strengthening_grows_with_the_logarithm_of_speed(speed: float, rise: float, over: float) -> None:
    """By the same force with each e-fold of a speed far above v_0, and by none at rest."""
    effect = make("velocity_strengthening", rise, over)
    force = rubbing(steady(speed, 1 + math.ceil(2e-3 / speed / TS)), effect)[-1, -1]
    assert force == pytest.approx(COULOMB * (1 + 0.5 * rise * math.log(1 + (speed / over) ** 2)))
    fast = [rubbing(steady(v, 1 + math.ceil(4e-3 / v / TS)), effect)[-1, -1] for v in (100 * over, 100 * math.e * over)]
    assert fast[1] - fast[0] == pytest.approx(rise * COULOMB, rel=1e-3)


@given(st.floats(-0.1, 0.1), st.floats(5e-7, 5e-6), st.sampled_from([0.0, 1.0]))
def test_directional_friction_differs_by_direction_and_never_jumps(
    asymmetry: float, distance: float, forgets: float
) -> None:
    effect = make("directional_friction", asymmetry, distance, forgets)
    there = rubbing(through(SLIDE), effect)
    back = rubbing(through(-SLIDE), effect)
    assert there[-2, -1] == pytest.approx(COULOMB * (1 + asymmetry))  # the last sample rests
    assert back[-2, -1] == pytest.approx(-COULOMB * (1 - asymmetry))
    turning = rubbing(through(np.concatenate([SLIDE, SLIDE[-1] - SLIDE]), parts=50), effect).ravel()
    stiffest = (1 + abs(asymmetry)) * sum(FRICTION.stiffness) + abs(asymmetry) * COULOMB / distance
    assert np.max(np.abs(np.diff(turning))) <= stiffest * SLIDE[1] / 50 * (1 + 1e-9)


@given(st.floats(-0.1, 0.1), st.floats(5e-7, 5e-6))
def test_the_direction_turns_over_twice_its_distance(asymmetry: float, distance: float) -> None:
    """Behind a reversal the factor falls from 1 + a to 1 - a in proportion to the way, whatever the force does."""
    path = through(np.concatenate([SLIDE, SLIDE[-1] - SLIDE]), parts=200)
    back = slice(200 * SLIDE.size, None)
    ratio = (rubbing(path, make("directional_friction", asymmetry, distance, 0.0)) / rubbing(path)).ravel()[back]
    way = SLIDE[-1] - path.position.ravel()[back]
    assert ratio == pytest.approx(1 + asymmetry * np.maximum(1 - way / distance, -1))


@given(st.floats(-0.1, 0.1), st.floats(5e-7, 5e-6), st.floats(1e-5, 1e-2))
def test_where_a_rest_forgets_it_the_direction_is_by_the_speed(a: float, distance: float, speed: float) -> None:
    """min(1, v tau_0 / lambda) of it while the table moves, less by exp(-t / tau_0) once it rests."""
    count = math.ceil(max(4e-4 / speed, 10 * FORGOTTEN) / TS)
    path = through(TS * speed * np.minimum(np.arange(count + 60), count), parts=4)
    ratio = (rubbing(path, make("directional_friction", a, distance, 1.0)) / rubbing(path)).ravel()
    last = 4 * count
    s = min(1.0, speed * FORGOTTEN / distance)
    assert ratio[last - 1] == pytest.approx(1 + a * s, abs=1e-4 * abs(a) + 1e-12)
    t = (np.arange(ratio.size - last) + 0.5) * TS / 4
    assert ratio[last:] == pytest.approx(1 + a * s * np.exp(-t / FORGOTTEN), abs=0.03 * abs(a) + 1e-12)


@given(st.floats(0.03, 0.2), st.floats(3e-3, 6e-2), st.floats(0, 2 * math.pi))
def test_position_dependent_friction_has_its_period(part: float, length: float, phase: float) -> None:
    path = steady(0.1, 1200)
    ratio = rubbing(path, make("position_dependent_friction", part, length, phase)) / rubbing(path)
    assert ratio == pytest.approx(1 + part * np.sin(2 * math.pi * path.position / length + phase))


@given(st.floats(2e-4, 3e-3))
def test_a_lag_follows_a_ramp_behind_it_and_decays_behind_a_halt(time: float) -> None:
    """While the force climbs at a rate r, from rest, it is late by r tau (1 - exp(-t / tau)); then that decays."""
    rate = 5e-5
    path = through(np.concatenate([np.arange(21) * TS * rate, np.full(20, 20 * TS * rate)]), parts=20)
    late = (rubbing(path) - rubbing(path, make("frictional_lag", time))).ravel()
    t = (np.arange(late.size) + 0.5) * TS / 20
    climb, moving = sum(FRICTION.stiffness) * rate, t < 20 * TS  # no element slips over 0.5 um
    first = 0.5 * TS / 20
    assert late[moving] == pytest.approx(climb * time * (1 - np.exp(-(t[moving] - first) / time)), rel=1e-6, abs=1e-9)
    resting = late[~moving][2:]
    assert resting[1:] == pytest.approx(resting[:-1] * math.exp(-TS / 20 / time), rel=1e-6, abs=1e-9)


def test_drift_is_a_trend_in_time() -> None:
    path = steady(0.01, 1000)
    t = (np.arange(4000) + 0.5) * TS / 4
    ratio = (rubbing(path, make("friction_drift", -5e-3)) / rubbing(path)).ravel()
    assert ratio == pytest.approx(1 - 5e-3 * t)


@given(st.floats(2e-7, 3e-6))
def test_play_delays_a_branch_by_its_width(width: float) -> None:
    """Behind a reversal the force stays over w; from there on it climbs as it would without play."""
    down = np.arange(0, 60e-6, 1e-7)
    path = through(np.concatenate([SLIDE, SLIDE[-1] - down]), parts=1)
    force = rubbing(path, make("play", width))[SLIDE.size :, 0]
    way = down + 0.5e-7
    nominal = rubbing(path)[SLIDE.size :, 0]
    assert force[way < width] == pytest.approx(COULOMB)
    behind = way > width + 1e-7
    assert force[behind] == pytest.approx(np.interp(way[behind] - width, way, nominal), abs=0.03)


@given(st.floats(0, 3e-6), st.floats(2e-5, 1e-4))
def test_friction_with_play_dissipates(width: float, stroke: float) -> None:
    """A steady cycle takes work, and less of it with play; for strokes well above w, as the law says."""
    cycle = stroke * 0.5 * (1 - np.cos(2 * math.pi * np.arange(200) / 200))
    path = through(np.tile(cycle, 3), parts=4)
    step = (path.speed * TS / 4)[-200:]

    def work(*effects: Effect) -> float:
        return float(np.sum(rubbing(path, *effects)[-200:] * step))

    assert work() > 0
    assert 0 < work(make("play", width)) <= work() * (1 + 1e-9)


def test_two_effects_act_one_after_another() -> None:
    path = steady(0.05, 50)
    both = rubbing(path, make("viscous_friction", 40.0), make("directional_friction", 0.1, 2e-6, 0.0))
    assert both[-1, -1] == pytest.approx((COULOMB + 40 * 0.05) * 1.1)
