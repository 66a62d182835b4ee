"""The nonlinear program behind `design.pid.tuning`, in CasADi: objective and constraints, at slots that are parameters.

Unknowns x: (kp, ki, kd) over those of a scaling PID (kp_0, ki_0, kd_0), a = tau / (tau + T_s), the objective.
A slot is one frequency of one plant: (Re P kp_0, Im P kp_0, omega T_s, and the direction of 1 + L in the round before).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import casadi as ca

from design.family import Member
from design.pid.goal import Goal
from models.controller import PID

if TYPE_CHECKING:
    import control

ROOMS: Final = (50, 80, 160)  # Programs have room for so many slots; the smallest that does is solved.
SLOTS: Final = ROOMS[-1]  # The most that are ever taken.


def program(members: Sequence[Member], goal: Goal, scale: PID, room: int, in_band: int) -> ca.Function:
    """IPOPT's program over x (5,), with parameters (ms, mt, mcs / kp_0, exact, `room` slots, those in the band).

    exact > 0: bounds |1 + L| itself and not its part along the direction of the round before, which is stricter.
    scale: the PID [SI] that the gains are measured in. in_band: slots at which |PS| counts, for the objective "band".
    """
    ts = float(members[0].plant.dt)
    x, limits, slot = ca.SX.sym("x", 5), ca.SX.sym("limits", 4), ca.SX.sym("slot", 5)
    controller, loop = _parts(x, slot, scale, ts)
    ahead = slot[3] * (1 + loop[0]) + slot[4] * loop[1]  # of 1 + L along where it pointed: at most |1 + L|
    ahead = ca.if_else(limits[3] > 0, _size((1 + loop[0], loop[1])), ahead)
    keeps = ca.vertcat(
        1 - limits[0] * ahead,
        _size(loop) - limits[1] * ahead,
        _size(controller) / limits[2] - ahead,
    ) / (1 + _size(loop))  # of order 1 at every frequency
    unknowns, given = ca.MX.sym("x", 5), ca.MX.sym("p", 4 + 5 * (room + in_band))
    slots = ca.reshape(given[4:], 5, room + in_band)
    each = ca.Function("slot", [x, limits, slot], [keeps]).map(room)
    constraints = [ca.vec(each(unknowns, given[:4], slots[:, :room]))]
    if in_band:
        effect = ca.Function(
            "effect", [x, limits, slot], [(_size((slot[0], slot[1])) - x[4] * ahead) / (1 + _size(loop))]
        )
        constraints.append(ca.vec(effect.map(in_band)(unknowns, given[:4], slots[:, room:])))
    if goal.objective == "step":
        for member in members:
            if member.nominal:
                error = _error_samples(unknowns, member.plant, scale, goal)
                constraints += [error - unknowns[4], -error - unknowns[4]]
    if math.isfinite(goal.integral_time):
        constraints.append(unknowns[0] - goal.integral_time * scale.ki / scale.kp * unknowns[1])
    cost = -ca.log(unknowns[1]) + unknowns[4] ** 2 if goal.objective == "integral" else unknowns[4]
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 150, "tol": 1e-8, "mu_init": 1e-3, "mumps_pivot_order": 0},
    }
    problem: dict[str, Any] = {"x": unknowns, "p": given, "f": cost, "g": ca.vertcat(*constraints)}
    return ca.nlpsol("tune", "ipopt", problem, options)


def _parts(x: ca.SX, slot: ca.SX, scale: PID, ts: float) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    """C / kp_0 and L (real, imaginary) at a slot (Re P kp_0, Im P kp_0, omega T_s, ...), of unknowns x."""
    cosine, sine = ca.cos(slot[2]), ca.sin(slot[2])  # z^-1 = cosine - j sine
    integral = ts * scale.ki / scale.kp * x[1]
    slope = scale.kd / scale.kp / ts * x[2] * (1 - x[3])
    # 1 / (1 - z^-1) = (1 - j cot(omega T_s / 2)) / 2; (1 - z^-1) / (1 - a z^-1) by its denominator's conjugate
    square = (1 - x[3] * cosine) ** 2 + (x[3] * sine) ** 2
    real = x[0] + integral / 2 + slope * ((1 - cosine) * (1 - x[3] * cosine) + x[3] * sine**2) / square
    imag = -integral / 2 / ca.tan(slot[2] / 2) + slope * sine * (1 - x[3]) / square
    loop_real, loop_imag = slot[0] * real - slot[1] * imag, slot[0] * imag + slot[1] * real
    return (real, imag), (loop_real, loop_imag)


def _size(number: tuple[ca.SX, ca.SX]) -> ca.SX:
    return ca.sqrt(number[0] ** 2 + number[1] ** 2)


def _error_samples(x: ca.MX, plant: control.StateSpace, scale: PID, goal: Goal) -> ca.MX:
    """kp_0 x (n,) [1, newtons per newton] from `begin` to `end` after a unit step of d; the exact sampled recursion."""
    n, ts = plant.nstates, float(plant.dt)
    state, gains = ca.SX.sym("state", n + 2), ca.SX.sym("x", 5)
    slope = (1 - gains[3]) / ts
    error = -(ca.DM(plant.C) @ state[:n]) * scale.kp  # N per N
    integral = state[n] + scale.ki * ts / scale.kp * gains[1] * error
    command = gains[0] * error + integral + scale.kd / scale.kp * gains[2] * (slope * error + state[n + 1])
    plant_next = ca.DM(plant.A) @ state[:n] + ca.DM(plant.B) * (command + 1)
    slope_next = gains[3] * state[n + 1] + (gains[3] - 1) * slope * error
    step = ca.Function("step", [state, gains], [ca.vertcat(plant_next, integral, slope_next)])
    count = round(goal.end / ts)
    path = step.mapaccum("path", count)(ca.MX.zeros(n + 2), ca.repmat(x, 1, count))
    position = ca.DM(plant.C) @ path[:n, round(goal.begin / ts) - 1 :] * scale.kp
    return position.T
