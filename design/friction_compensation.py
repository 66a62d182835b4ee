"""The friction compensator RFM of Fig. 13: a simplified rolling friction model that turns x_T* into u_rf."""

from __future__ import annotations

import numpy as np

from models.friction import Friction, branch, fit_elements


def simplify(friction: Friction, count: int) -> Friction:
    """The RFM with `count` elements (the paper's N = 5): limits spaced evenly in the logarithm, stiffnesses fitted.

    The fit follows the branch of `friction` behind a reversal (Fig. 3b), over which every history is built by Masing's
    rule, at distances spaced evenly in the logarithm; T_fc is kept. Quasi-static: the RFM has no damping.
    """
    used = [x for k, x in zip(friction.stiffness, friction.limit, strict=True) if k > 0]
    limits = np.geomspace(min(used), max(used), count) if count > 1 else np.array([max(used)])
    distance = np.geomspace(min(used) / 2, 2 * max(used), 400)
    return fit_elements(limits, distance, branch(friction, distance), friction.coulomb_force)
