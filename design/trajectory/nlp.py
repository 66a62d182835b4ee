"""A nonlinear program with named variables and parameters: built once, solved often, by CasADi and IPOPT.

Variables are scaled by what they are measured in, bounds may depend on parameters, and a solution starts the next one
(primal and dual). An iterate that did not converge is a Solution too: it says why, and what to do next.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.identification.solving import interruptible

Array = NDArray[np.float64]

OPTIONS: Final[dict[str, Any]] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.max_iter": 200,
    "ipopt.acceptable_tol": 1e-5,
    "ipopt.acceptable_iter": 6,
    "ipopt.fixed_variable_treatment": "make_parameter",
}
WARM: Final[dict[str, Any]] = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_strategy": "adaptive",
    "ipopt.mu_init": 1e-5,
    "ipopt.warm_start_bound_push": 1e-8,
    "ipopt.warm_start_bound_frac": 1e-8,
    "ipopt.warm_start_slack_bound_push": 1e-8,
    "ipopt.warm_start_slack_bound_frac": 1e-8,
    "ipopt.warm_start_mult_bound_push": 1e-8,
}
NEXT: Final[dict[str, str]] = {
    "Infeasible_Problem_Detected": "nothing near meets these conditions: give more time, thrust or tolerance",
    "Maximum_Iterations_Exceeded": "begin from a wider smoothing, or from the solution of a nearby problem",
    "Restoration_Failed": "begin from a wider smoothing, or from the solution of a nearby problem",
    "Not_Enough_Degrees_Of_Freedom": "it has fewer samples than conditions: give more samples",
    "Invalid_Number_Detected": "a number is not finite: check the machine file's values",
}
OTHERWISE: Final = "begin from a wider smoothing, or loosen a limit"


@dataclass(frozen=True)
class Solution:
    """Where IPOPT stopped: `values` by name, SI; a `converged` one is the solution, another the failed iterate.

    status is IPOPT's word; advice, empty when converged, says what to do next. violation: largest missed condition, in
    the program's scaled units [1]. `multipliers` start the next solve.
    """

    values: Mapping[str, Array]
    objective: float
    converged: bool
    status: str
    iterations: int
    violation: float
    multipliers: tuple[Any, Any] = field(repr=False)

    @property
    def advice(self) -> str:
        """The next action where this is a failed iterate, else nothing."""
        return "" if self.converged else NEXT.get(self.status, OTHERWISE)


@dataclass
class Program:
    """Collects minimise f(v, p) subject to lower(p) <= v <= upper(p), low(p) <= g(v, p) <= high(p)."""

    _variables: dict[str, tuple[ca.MX, Array, ca.MX, ca.MX]] = field(default_factory=dict)
    _parameters: dict[str, ca.MX] = field(default_factory=dict)
    _conditions: list[tuple[ca.MX, ca.MX, ca.MX]] = field(default_factory=list)
    _objective: Any = 0.0

    def variable(self, name: str, scale: ArrayLike, lower: Any = -np.inf, upper: Any = np.inf) -> ca.MX:
        """A variable (k,) measured in `scale` (k,), any unit, within bounds that may hold parameters."""
        units = np.atleast_1d(np.asarray(scale, float))
        symbol = ca.MX.sym(name, units.size)
        bounds = [ca.MX(ca.DM.ones(units.size)) * bound / units for bound in (lower, upper)]
        self._variables[name] = (symbol, units, *bounds)
        return symbol * units

    def parameter(self, name: str, count: int = 1) -> ca.MX:
        """A parameter (count,), given anew at each solve."""
        self._parameters[name] = ca.MX.sym(name, count)
        return self._parameters[name]

    def subject_to(self, expression: Any, lower: Any, upper: Any, scale: Any = 1.0) -> None:
        """lower <= expression <= upper, each measured in `scale`; bounds may hold parameters."""
        ones = ca.MX(ca.DM.ones(expression.shape[0]))
        self._conditions.append((expression / scale, ones * lower / scale, ones * upper / scale))

    def minimise(self, objective: Any) -> None:
        """Adds to the objective, which should be about 1."""
        self._objective = self._objective + objective

    def build(self) -> Solver:
        """The program, its derivatives taken once."""
        v = ca.vertcat(*(entry[0] for entry in self._variables.values()))
        p = ca.vertcat(*self._parameters.values())
        g, low, high = (ca.vertcat(*column) for column in zip(*self._conditions, strict=True))
        lower, upper = (ca.vertcat(*(entry[i] for entry in self._variables.values())) for i in (2, 3))
        cold = ca.nlpsol("cold", "ipopt", {"x": v, "p": p, "f": self._objective, "g": g}, OPTIONS)
        derivatives = {
            option: cold.get_function(name)
            for option, name in (("grad_f", "nlp_grad_f"), ("jac_g", "nlp_jac_g"), ("hess_lag", "nlp_hess_l"))
        }
        warm = ca.nlpsol(
            "warm", "ipopt", {"x": v, "p": p, "f": self._objective, "g": g}, {**OPTIONS, **WARM, **derivatives}
        )
        bounds = ca.Function("bounds", [p], [lower, upper, low, high], ["p"], ["lbx", "ubx", "lbg", "ubg"])
        scales = {name: entry[1] for name, entry in self._variables.items()}
        return Solver(cold, warm, bounds, scales, {name: s.shape[0] for name, s in self._parameters.items()})


@dataclass(frozen=True)
class Solver:
    """A built Program."""

    cold: ca.Function
    warm: ca.Function
    bounds: ca.Function
    scales: Mapping[str, Array]
    parameters: Mapping[str, int]

    def solve(self, parameters: Mapping[str, ArrayLike], start: Mapping[str, ArrayLike] | Solution) -> Solution:
        """The solution, or failed iterate, from a guess (values by name, SI) or warm from another Solution."""
        p = np.concatenate([np.broadcast_to(parameters[name], (k,)) for name, k in self.parameters.items()])
        limits = self.bounds(p=p)
        given = start.values if isinstance(start, Solution) else start
        guess = np.concatenate([np.ravel(given[name]) / scale for name, scale in self.scales.items()])
        solver, duals = self.cold, {}
        if isinstance(start, Solution):
            solver, duals = self.warm, dict(zip(("lam_x0", "lam_g0"), start.multipliers, strict=True))
        with interruptible():
            found = solver(x0=guess, p=p, **limits, **duals)
        return self._solution(found, solver.stats(), limits)

    def _solution(self, found: Mapping[str, Any], stats: Mapping[str, Any], limits: Mapping[str, Any]) -> Solution:
        point, g = np.asarray(found["x"]).ravel(), np.asarray(found["g"]).ravel()
        low, high = (np.asarray(limits[name]).ravel() for name in ("lbg", "ubg"))
        ends = np.cumsum([scale.size for scale in self.scales.values()])
        parts = np.split(point, ends[:-1])
        return Solution(
            values={name: part * scale for (name, scale), part in zip(self.scales.items(), parts, strict=True)},
            objective=float(found["f"]),
            converged=bool(stats["success"]),
            status=str(stats["return_status"]),
            # IPOPT does not set the count where it refuses to begin.
            iterations=int(stats["iter_count"]) if stats.get("iterations") else 0,
            violation=float(np.max(np.maximum(low - g, g - high), initial=0.0)),
            multipliers=(found["lam_x"], found["lam_g"]),
        )
