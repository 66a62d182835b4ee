"""The outcomes of the two validations: as results, beside the published ones, and as the study's checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from design.deadbeat import Deadbeat
from design.validation import Validation, repeats_within
from models.machine import Machine, Specification, load
from models.quantity import show
from studies.scattered import high_end
from studies.study import Check
from studies.wording import cited

KEPT_SETTLING_TIMES: Final = 4.0  # Settling times of each motion that results.json keeps, for the figures.
AGREEMENT: Final = 0.03  # The largest relative difference, either way, at which a published figure is reproduced.
RESIDUAL_LIMIT: Final = 1e-9  # The largest residual after a deadbeat's settling time, relative to the stroke.


def validation_results(wanted: Specification, validation: Validation) -> dict[str, Any]:
    """Every motion's outcome, and the signals of each motion's first KEPT_SETTLING_TIMES settling times."""
    response = validation.response
    ts = response.record.sample_time
    shown = round(min(KEPT_SETTLING_TIMES * wanted.settling_time, wanted.interval) / ts)
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


def beside_the_paper(
    machine: Machine, wanted: Mapping[str, Any], without: Validation, with_rfm: Validation
) -> list[dict[str, Any]]:
    """The published outcomes beside those here; empty for a machine of which none are published.

    A published figure is reproduced or missed, either way, within AGREEMENT; a published bound (tolerance None) is met
    or not. Neither is judged (agrees None) on a machine that bears the paper's figures but is not the paper's table,
    nor for a motion other than the one that they are of; and neither is a check of the design, which is judged by the
    specification.
    """
    published = machine.published
    if published is None:
        return []
    specification = machine.specification
    motion = (wanted["stroke_m"], wanted["settling_time_s"])
    same = motion == (specification.stroke, specification.reference_settling_time)
    judged = same and (_is_the_published_table(machine) or published != load().published)
    target = specification.settling_time
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
        difference, bound = here / printed - 1, part == "specification"
        agrees = bool(here <= target if bound else abs(difference) <= AGREEMENT) if judged else None
        said = {"paper": printed, "here": here, "difference": difference, "agrees": agrees}
        said["tolerance"] = None if bound else AGREEMENT
        listed.append({"name": name, "unit": unit, **said, "source": f"{source.kind}: {source.detail}"})
    return listed


def reproduction(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """A line for each published figure that is judged, as `beside_the_paper` lists them: reproduced or missed."""
    return [
        (
            f"{'agrees' if row['agrees'] else 'MISSED'} published figure, {row['name']}",
            f"{show(row['here'], row['unit'])} (published {show(row['paper'], row['unit'])} ± {row['tolerance']:.0%}, "
            f"off by {row['difference']:+.0%}; not a check of the design)",
        )
        for row in rows
        if row["agrees"] is not None and row["tolerance"] is not None
    ]


def checks_of(
    machine: Machine,
    wanted: Mapping[str, Any],
    deadbeat: Deadbeat,
    proof: Mapping[str, Any],
    with_rfm: Validation,
    over_runs: Mapping[str, Any],
) -> tuple[Check, ...]:
    """What the design and its validation have to hold: the deadbeat's residual and peak, and the specification on the
    nonsmooth machine. over_runs: settling times' scatter with compensation."""
    specification, drive = machine.specification, machine.drive
    in_time, source = specification.settling_time, cited(machine, "specification.settling_time")
    peak = float(np.max(np.abs(deadbeat.thrust)))
    largest = with_rfm.peak_thrust
    return (
        Check("remains after the settling time, of the stroke", proof["residual"], "1", RESIDUAL_LIMIT, "deadbeat"),
        Check("peak of u_ff", peak, "N", wanted["thrust_limit_N"] * (1 + 1e-6), wanted["thrust_limit_source"]),
        Check("peak of u_M with compensation", largest, "N", drive.rated_thrust, "drive.rated_thrust"),
        *(
            Check(f"settling with compensation, {name}", max(one.settling_time for one in group), "s", in_time, source)
            for name, group in (
                ("positive motions", with_rfm.positive),
                ("all motions", with_rfm.achieved),
            )
        ),
        Check(
            f"settling with compensation, runs with a dither: {high_end(over_runs['runs'])}",
            over_runs["slowest"]["quantile_s"],
            "s",
            in_time,
            source,
        ),
        Check(
            "difference to the period before",
            with_rfm.repeat_error,
            "m",
            repeats_within(machine),
            "simulation is periodic",
        ),
    )


def _is_the_published_table(machine: Machine) -> bool:
    """Whether the machine is the paper's table and not a copy of its file with other values."""
    table = load()
    return all(
        getattr(machine, part) == getattr(table, part)
        for part in ("drive", "scale", "plant", "friction", "control", "specification", "effects", "published")
    )
