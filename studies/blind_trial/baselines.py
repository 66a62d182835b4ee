"""The answers of simpler methods to the same records, from the same nominal re-fit: the diagnosis has to beat them.

refit_only         the nominal parameters re-fitted, no effect named
aic_forward        effects of the catalogue added one by one while Akaike's criterion falls: without thresholds from a
                   simulated null, held-out data or a test of the model's adequacy
sparse_regression  the unknown force on a library of functions of time, position, speed and command by sequentially
                   thresholded least squares (SINDy: Brunton, Proctor and Kutz 2016, PNAS 113), as in pysindy
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.diagnose import Diagnosis
from diagnosis.model.fit import weights
from diagnosis.model.residual import columns
from diagnosis.records.motions import numbered
from diagnosis.where.force import SLOW_WALK, smoothed_force
from diagnosis.which.detectors.scan import NuisanceProjection, partial_out, quadratures
from models.effects.base import parameters
from models.effects.catalogue import in_order
from models.nominal_file import load
from models.records.record import Record
from studies.blind_trial.packs import Pack

Array = NDArray[np.float64]

MAX_EFFECTS: Final = 3  # The largest number of effects in an answer.
LEFT: Final = 1.0  # Innovation variance, relative to the noise, above which an effect is missing.
PITCHES: Final = (8e-3, 15e-3, 30e-3, 60e-3)  # [m]
STRIBECK: Final = 2e-3  # [m/s]
# Candidates for the sparsity threshold, in standard deviations of the unknown force.
THRESHOLDS: Final = (0.05, 0.1, 0.2, 0.3, 0.4, 0.6)
RIDGE: Final = 0.03  # Relative to the number of samples; functions of position are nearly collinear.
EXPLAINED: Final = 0.1  # The least share of the unknown force's held-out variance to explain before naming any effect.


def catalogue(pack: Pack) -> tuple[str, ...]:
    """The names of the effects searched for in the machine of a pack."""
    return tuple(load(pack.cases[0].nominal).kinds)


def answers(found: Diagnosis, disabled: Collection[str]) -> dict[str, Any]:
    """Each baseline's answer, as {"verdict"}, to a diagnosed case, from the same seed and records."""
    nominal = found.baseline.nominal
    missing = nominal.candidate.rough or float(np.mean(np.square(nominal.innovations))) > LEFT
    return {
        "refit_only": _verdict((), missing),
        "aic_forward": _verdict(_aic(found, disabled), missing),
        "sparse_regression": _verdict(_sparse(found, disabled), missing),
    }


def _verdict(names: Sequence[str], missing: bool) -> dict[str, Any]:
    outcome = "attributed" if names else "none_of_these" if missing else "parameters"
    return {"verdict": {"outcome": outcome, "effects": list(names), "equivalent": []}}


def _aic(found: Diagnosis, disabled: Collection[str]) -> tuple[str, ...]:
    """Names in the order in which Akaike's criterion selects them; every effect in its best shape by itself."""
    projection = partial_out(found.baseline.nominal, _segments(found))
    effects = [
        one.effect
        for one in found.stages[0].scanned
        if one.effect is not None and one.name not in disabled and one.in_sample_gain > 0
    ]
    blocks = [_columns(found, projection, effect) for effect in effects]
    if not blocks:
        return ()
    whole, owner = np.hstack(blocks), np.repeat(np.arange(len(blocks)), [block.shape[1] for block in blocks])
    gram, slope = whole.T @ whole, whole.T @ projection.e
    prices = [2.0 * len(parameters(type(effect))) for effect in effects]
    chosen: list[int] = []
    for _ in range(MAX_EFFECTS):
        falls = {
            k: _gain(gram, slope, np.isin(owner, [*chosen, k])) - sum(prices[i] for i in (*chosen, k))
            for k in range(len(blocks))
            if k not in chosen
        }
        here = _gain(gram, slope, np.isin(owner, chosen)) - sum(prices[i] for i in chosen)
        best = max(falls, key=lambda k: falls[k], default=None)
        if best is None or falls[best] <= here:
            break
        chosen.append(best)
    return tuple(effects[k].name for k in chosen)


def _gain(gram: Array, slope: Array, inside: NDArray[np.bool_]) -> float:
    """The reduction of chi-square by these columns."""
    part = gram[np.ix_(inside, inside)]
    return float(slope[inside] @ np.linalg.lstsq(part, slope[inside], rcond=None)[0]) if inside.any() else 0.0


def _segments(found: Diagnosis) -> NDArray[np.int64]:
    return numbered(found.baseline.pieces, found.baseline.records)


def _columns(found: Diagnosis, projection: NuisanceProjection, effect: Any) -> Array:
    """The effect's influence on the innovations, with the nominal parameters partialled out (n, k)."""
    fitted = found.baseline.nominal
    variants = [in_order((*fitted.candidate.effects, variant)) for variant in quadratures(effect)]
    given = columns(fitted.candidate, variants, found.baseline.records, fitted.paths, fitted.residuals, fitted.walk)
    return projection(given * weights(found.baseline.records)[:, None])


def _sparse(found: Diagnosis, disabled: Collection[str]) -> tuple[str, ...]:
    """The classes of the functions that thresholded least squares keeps, by the variance they explain."""
    from pysindy import STLSQ

    force = np.concatenate(smoothed_force(found.baseline.nominal, found.baseline.records, SLOW_WALK).values)
    library = [
        _library(one, seen) for one, seen in zip(found.baseline.records, found.baseline.nominal.paths, strict=True)
    ]
    names = [name for name in library[0] if name not in disabled]
    whole = np.hstack([np.concatenate([one[name] for one in library]) for name in names])
    owner = np.repeat(names, [library[0][name].shape[1] for name in names])
    size = whole.std(axis=0)
    keep = size > 0
    whole, owner, scale = whole[:, keep] / size[keep], owner[keep], float(force.std()) or 1.0
    whole, force = whole - whole.mean(axis=0), (force - force.mean()) / scale
    train = _segments(found) % 2 == 0
    best, least = np.zeros(owner.size), float(np.mean(force[~train] ** 2))
    for threshold in THRESHOLDS:
        fitted = STLSQ(threshold=threshold, alpha=RIDGE * np.count_nonzero(train)).fit(whole[train], force[train, None])
        weight = np.asarray(fitted.coef_).ravel()
        rest = float(np.mean((force[~train] - whole[~train] @ weight) ** 2))
        if rest < least:
            best, least = weight, rest
    if least > (1 - EXPLAINED) * float(np.mean(force[~train] ** 2)):
        return ()
    shares = {name: float(np.mean((whole[:, owner == name] @ best[owner == name]) ** 2)) for name in names}
    strong = sorted((name for name in names if shares[name] > 0), key=lambda name: -shares[name])
    return tuple(strong[:MAX_EFFECTS])


def _library(record: Record, seen: Any) -> Mapping[str, Array]:
    """For each effect, functions (n, k) of time, position, speed and command that resemble it."""
    x, v, u = seen.path.at_samples, seen.path.speed.mean(axis=1), record.command
    t = np.arange(x.size) * record.sample_time
    turn = np.tanh(v / 1e-4)
    waves = np.stack([wave(2 * np.pi * x / pitch) for pitch in PITCHES for wave in (np.sin, np.cos)], axis=1)
    jerk = np.gradient(u, record.sample_time)
    functions = {
        "viscous_friction": v,
        "stribeck": turn * np.exp(-np.abs(v) / STRIBECK),
        "directional_friction": np.abs(turn),
        "position_dependent_friction": turn[:, None] * waves,
        "friction_drift": turn * t,
        "cogging": waves,
        "thrust_ripple": u[:, None] * waves,
        "gain_asymmetry": np.abs(u),
        "thrust_saturation": u**3,
        "current_loop_lag": jerk,
        "amplifier_deadband": np.tanh(u),
        "cable_spring": x,
        "scale_drift": t,
    }
    return {name: np.reshape(one, (x.size, -1)) for name, one in functions.items()}
