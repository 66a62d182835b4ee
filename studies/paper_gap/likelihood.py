"""How likely each kind of cause is: the share of draws over its ranges that agree with what the paper says.

Of a kind, every candidate has as many draws; so the share of all its draws is the probability that a candidate taken at
random, with a size at random within its range, shows what the paper shows (the evidence of approximate Bayesian
computation). With equal odds beforehand, the shares are in the ratio of the odds behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import scipy

from studies.paper_gap.candidates import CANDIDATE_KINDS
from studies.paper_gap.explore import ALONE, Case, Draw

SAMPLES: Final = 20_000  # of the shares, for the intervals of the odds
LEVEL: Final = 0.95

READINGS: Final = ("loose_fits", "loose_slopes", "pattern_fits", "pattern_slopes")
"""What agrees: 3 sigma with the reversal in time (loose), or an inching motion that misses as well (pattern); with the
figures without compensation (fits), or with these and the RFM's slopes.

The paper's inching motions "cannot satisfy the specification because of the dispersion": 3 sigma beyond the tolerance
(loose), or a motion beyond it (pattern).
"""


def evidence(explored: Mapping[str, Mapping[str, Sequence[Draw]]], share: float, seed: int) -> dict[str, Any]:
    """By kind, the draws within the ranges and how many agree with the paper; and the odds by each of READINGS.

    share [1]: largest relative error of figures without compensation and of the RFM's slopes that agrees.
    """
    kinds = {kind: _of_kind(kind, explored, share) for kind in CANDIDATE_KINDS}
    return {
        "share": share,
        "kinds": kinds,
        "odds": {reading: _odds({kind: one[reading] for kind, one in kinds.items()}, seed) for reading in READINGS},
    }


def blind(ways: Mapping[str, Sequence[Draw]]) -> list[Draw]:
    """The draws over the ranges alone, without those of the local search."""
    return [one for one in ways[ALONE] if not one.found]


def _of_kind(kind: str, explored: Mapping[str, Mapping[str, Sequence[Draw]]], share: float) -> dict[str, Any]:
    its = {name: ways for name, ways in explored.items() if Case(name).candidate().kind == kind}
    draws = [one for ways in its.values() for one in blind(ways)]
    tests: dict[str, Callable[[Draw], bool]] = {
        "loose": lambda one: one.disperses,
        "pattern": lambda one: one.shows,
        "loose_fits": lambda one: one.disperses and one.without_off <= share,
        "pattern_fits": lambda one: one.shows and one.without_off <= share,
        "loose_slopes": lambda one: one.disperses and one.fits(share),
        "pattern_slopes": lambda one: one.shows and one.fits(share),
    }
    found: dict[str, Any] = {name: _share(sum(map(test, draws)), len(draws)) for name, test in tests.items()}
    within = [one for ways in its.values() for one in ways[ALONE]]
    return {
        "candidates": len(its),
        **found,
        "dispersions_m": np.sort([one.outcome.dispersion for one in draws]),
        "names": {name: _names(within, test) for name, test in tests.items()},
        "largest": {name: _largest(its, test) for name, test in tests.items()},
    }


def _share(count: int, of: int) -> dict[str, Any]:
    """A share with its interval (Jeffreys)."""
    low, high = scipy.stats.beta(count + 0.5, of - count + 0.5).interval(LEVEL)
    return {
        "count": count,
        "of": of,
        "share": count / of,
        "interval": [0.0 if count == 0 else float(low), 1.0 if count == of else float(high)],
    }


def _names(draws: Sequence[Draw], test: Callable[[Draw], bool]) -> list[str]:
    """The candidates of which some draw within the ranges passes by itself."""
    return list(dict.fromkeys(one.case.name for one in draws if test(one)))


def _largest(its: Mapping[str, Mapping[str, Sequence[Draw]]], test: Callable[[Draw], bool]) -> dict[str, Any]:
    """The candidate with the largest share."""
    shares = {name: float(np.mean([test(one) for one in blind(ways)])) for name, ways in its.items()}
    name = max(shares, key=shares.__getitem__)
    return {"name": name, "share": shares[name]}


def _odds(shares: Mapping[str, Mapping[str, Any]], seed: int) -> dict[str, Any]:
    """The probability of each kind with its interval, with equal odds beforehand; None where no draw agrees.

    The median of the draws that its interval is of: the ratio of the shares may lie outside, as a share of 0 does.
    """
    if not any(one["count"] for one in shares.values()):
        return dict.fromkeys(shares)
    rng = np.random.default_rng(seed)
    drawn = np.array([rng.beta(one["count"] + 0.5, one["of"] - one["count"] + 0.5, SAMPLES) for one in shares.values()])
    drawn /= drawn.sum(axis=0)
    low, middle, high = np.quantile(drawn, [(1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2], axis=1)
    return {
        kind: {"probability": float(middle[i]), "interval": np.array([low[i], high[i]])}
        for i, kind in enumerate(shares)
    }
