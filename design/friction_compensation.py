"""The friction compensator RFM of Fig. 13: a simplified rolling friction model that turns x_T* into u_rf."""

from __future__ import annotations

import numpy as np

from models.friction import Friction, branch, elements, fit_elements


def simplify(friction: Friction, count: int) -> Friction:
    """The RFM with `count` elements (the paper's N = 5): limits spaced evenly in the logarithm, stiffnesses fitted.

    The fit follows the branch of `friction` behind a reversal (Fig. 3b), over which every history is built by Masing's
    rule, at distances spaced evenly in the logarithm; T_fc is kept. Quasi-static: the RFM has no damping. With as many
    elements as `friction` has (all of them, or those with a stiffness) the RFM has the same stiffnesses [N/m] and
    limits [m], so that nothing is lost.
    """
    for same in (friction, with_force(friction)):
        if count == len(same.limit):
            return elements(same.stiffness, same.limit)
    used = with_force(friction).limit
    limits = np.geomspace(min(used), max(used), count) if count > 1 else np.array([max(used)])
    distance = np.geomspace(min(used) / 2, 2 * max(used), 400)
    return fit_elements(limits, distance, branch(friction, distance), friction.coulomb_force)


def with_force(friction: Friction) -> Friction:
    """The elements that have a stiffness [N/m] above 0: the others add no force."""
    kept = [i for i, stiffness in enumerate(friction.stiffness) if stiffness > 0]
    return Friction(
        tuple(friction.stiffness[i] for i in kept),
        tuple(friction.limit[i] for i in kept),
        tuple(friction.damping[i] for i in kept),
    )
