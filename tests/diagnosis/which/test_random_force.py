"""Random forces, discriminated from forces that repeat with the motions."""

from __future__ import annotations

import numpy as np

from diagnosis.which.random_force import steadiness


def test_a_force_that_is_there_after_some_motions_only_is_not_steady() -> None:
    rng, ts = np.random.default_rng(3), 5e-4
    t = np.arange(60_000) * ts
    floor = np.sin(2 * np.pi * 8.0 * t + 0.3 * np.cumsum(rng.standard_normal(t.size)) * ts**0.5)
    since = t % 10.0  # a motion every ten seconds, after which it decays
    slosh = np.exp(-since / 0.5) * np.sin(2 * np.pi * 8.0 * since)
    noise = 0.1 * rng.standard_normal(t.size)

    assert steadiness([floor + noise], 8.0, ts) > 0.8
    assert steadiness([slosh + noise], 8.0, ts) < 0.2
