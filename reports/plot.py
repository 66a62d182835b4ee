"""A quick plot of a run in a notebook: target, position and thrust."""

from __future__ import annotations

import io
from typing import Protocol, runtime_checkable

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from reports.style import BLACK, BLUE, LIMIT, STYLE, VERMILION
from reports.units import length_unit

Array = NDArray[np.float64]


class Signals(Protocol):
    """A record, as far as a plot needs one: the sample time [s] and signals of shape (n,) in [m] and [N]."""

    @property
    def sample_time(self) -> float:
        """T_s [s]."""

    @property
    def target(self) -> Array:
        """r (n,) [m]."""

    @property
    def reference(self) -> Array:
        """x_T* (n,) [m]."""

    @property
    def position(self) -> Array:
        """The scale's reading (n,) [m]."""

    @property
    def command(self) -> Array:
        """u_M (n,) [N]."""


@runtime_checkable
class Run(Protocol):
    """A simulated response: it has a record."""

    @property
    def record(self) -> Signals:
        """What the run logged."""


@runtime_checkable
class Judged(Protocol):
    """A validation: it has the response that it judged."""

    @property
    def response(self) -> Run:
        """The last period of the run."""


class Picture(Figure):
    """A figure that a notebook shows, whatever its backend is."""

    def _repr_svg_(self) -> str:
        text = io.StringIO()
        with mpl.rc_context(STYLE):
            self.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        return text.getvalue()


def plot(run: Judged | Run | Signals) -> Picture:
    """Target, reference and position [µm; mm on a long way] above the command [N], over time [ms]; of a response, of a
    record, or of what a validation judged.

    A notebook shows the figure that a cell ends with; `savefig` writes it to a file.

    >>> figure = pos.plot(response)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['position [µm]', 'command [N]']
    """
    run = run.response if isinstance(run, Judged) else run
    record = run.record if isinstance(run, Run) else run
    time = 1e3 * record.sample_time * np.arange(record.position.size)
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=(160 / 25.4, 100 / 25.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        largest = max(float(np.max(np.abs(one))) for one in (record.target, record.reference, record.position))
        count, unit = length_unit(largest)
        above.step(time, count * record.target, where="post", color=LIMIT, linestyle="--", label="target $r$")
        above.plot(time, count * record.reference, color=BLACK, linestyle=":", label="reference $x_T^*$")
        above.plot(time, count * record.position, color=BLUE, linestyle="-", label="position $x$")
        above.set_ylabel(f"position [{unit}]")
        above.legend()
        below.step(time, record.command, where="post", color=VERMILION, linestyle="-")
        below.set_ylabel("command [N]")
        below.set_xlabel("time [ms]")
    return figure
