"""`where`'s answer as results.json holds it: the shares that others rely on, and what the figures are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from diagnosis.model.motions import MotionKind, Piece, repeated
from diagnosis.model.residual import Candidate, noise
from diagnosis.where.coordinates import PITCHES, Explained, periodogram
from diagnosis.where.energy import PHASES, WAVES, Shares, bands
from diagnosis.where.force import FAST, answer
from diagnosis.where.locate import Where
from diagnosis.where.sentences import statements
from diagnosis.where.side import verdict
from models.records.record import Record

Array = NDArray[np.float64]

POINTS: Final = 600  # of a force over a whole record
COURSE: Final = 300  # of a force over one motion
LINES: Final = 80  # of a spectrum
COURSES: Final = 3  # kinds of motions whose force is kept


def to_json(found: Where) -> dict[str, Any]:
    """Shares by name, the statements with their topics, and under "details" all shares with their intervals; SI."""
    stated = statements(found)
    return {
        "by_motion": {name: float(share) for name, share in _pairs(found.by_motion)},
        "by_phase": {name: float(share) for name, share in _pairs(found.by_phase)},
        "by_band_Hz": [
            [low, high, float(share)]
            for (low, high), share in zip(bands(found.sample_time), found.by_band.share, strict=True)
        ],
        "by_wavelength_m": [
            [low, high, float(share)]
            for low, high, share in zip((0.0, *WAVES), (*WAVES, None), found.by_wave.share, strict=True)
        ],
        "by_coordinate": {one.name: one.share for one in found.by_coordinate},
        "statements": [one.text for one in stated],
        "topics": [one.topic.value for one in stated],
        "details": _details(found),
    }


def _pairs(shares: Shares) -> list[tuple[str, float]]:
    return [(shares.names[i], float(shares.share[i])) for i in shares.ranked()]


def _details(found: Where) -> dict[str, Any]:
    return {
        "force_rms_N": found.deviation,
        "noise_rms_N": found.unseen,
        "walk_N_per_sample": found.likely.walk,
        "side": verdict(found.sides),
        "sides": [
            {"coordinate": one.coordinate, "force": one.force, "reading": one.reading, "pitch_m": one.pitch}
            for one in found.sides
        ],
        "floor": {
            "source": found.floor.source,
            "force_N": found.floor.force,
            "position_m": found.floor.position,
            "innovations": found.floor.innovations,
            "groups": found.floor.groups,
            "motions": found.floor.motions,
            "repeats": found.floor.repeats,
        },
        "ceiling": {
            "share": found.together[0],
            "low": found.together[1],
            "high": found.together[2],
            "force_N": found.deviation * float(np.sqrt(max(1 - found.together[0], 0.0))),
        },
        "controller": [
            {
                "replays": one.replays,
                "checked": one.checked,
                "largest_N": one.largest,
                "rms_N": one.rms,
                "tolerance_N": one.tolerance,
                "departs_at_sample": one.departs,
                "would_fit": one.remedy,
                "would_leave_N": one.remains,
            }
            for one in found.controller
        ],
        "maps": {
            "motion": _shares(found.by_motion),
            "phase": _shares(found.by_phase),
            "band": _shares(found.by_band),
            "wavelength": _shares(found.by_wave),
        },
        "motion_by_phase": {
            "motions": [str(kind) for kind in found.samples.kinds],
            "phases": list(PHASES),
            "share": found.motions_by_phase.share.reshape(-1, len(PHASES)).tolist(),
            "rms_N": found.motions_by_phase.deviation.reshape(-1, len(PHASES)).tolist(),
            "time": found.motions_by_phase.time.reshape(-1, len(PHASES)).tolist(),
        },
        "coordinates": [_explained(one) for one in found.by_coordinate],
        "parity": {"even": _explained(found.parity[0]), "odd": _explained(found.parity[1])},
        "scatter": [_explained(one) for one in found.scatter],
    }


def _shares(shares: Shares) -> list[dict[str, Any]]:
    return [
        {
            "name": shares.names[i],
            "share": float(shares.share[i]),
            "low": float(shares.low[i]),
            "high": float(shares.high[i]),
            "time": float(shares.time[i]),
            "rms_N": float(shares.deviation[i]),
        }
        for i in shares.ranked()
    ]


def _explained(one: Explained) -> dict[str, Any]:
    return {
        "name": one.name,
        "unit": one.unit,
        "share": one.share,
        "low": one.low,
        "high": one.high,
        "p": one.p,
        "turning": one.turning,
        "pitch_m": one.pitch,
        "knots": one.knots.tolist(),
        "curve": one.curve.tolist(),
        "turned": one.turned.tolist(),
    }


def pictures(found: Where, candidate: Candidate, records: Sequence[Record], pieces: Sequence[Piece]) -> dict[str, Any]:
    """The unknown force that a candidate leaves: over time with its band, over the motions that hold most of it, and
    its spectra; SI."""
    return {
        "force": [_over_time(found, record, i) for i, record in enumerate(records)],
        "courses": _courses(found, records, pieces),
        "spectrum": _spectrum(found, candidate, records),
        "periods": _periods(found),
    }


def _over_time(found: Where, record: Record, index: int) -> dict[str, Any]:
    """Mean of the slow force over equal spans of one record, and the fast one's extremes within them."""
    edges = np.linspace(0, record.position.size, min(POINTS, record.position.size) + 1).astype(int)[:-1]
    slow, fast = found.slow.values[index], found.fast.values[index]
    count = np.diff(np.append(edges, record.position.size))
    return {
        "time_s": ((edges + 0.5 * count) * record.sample_time).tolist(),
        "slow_N": (np.add.reduceat(slow, edges) / count).tolist(),
        "fast_low_N": np.minimum.reduceat(fast, edges).tolist(),
        "fast_high_N": np.maximum.reduceat(fast, edges).tolist(),
        "reference_m": record.reference[edges].tolist(),
        "slow_deviation_N": found.slow.deviation,
        "fast_deviation_N": found.fast.deviation,
    }


def _courses(found: Where, records: Sequence[Record], pieces: Sequence[Piece]) -> list[dict[str, Any]]:
    """The likely force over the kinds of motion that hold most of it: mean and deviation over equal motions."""
    groups = list(repeated(pieces, records)) or [(i,) for i in range(len(pieces))]
    energy = []
    for group in groups:
        members = [_part(found.likely.values, pieces[i]) for i in group]
        energy.append(float(np.mean([np.sum(one**2) for one in members])))
    kept: dict[MotionKind, dict[str, Any]] = {}
    for i in np.argsort(energy)[::-1]:
        piece, group = pieces[groups[i][0]], groups[i]
        if piece.kind not in kept and len(kept) < COURSES:
            kept[piece.kind] = _course(found, records, [pieces[j] for j in group])
    return list(kept.values())


def _part(values: Sequence[Array], piece: Piece) -> Array:
    return values[piece.record][piece.start : piece.stop]


def _course(found: Where, records: Sequence[Record], group: Sequence[Piece]) -> dict[str, Any]:
    members = np.array([_part(found.likely.values, piece) for piece in group])
    ts, first = records[0].sample_time, group[0]
    step = max(members.shape[1] // COURSE, 1)
    scatter = members.std(axis=0, ddof=1) if len(group) > 1 else np.zeros(members.shape[1])
    reference = _part([record.reference for record in records], first)
    return {
        "name": str(first.kind),
        "motions": len(group),
        "time_s": (np.arange(members.shape[1]) * ts)[::step].tolist(),
        "force_N": members.mean(axis=0)[::step].tolist(),
        "scatter_N": scatter[::step].tolist(),
        "deviation_N": found.likely.deviation,
        "reference_m": (reference - reference[0])[::step].tolist(),
    }


def _spectrum(found: Where, candidate: Candidate, records: Sequence[Record]) -> dict[str, Any]:
    """Power density of the fast force, and of what the scale's noise makes of it, over frequency."""
    ts = records[0].sample_time
    length = min(8192, *(record.position.size for record in records))
    parts = [welch(values, 1 / ts, nperseg=length, detrend="linear") for values in found.fast.values]
    frequency = parts[0][0][1:]
    sizes = np.array([record.position.size for record in records], float)
    power = np.average([part[1][1:] for part in parts], axis=0, weights=sizes)
    response = answer(candidate, ts, FAST)[0]
    floor = 2 * ts * noise(candidate.machine) ** 2 * np.abs(np.fft.rfft(response)) ** 2
    there = np.interp(frequency, np.fft.rfftfreq(response.size, ts), floor)
    edges = np.unique(np.geomspace(1, frequency.size, LINES).astype(int) - 1)
    count = np.diff(np.append(edges, frequency.size))
    return {
        "frequency_Hz": (np.add.reduceat(frequency, edges) / count).tolist(),
        "force_N2_per_Hz": (np.add.reduceat(power, edges) / count).tolist(),
        "noise_N2_per_Hz": (np.add.reduceat(there, edges) / count).tolist(),
    }


def _periods(found: Where) -> dict[str, Any] | None:
    """Share of the force's variance that sines of the place take, over their period; None where there is no way."""
    place = next((one for one in found.coordinates if one.name == "position"), None)
    if place is None or float(np.ptp(place.values[found.samples.counts])) < 1.5 * PITCHES[0]:
        return None
    every = np.ones(int(found.samples.motion.max()) + 1, bool)
    inverse, gain = periodogram(found.force, place.values, found.samples, every)
    whole = max(float(np.sum(found.force**2)), 1e-300)
    return {"period_m": (1 / inverse).tolist(), "share": (gain / whole).tolist()}
