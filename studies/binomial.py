"""The interval around a share of which so many hits in so many tries were seen."""

from __future__ import annotations

from typing import Final

import scipy

CONFIDENCE: Final = 0.95


def interval(hits: int, tries: int) -> tuple[float, float]:
    """Clopper and Pearson's interval (1934) [1], which holds the true share in 95 % of cases; 0 .. 1 without a try."""
    tail = (1 - CONFIDENCE) / 2
    low = scipy.stats.beta.ppf(tail, hits, tries - hits + 1) if hits else 0.0
    high = scipy.stats.beta.ppf(1 - tail, hits + 1, tries - hits) if hits < tries else 1.0
    return float(low), float(high)
