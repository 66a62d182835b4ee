"""A record's signals as friction is fitted to them: the low-pass, the samples that are kept, the path's passes.

Position and force go through the same zero-phase low-pass; the path has a wider one of its own (see `by_elements`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.effects.base import Effect
from models.records.record import Record

Array = NDArray[np.float64]

# The path's low-pass over the force's, and two beside it that show how much the choice matters.
SMOOTHING: Final = (5.6, 4.8, 6.6)
# Times the frequency of a record's loops that its pass band is wide: half of it doubles the error of the curve on
# tables like the default one, twice as much takes another third off, at more noise.
LOOPS: Final = 80.0
# Times the frequency below which a fast record's motion has nearly all of its speed's energy that its pass band is
# wide at least: 40 Hz on EMPS. A vibration mode is no part of the model, so that the band ends below the lowest one.
MOTION: Final = 5.8
FEWEST_TURNS: Final = 4  # of the path, of which the median distance of every second one is a loop where it turns
OFTENER: Final = 3.0  # times as often as its largest line says
MOST_ENERGY: Final = 0.999
BELOW_MODES: Final = 0.7
MAX_NYQUIST_SHARE: Final = 0.9  # of half the sampling rate: the widest low-pass
AT_A_TIME: Final = 10_000_000  # numbers of columns that are filtered together; a filter makes several copies of them
MIN_LIMIT_STEPS: Final = 0.5  # of the reading: the shortest limit looked at, of which a search may halve it
SHORT_PATH, LONG_PATH = 2.0, 500.0  # times the likely longest limit, a path that limits are looked for below, and up to
PASS: Final = 0.02  # of the path's span: the shortest way between two reversals
SAME_PASS_SHARE: Final = 0.1  # of their way: by less, passes from one reversal to the next are the same one again


@dataclass(frozen=True)
class Terms:
    """What acts beside the elements. mass [kg]: known and taken off; None: identified. drag [N s/m]: viscous friction
    that is known and taken off; effects: others that are known, of those that `stated.along_the_path` names. Others:
    identified or absent.

    by_direction: viscous friction of its own for each direction; bent: a part c' v^2 beside c v, so that it may grow
    less than in proportion; spring: to ground, a part k x; delay: the position answers a delay after the command,
    sought from `likely_delay` [s] on (known_delay [s] beside it, with its standard deviation). damped: damping of the
    elements is sought, and taken only if BIC falls by ten. likely_limit [m]: the longest of the elements known before.
    """

    mass: float | None = None
    drag: float = 0.0
    effects: tuple[Effect, ...] = ()
    viscous: bool = False
    by_direction: bool = False
    bent: bool = False
    spring: bool = False
    delay: bool = False
    likely_delay: float = 0.0
    known_delay: float = 0.0
    known_delay_std: float = 0.0
    damped: bool = False
    likely_limit: float = math.inf

    @property
    def lags(self) -> NDArray[np.bool_]:
        """Which of LAGS are identified (2,)."""
        return np.array([self.delay, self.damped])


@dataclass(frozen=True)
class Signals:
    """Filtered signals at all samples, and which of them are kept; step [m]: the finest of the reading; pass_band:
    sections of the low-pass, at_rest: their state at a constant 1, highest [Hz]: its end; beside: what
    `beside_elements` gives at the known delay."""

    sample_time: float
    path: Array
    force: Array
    step: float
    keep: NDArray[np.int64]
    fitted: NDArray[np.bool_]
    pass_band: Array
    at_rest: Array
    highest: float
    terms: Terms
    beside: tuple[Array, Array] | None = None


def usable_band(usual: float, sample_time: float) -> float:
    """The low-pass's pass band [Hz] of a record sampled every sample_time [s]: the usual one, or on a slow record the
    widest with which the path's low-pass, that is SMOOTHING times as wide, stays below half the rate."""
    return min(usual, 0.5 * MAX_NYQUIST_SHARE / sample_time / max(SMOOTHING))


def slow_band(record: Record) -> float:
    """The low-pass's pass band [Hz] for friction in a slow record: so many times the frequency of its loops, as the
    band smears the curve behind a reversal over a way that grows with the speed. Beside loops on a way, or at several
    places, that way is the largest line; then how often the path turns round tells their frequency."""
    loops, count = _loops(record), np.arange(record.position.size)
    turns = reversals(record.position - np.polyval(np.polyfit(count, record.position, 1), count))
    if turns.size >= FEWEST_TURNS:
        turning = 1 / (float(np.median(turns[2:] - turns[:-2])) * record.sample_time)
        loops = turning if turning > OFTENER * loops else loops
    return usable_band(LOOPS * loops, record.sample_time)


def fast_band(record: Record, lowest_mode: float) -> float:
    """The low-pass's pass band [Hz] for friction in a fast record: that of a slow one, or so many times the frequency
    below which its motion has nearly all of its speed's energy, as strokes with rests between them are quicker than
    they follow each other. What the reading's noise adds is left out. lowest_mode [Hz]: inf without one."""
    way = record.position - np.linspace(record.position[0], record.position[-1], record.position.size)
    energy = np.abs(np.fft.rfft(way * np.hanning(way.size))) ** 2
    frequency = np.fft.rfftfreq(way.size, record.sample_time)
    # The mean of an exponential distribution from its median, and what one of so many draws reaches.
    noise = float(np.median(energy[energy.size // 2 :])) / math.log(2) * math.log(energy.size)
    sums = np.cumsum(np.maximum(energy - noise, 0.0) * frequency**2)
    motion = float(frequency[np.searchsorted(sums, MOST_ENERGY * sums[-1])])
    wanted = max(LOOPS * _loops(record), MOTION * motion)
    return usable_band(min(wanted, BELOW_MODES * lowest_mode), record.sample_time)


def _loops(record: Record) -> float:
    """The frequency [Hz] at which a record goes to and fro."""
    size = np.abs(np.fft.rfft(record.position - np.mean(record.position)))[1:]
    return (int(np.argmax(size)) + 1) / (record.position.size * record.sample_time)


def memory_ends(path: Array) -> int:
    """The first extreme of the path (n,) [m]: what happened before it, large elements may still remember."""
    away = np.abs(path - 0.5 * (np.max(path) + np.min(path)))
    return int(np.argmax(away >= np.max(away) - 0.02 * np.ptp(path)))


def limit_range(data: Signals) -> tuple[float, float]:
    """Least and largest limit [m] looked at: from what the scale and the path show on, up to 0.45 of the path's span.
    A path that is far longer than the likely longest limit counts as one that is so many times as long as it."""
    span, likely = float(np.ptp(data.path)), data.terms.likely_limit
    least, most = (min(span, times * likely) for times in (SHORT_PATH, LONG_PATH))
    return max(2e-3 * least, MIN_LIMIT_STEPS * data.step), 0.45 * most


def finest_step(position: Array) -> float:
    """The finest step of a reading (n,) [m] that moves, beyond what rounding makes of one."""
    steps = np.abs(np.diff(position))
    return float(np.min(steps[steps > 1e-9 * np.max(steps)]))


def filtered(data: Signals, columns: Array) -> Array:
    """Columns (samples, c) [SI] through the pass band, at the samples kept (n, c)."""
    width = max(AT_A_TIME // len(columns), 1)
    parts = [columns[:, i : i + width] for i in range(0, max(columns.shape[1], 1), width)]
    return np.hstack([there_and_back(data.pass_band, data.at_rest, part)[data.keep] for part in parts])


def there_and_back(sections: Array, at_rest: Array, columns: Array) -> Array:
    """`sosfiltfilt` (samples, c) by a filter without zero coefficients at its ends, to the last digit, whose state
    (sections, 2) at a constant 1 is known: SciPy finds it anew in every call, which takes longer than to filter."""
    edge = 3 * (2 * len(sections) + 1)
    first, last = columns[:1], columns[-1:]
    whole = np.concatenate([2 * first - columns[edge:0:-1], columns, 2 * last - columns[-2 : -edge - 2 : -1]])
    for _ in range(2):
        whole = scipy.signal.sosfilt(sections, whole, axis=0, zi=at_rest[:, :, None] * whole[0])[0][::-1]
    return np.asarray(whole[edge:-edge])


def reversals(path: Array) -> NDArray[np.int64]:
    """The samples (k,) at which a path (n,) [m] turns round, for a PASS of its span at least."""
    least = PASS * np.ptp(path)
    ends = [scipy.signal.find_peaks(sign * path, prominence=least)[0] for sign in (1, -1)]
    return np.asarray(np.sort(np.concatenate(ends)), np.int64)


def passes(path: Array) -> tuple[NDArray[np.int64], Array]:
    """Of every sample (n,) which pass it belongs to, from one reversal to the next, and how far it is from the one
    before [m]. Passes that begin and end at the same places are one."""
    ends = np.unique(np.concatenate([[0], reversals(path), [path.size - 1]]))
    number, way, known = np.zeros(path.size, np.int64), np.zeros(path.size), list[tuple[float, float]]()
    for begin, end in pairwise(ends):
        here = path[begin], path[end]
        close = SAME_PASS_SHARE * abs(here[1] - here[0])
        same = [i for i, one in enumerate(known) if np.max(np.abs(np.subtract(one, here))) < close]
        number[begin : end + 1] = same[0] if same else len(known)
        way[begin : end + 1] = path[begin : end + 1] - here[0]
        known += [] if same else [here]
    return number, way
