"""On which coordinate the gap depends, by the innovations that a curve over it would take off.

The unknown force itself is a bad witness: it wanders where the records say little, and a re-fit has moved a part of the
gap into the nominal parameters. So a curve over a coordinate is passed through the predictor as a force, the nominal
parameters adapt to it, and what it takes off the whitened innovations of motions that it was not fitted to counts. A
share is of what these have above the noise floor or, where they are no larger than noise, of all that they have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, weights
from diagnosis.where.coordinates import (
    RIDGES,
    Coordinate,
    Explained,
    Target,
    by_motion,
    energies,
    explain_pitch,
    explain_target,
)
from diagnosis.where.energy import Samples
from diagnosis.where.side import as_force
from diagnosis.which.detectors.scan import NuisanceProjection
from models.records.record import Record

Array = NDArray[np.float64]

# Deviations of the noise's own chi-square, from which on there is something above the floor.
MIN_EXCESS_STDS: Final = 3.0


def of_innovations(
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
    samples: Samples,
    usual: Sequence[float] = (),
) -> Target:
    """What a fit leaves of the records above the noise, to be explained by forces [N]; usual [1]: the variance of the
    innovations that a complete model leaves of each record, 1 where it is not known."""
    counts = weights(records)
    sizes = [record.position.size for record in records]
    floor = np.repeat(usual or np.ones(len(records)), sizes) * counts

    def products(columns: Array) -> tuple[Array, Array]:
        seen = projection(as_force(fitted, records, columns) * counts[:, None])
        grams, slopes = by_motion(seen, projection.e, samples.motion)
        return grams, -slopes

    energy, noise = energies(projection.e, samples), energies(np.sqrt(floor), samples)
    excess = float(energy.sum() - noise.sum())
    if excess > MIN_EXCESS_STDS * float(np.sqrt(2 * np.sum(floor**2))):
        energy = energy * (excess / float(energy.sum()))
    return Target(products, energy, RIDGES)


def explained_by(
    target: Target, force: Array, known: Sequence[Coordinate], samples: Samples, seed: int
) -> tuple[Explained, ...]:
    """What each coordinate explains of a target, the largest share first; force (n,) [N]: the unknown one, which shows
    the period over the position."""
    found = [explain_target(target, one, samples, seed) for one in known]
    position = next((one for one in known if one.name == "position"), None)
    pitch = explain_pitch(force, target, position, samples, seed) if position is not None else None
    return tuple(sorted([*found, *([pitch] if pitch else [])], key=lambda one: -one.share))
