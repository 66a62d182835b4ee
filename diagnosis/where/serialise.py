"""What was located as results.json holds it: the agreed keys, and the data of the figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from diagnosis.model.residual import Candidate
from diagnosis.records.motions import MotionKind, Piece, repeated
from diagnosis.records.units import noise
from diagnosis.where.controller import Replayed
from diagnosis.where.coordinates import Explained, periodogram, pitches
from diagnosis.where.energy import PHASES, Shares, bands
from diagnosis.where.force import FAST_WALK, smoother_response
from diagnosis.where.locate import Where
from diagnosis.where.sentences import added_in_words, statements
from diagnosis.where.side import force_or_reading
from models.records.record import Record

Array = NDArray[np.float64]

COURSE_POINTS: Final = 600  # points of the force over a whole record
COURSE: Final = 300  # points of the force over one motion
SPECTRUM_LINES: Final = 80  # lines of a spectrum
STRETCHES: Final = 20  # of time in which a signal was added, that are kept
COURSES: Final = 3  # kinds of motion whose force is kept


def to_json(where: Where) -> dict[str, Any]:
    """Shares by name, the statements with their topics, and under "details" all shares with their intervals; SI."""
    stated, between = statements(where), where.energy.wavelengths
    return {
        "by_motion": {name: float(share) for name, share in _pairs(where.energy.motion)},
        "by_phase": {name: float(share) for name, share in _pairs(where.energy.phase)},
        "by_band_Hz": [
            [low, high, float(share)]
            for (low, high), share in zip(bands(where.sample_time), where.energy.band.share, strict=True)
        ],
        "by_wavelength_m": [
            [low, high, float(share)]
            for low, high, share in zip((0.0, *between), (*between, None), where.energy.wavelength.share, strict=True)
        ],
        "by_coordinate": where.by_coordinate,
        "statements": [one.text for one in stated],
        "topics": [one.topic.value for one in stated],
        "details": _details(where),
    }


def _pairs(shares: Shares) -> list[tuple[str, float]]:
    return [(shares.names[i], float(shares.share[i])) for i in shares.ranked()]


def _details(where: Where) -> dict[str, Any]:
    return {
        "force_rms_N": where.deviation,
        "noise_rms_N": where.unknown.noise,
        "walk_N_per_sample": where.unknown.likely.walk,
        "weighed": {"walk_N_per_sample": where.walk, "chi_square_per_sample": list(where.variance)},
        "side": force_or_reading(where.sides, where.criteria),
        "sides": [
            {"coordinate": one.coordinate, "force": one.force, "reading": one.reading, "pitch_m": one.pitch}
            for one in where.sides
        ],
        "floor": {
            "source": where.unknown.floor.source,
            "force_N": where.unknown.floor.force,
            "position_m": where.unknown.floor.position,
            "innovations": where.unknown.floor.innovations,
            "groups": where.unknown.floor.groups,
            "motions": where.unknown.floor.motions,
            "repeats": where.unknown.floor.repeats,
        },
        "ceiling": {
            "share": where.dependence.ceiling[0],
            "low": where.dependence.ceiling[1],
            "high": where.dependence.ceiling[2],
        },
        "controller": [
            {
                "replays": one.replays,
                "checked": one.checked,
                "why_not": one.why_not,
                "every": one.every,
                "largest_N": one.largest,
                "rms_N": one.rms,
                "tolerance_N": one.tolerance,
                "departs_at_sample": one.departs,
                "would_fit": one.remedy,
                "would_leave_N": one.remains,
                "command_late_samples": one.command_late,
                "mislogged": one.mislogged,
                "other_structure": one.other,
                "added": _added(one, where.sample_time),
            }
            for one in where.controller
        ],
        "maps": {
            "motion": _shares(where.energy.motion),
            "phase": _shares(where.energy.phase),
            "band": _shares(where.energy.band),
            "wavelength": _shares(where.energy.wavelength),
        },
        "motion_by_phase": {
            "motions": [str(kind) for kind in where.samples.kinds],
            "phases": list(PHASES),
            "share": where.energy.motion_and_phase.share.reshape(-1, len(PHASES)).tolist(),
            "rms_N": where.energy.motion_and_phase.deviation.reshape(-1, len(PHASES)).tolist(),
            "time": where.energy.motion_and_phase.time.reshape(-1, len(PHASES)).tolist(),
        },
        "coordinates": [_explained(one) for one in where.dependence.coordinates],
        "parity": {"even": _explained(where.dependence.parity[0]), "odd": _explained(where.dependence.parity[1])},
        "scatter": [_explained(one) for one in where.dependence.scatter],
    }


def _added(one: Replayed, sample_time: float) -> dict[str, Any] | None:
    """The signal that was added behind the controller, and when it acted, STRETCHES times at most."""
    signal = one.added
    if signal is None:
        return None
    return {
        "column": signal.column,
        "mapped": signal.mapped,
        "gain": signal.gain,
        "delay_samples": signal.delay,
        "largest_N": signal.largest,
        "leaves_N": signal.leaves,
        "noise_N": signal.noise,
        "stretches": len(signal.stretches),
        "first_s": [[sample_time * start, sample_time * stop] for start, stop in signal.stretches[:STRETCHES]],
        "in_words": added_in_words(one, signal, "the record", sample_time),
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


def pictures(where: Where, candidate: Candidate, records: Sequence[Record], pieces: Sequence[Piece]) -> dict[str, Any]:
    """The unknown force that a candidate leaves: over time with its band, over the kinds of motion with the largest
    energy, and its spectra; SI."""
    return {
        "force": [_over_time(where, record, i) for i, record in enumerate(records)],
        "courses": _courses(where, records, pieces, noise(candidate.nominal)),
        "spectrum": _spectrum(where, candidate, records),
        "periods": _periods(where),
    }


def _over_time(where: Where, record: Record, index: int) -> dict[str, Any]:
    """Mean of the slow force over equal spans of one record, and the extremes of the fast one within them."""
    edges = np.linspace(0, record.position.size, min(COURSE_POINTS, record.position.size) + 1).astype(int)[:-1]
    slow, fast = where.unknown.slow.values[index], where.unknown.fast.values[index]
    count = np.diff(np.append(edges, record.position.size))
    return {
        "time_s": ((edges + 0.5 * count) * record.sample_time).tolist(),
        "slow_N": (np.add.reduceat(slow, edges) / count).tolist(),
        "fast_low_N": np.minimum.reduceat(fast, edges).tolist(),
        "fast_high_N": np.maximum.reduceat(fast, edges).tolist(),
        "reference_m": record.reference[edges].tolist(),
        "slow_deviation_N": where.unknown.slow.deviation,
        "fast_deviation_N": where.unknown.fast.deviation,
    }


def _courses(where: Where, records: Sequence[Record], pieces: Sequence[Piece], reading: float) -> list[dict[str, Any]]:
    """The likeliest force over the kinds of motion with the largest energy: mean and deviation over equal motions."""
    groups = list(repeated(pieces, records, reading)) or [(i,) for i in range(len(pieces))]
    energy = []
    for group in groups:
        members = [_part(where.unknown.likely.values, pieces[i]) for i in group]
        energy.append(float(np.mean([np.sum(one**2) for one in members])))
    kept: dict[MotionKind, dict[str, Any]] = {}
    for i in np.argsort(energy)[::-1]:
        piece, group = pieces[groups[i][0]], groups[i]
        if piece.kind not in kept and len(kept) < COURSES:
            kept[piece.kind] = _course(where, records, [pieces[j] for j in group])
    return list(kept.values())


def _part(values: Sequence[Array], piece: Piece) -> Array:
    return values[piece.record][piece.start : piece.stop]


def _course(where: Where, records: Sequence[Record], group: Sequence[Piece]) -> dict[str, Any]:
    members = np.array([_part(where.unknown.likely.values, piece) for piece in group])
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
        "deviation_N": where.unknown.likely.deviation,
        "reference_m": (reference - reference[0])[::step].tolist(),
    }


def _spectrum(where: Where, candidate: Candidate, records: Sequence[Record]) -> dict[str, Any]:
    """Power spectral density of the fast force, and of the part of it that the scale's noise causes."""
    ts = records[0].sample_time
    length = min(8192, *(record.position.size for record in records))
    parts = [
        scipy.signal.welch(values, 1 / ts, nperseg=length, detrend="linear") for values in where.unknown.fast.values
    ]
    frequency = parts[0][0][1:]
    sizes = np.array([record.position.size for record in records], float)
    power = np.average([part[1][1:] for part in parts], axis=0, weights=sizes)
    response = smoother_response(candidate, ts, FAST_WALK)[0]
    floor = 2 * ts * noise(candidate.machine) ** 2 * np.abs(np.fft.rfft(response)) ** 2
    there = np.interp(frequency, np.fft.rfftfreq(response.size, ts), floor)
    edges = np.unique(np.geomspace(1, frequency.size, SPECTRUM_LINES).astype(int) - 1)
    count = np.diff(np.append(edges, frequency.size))
    return {
        "frequency_Hz": (np.add.reduceat(frequency, edges) / count).tolist(),
        "force_N2_per_Hz": (np.add.reduceat(power, edges) / count).tolist(),
        "noise_N2_per_Hz": (np.add.reduceat(there, edges) / count).tolist(),
    }


def _periods(where: Where) -> dict[str, Any] | None:
    """Share of the force's variance that sines of the position explain, over their period; None without travel."""
    place = next((one for one in where.coordinates if one.name == "position"), None)
    if place is None or float(np.ptp(place.values[where.samples.counts])) < 1.5 * pitches(where.samples)[0]:
        return None
    every = np.ones(int(where.samples.motion.max()) + 1, bool)
    inverse, gain = periodogram(where.force, place.values, where.samples, every)
    whole = max(float(np.sum(where.force**2)), 1e-300)
    return {"period_m": (1 / inverse).tolist(), "share": (gain / whole).tolist()}
