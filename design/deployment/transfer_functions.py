"""A controller as objects of python-control, for who analyses or simulates it there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from design.loop import controller_model
from models.controller import Controller

if TYPE_CHECKING:
    import control


def transfer_functions(controller: Controller) -> dict[str, control.TransferFunction | control.StateSpace]:
    """N_ff [m/m], D_ff [N/m] and C(z) [N/m] of a controller, each with its sample time.

    C is from x_T* after its delay, less the reading, to u_fb, as a state space; the friction compensation and the limit
    are not linear, and so in none of them.

    >>> parts = pos.transfer_functions(controller)
    >>> bool(abs(parts["N_ff"](1) - 1) < 1e-9)  # x_T* ends on the target
    True
    """
    import control  # noqa: PLC0415  # slow to import, and few need it

    ts = controller.sample_time
    parts: dict[str, control.TransferFunction | control.StateSpace] = {
        name: control.TransferFunction(list(row), [1.0, *[0.0] * (len(row) - 1)], ts)
        for name, row in (("N_ff", controller.n_ff), ("D_ff", controller.d_ff))
    }
    return {**parts, "C": controller_model(controller.feedback, ts)}
