"""An axis of another kind for the tests of feedbacks: 12 kg, one mode, 4 kHz, under a P/PI cascade."""

from __future__ import annotations

from dataclasses import replace

from models.feedback.forms import Cascade, Filters, LowPass, Notch, Section
from models.friction import elements
from models.machine import FROM_ELEMENTS, Machine, load
from models.plant import Mode, Plant

TS = 250e-6
CASCADE = Cascade(
    position_gain=85.0,
    velocity_gain=4000.0,
    integral_time=12e-3,
    velocity_feedforward=1.0,
    acceleration_feedforward=12.0,
)
FILTERS = Filters(
    notch=(Notch(140.0, 0.4, 0.1),),
    low_pass=(LowPass(900.0),),
    section=(Section((0.3, 0.1), (1.0, -0.6)),),
)
PLANT = Plant(325e-6, 1.0, (Mode(1 / 12, 0.0, 0.0), Mode(1 / 120, 140.0, 0.018)))
FRICTION = elements([2e5, 1e5], [25e-6, 30e-6])  # slips at 8 N


def axis(cascade: Cascade | None = CASCADE, filters: Filters | None = None, anti_windup: float = 0.0) -> Machine:
    table = load()
    control = replace(
        table.control,
        sample_time=TS,
        reference_delay=0,
        anti_windup=anti_windup,
        cascade=cascade,
        filters=filters or Filters(),
    )
    return replace(
        table,
        name="axis",
        plant=PLANT,
        friction=FRICTION,
        control=control,
        drive=replace(table.drive, rated_thrust=400.0, offset=1.5),
        scale=replace(table.scale, resolution=5e-9),
        presliding=FROM_ELEMENTS,
        published=None,
        sources={},
    )
