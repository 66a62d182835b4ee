"""Figures of the droop in Fig. 2 and of the friction that a disturbance observer estimates, Fig. 7b."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from models.quantity import show
from reports import style
from reports.markup import Markdown

Results = Mapping[str, Any]
MICRO, MILLI = 1e6, 1e3
DROOP = Markdown(
    "Frequency response of the nonsmooth plant by the amplitude $a$ of the motion, beside the rolling plant $P_l$; "
    "dots: sines on the nonsmooth machine. Fig. 2 of the paper: the amplitude decreases below 10 Hz, by friction."
)
OBSERVER = Markdown(
    "Rolling friction of the positive motions without compensation, as a disturbance observer estimates it from "
    "command and reading (dashed), beside the true one: over time, as Fig. 7b of the paper, and over the position, as "
    "its Fig. 8."
)


def draw_droop(whole: Results) -> Drawing:
    """Magnitude [m/N] and phase [deg] by amplitude."""
    droop = whole["results"]["droop"]
    figure, axes = style.subplots(2, 1, 95, sharex=True, height_ratios=(3, 2))
    above, below = axes[:, 0]
    frequency = droop["frequency_Hz"]
    above.loglog(
        frequency, droop["rolling"]["magnitude_m_per_N"], color=style.LIMIT, linestyle="-", linewidth=2.2, label="$P_l$"
    )
    below.semilogx(frequency, droop["rolling"]["phase_deg"], color=style.LIMIT, linestyle="-", linewidth=2.2)
    for i, curve in enumerate(droop["curves"]):
        colour = style.COLOURS[i % len(style.COLOURS)]
        label = f"$a$ = {show(curve['amplitude_m'], 'm')}"
        above.loglog(frequency, curve["magnitude_m_per_N"], color=colour, label=label)
        below.semilogx(frequency, curve["phase_deg"], color=colour)
        for one in droop["simulated"]:
            if one["amplitude_m"] == curve["amplitude_m"]:
                above.plot(one["frequency_Hz"], one["magnitude_m_per_N"], "o", color=colour, markersize=4)
    above.set_ylabel("magnitude [m/N]")
    above.legend(loc="upper right")
    below.set_ylabel("phase [deg]")
    below.set_ylim(-450, 20)
    below.set_yticks(range(-450, 1, 90))
    below.set_xlabel("frequency [Hz]")
    return figure


def draw_observer(whole: Results) -> Drawing:
    """Estimated and true friction [N], over time [ms] and over the position [um]."""
    observer = whole["results"]["observer"]
    figure, axes = style.subplots(1, 2, 65, sharey=True)
    left, right = axes[0]
    time = MILLI * np.array(observer["time_s"])
    for i, motion in enumerate(observer["motions"]):
        look: dict[str, Any] = {"color": style.VERMILION if motion["reversal"] else style.BLUE}
        labels = ("true, " + ("reversal" if motion["reversal"] else "inching"), "estimated") if i < 2 else (None, None)
        left.plot(time, motion["true_N"], linestyle="-", linewidth=0.9, label=labels[0], **look)
        left.plot(time, motion["estimated_N"], linestyle=(0, (3, 1)), linewidth=1.2, label=labels[1], **look)
        position = MICRO * np.array(motion["position_m"])
        right.plot(position, motion["true_N"], linestyle="-", linewidth=0.9, **look)
        right.plot(position, motion["estimated_N"], linestyle=(0, (3, 1)), linewidth=1.2, **look)
    left.set_xlabel("time from the step [ms]")
    left.set_ylabel("friction [N]")
    left.legend(loc="lower right")
    right.set_xlabel("position [µm]")
    return figure
