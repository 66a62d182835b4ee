"""The outcomes of the two validations: as results, beside the published ones, and as the study's checks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from design.deadbeat import Deadbeat
from design.validation import Validation, agreement
from models.machine import Machine, Specification, load
from studies.study import Check
from studies.wording import cited

SHOWN: Final = 4.0  # Settling times of each motion that results.json keeps, for the figures.
AGREEMENT: Final = 0.03  # The largest relative difference at which a result agrees with the published one.
RESIDUAL_LIMIT: Final = 1e-9  # The largest residual after a deadbeat's settling time, relative to the stroke.


def validation_results(wanted: Specification, validation: Validation) -> dict[str, Any]:
    """Every motion's outcome, and the signals of each motion's first SHOWN settling times."""
    response = validation.response
    ts = response.record.sample_time
    shown = round(min(SHOWN * wanted.settling_time, wanted.interval) / ts)
    motions = []
    for one in validation.achieved:
        part = slice(one.motion.start, min(one.motion.stop, one.motion.start + shown))
        motions.append(
            {
                "origin_m": one.motion.origin,
                "target_m": one.motion.target,
                "reversal": one.motion.reversal,
                "positive": one.motion.direction > 0,
                "settling_s": one.settling_time,
                "overshoot_m": one.overshoot,
                "peak_thrust_N": one.peak_thrust,
                "position_m": response.position[part],
                "reference_m": response.record.reference[part],
                "friction_N": response.friction[part],
            }
        )
    return {
        "time_s": np.arange(shown) * ts,
        "motions": motions,
        "dispersion_m": validation.dispersion[:shown],
        "worst_dispersion_m": validation.worst_dispersion,
        "repeats": validation.periods,
        "repeat_error_m": validation.repeat_error,
    }


def beside_the_paper(machine: Machine, without: Validation, with_rfm: Validation) -> list[dict[str, Any]]:
    """The published outcomes beside those here; empty for a machine of which none are published."""
    published = machine.published
    if published is None:
        return []
    target = machine.specification.settling_time
    rows = (
        (
            "settling of the reversal, without compensation",
            "published.reversal_settling_time",
            "s",
            without.reversal.settling_time,
        ),
        (
            "settling of the reversal, with compensation, at most",
            "specification.settling_time",
            "s",
            with_rfm.reversal.settling_time,
        ),
        (
            "3 sigma after the settling time, without compensation",
            "published.dispersion_without",
            "m",
            without.worst_dispersion,
        ),
        (
            "3 sigma after the settling time, with compensation",
            "published.dispersion_with",
            "m",
            with_rfm.worst_dispersion,
        ),
    )
    listed = []
    for name, key, unit, here in rows:
        part, field = key.split(".")
        printed, source = getattr(getattr(machine, part), field), machine.sources[key]
        difference = here / printed - 1
        agrees = here <= target if part == "specification" else abs(difference) <= AGREEMENT
        said = {"paper": printed, "here": here, "difference": difference, "agrees": bool(agrees)}
        listed.append({"name": name, "unit": unit, **said, "source": f"{source.kind}: {source.detail}"})
    return listed


def checks_of(
    machine: Machine,
    wanted: Mapping[str, Any],
    deadbeat: Deadbeat,
    proof: Mapping[str, Any],
    without: Validation,
    with_rfm: Validation,
    over_runs: Mapping[str, Any],
) -> tuple[Check, ...]:
    """What the design and its validations have to hold: the deadbeat's residual and peak, settling and dispersion on
    the nonsmooth machine, and what is published of it. over_runs: settling times' scatter with compensation."""
    specification, drive = machine.specification, machine.drive
    in_time, source = specification.settling_time, cited(machine, "specification.settling_time")
    peak = float(np.max(np.abs(deadbeat.thrust)))
    largest = with_rfm.peak_thrust
    found = [
        Check("remains after the settling time, of the stroke", proof["residual"], "1", RESIDUAL_LIMIT, "deadbeat"),
        Check("peak of u_ff", peak, "N", wanted["thrust_limit_N"] * (1 + 1e-6), "rated thrust less friction's share"),
        Check("peak of u_M with compensation", largest, "N", drive.rated_thrust, "drive.rated_thrust"),
        *(
            Check(f"settling with compensation, {name}", max(one.settling_time for one in group), "s", in_time, source)
            for name, group in (
                ("positive motions", with_rfm.positive),
                ("all motions", with_rfm.achieved),
            )
        ),
        Check(
            "settling with compensation, 95 % of the runs with a dither",
            over_runs["slowest"]["quantile_s"],
            "s",
            in_time,
            source,
        ),
        Check(
            "difference to the period before", with_rfm.repeat_error, "m", agreement(machine), "simulation is periodic"
        ),
    ]
    published = machine.published
    if published is not None:
        line, reversal = published.dispersion_with, without.reversal.settling_time
        late, spread = (cited(machine, f"published.{name}") for name in ("reversal_settling_time", "dispersion_with"))
        if _is_the_published_table(machine):  # any other machine may well be better without compensation
            found += [
                Check("settling of the reversal without compensation", reversal, "s", in_time, late, ">="),
                Check("3 sigma without compensation", without.worst_dispersion, "m", line, spread, ">="),
            ]
        found.append(Check("3 sigma with compensation", with_rfm.worst_dispersion, "m", line, spread))
    return tuple(found)


def _is_the_published_table(machine: Machine) -> bool:
    """Whether the machine is the paper's table and not a copy of its file with other values."""
    table = load()
    return all(
        getattr(machine, part) == getattr(table, part)
        for part in ("drive", "scale", "plant", "friction", "control", "specification", "effects", "published")
    )
