"""How rough a drive is, and whether the deviations that its model states hold, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from models.quantity import listed, show
from studies.wording import effect

Results = Mapping[str, Any]

# Times its expectation, from which on chi-square per sample is said to be far from it.
MAX_CHI_SQUARE_RATIO: Final = 2.0
# Times what the machine as delivered leaves, beyond which a simulated scatter is no noise floor.
MAX_FLOOR_RATIO: Final = 1.5


def is_no_floor(far: Results) -> bool:
    """Whether records that the model made itself scatter by far more than the machine as delivered leaves of the axis's
    own: in simulation it swings or hunts by that much, and that scatter is no noise floor."""
    floor, left = far["floor"], far["gap_as_delivered"]
    more = (floor[key] > MAX_FLOOR_RATIO * left[key] for key in ("force_N", "position_m"))
    return far["floor_source"] != "repeats" and any(more)


def no_floor_told(far: Results) -> list[str]:
    """What is said of a noise floor that is none; nothing of others."""
    if not is_no_floor(far):
        return []
    scatter, left = (
        f"{show(gap['force_N'], 'N', 2)} and {show(gap['position_m'], 'm', 2)}"
        for gap in (far["floor"], far["gap_as_delivered"])
    )
    return [
        f"Records that the model made itself scatter by {scatter}, where the machine as delivered leaves {left} of "
        "those given: in simulation it swings or hunts in another way each time, so that this is no noise floor, and "
        "closures beside it tell little."
    ]


def roughness(results: Results) -> list[str]:
    """How rough the drive is, and whether the weights hold: what is left of each record, as a variance in that which
    they promise; in sentences."""
    force, told = results["white_force_N"], []
    taken = show(force["taken"], "N", 2)
    biased = listed([f"{effect(one['name'])} by {one['tolerances']:.2g}" for one in force.get("biased", ())])
    moves = (
        f"the re-fit moves values by some of their tolerances ({biased}); the thresholds of all effects allow for it, "
        "values count as wrong by what they are off beyond that, and the re-fitted ones are not the axis's."
    )
    if force["interpolated"] and force["taken"] > force["usual"]:
        told.append(
            f"{_rough_logs(force)} samples of the controller, and the commands between are interpolated: as the loop "
            "answers the noise of every reading, this leaves, beside the unknown force, which is slower, a force that "
            f"scatters by {taken} from sample to sample, and hides what is smaller. Only a log of all samples tells "
            "whether the drive is rougher than its model, too."
        )
        told += [f"On simulated logs like that of a machine with nothing wrong, {moves}"] if biased else []
    elif biased:
        told.append(
            "The scale is coarse for contacts that slip so soon: on simulated tables with nothing wrong, " + moves
        )
    elif force["taken"] > force["usual"] and not force.get("may_be_noise", True):
        told.append(
            f"What is left is as large as a force that scatters by {taken} from sample to sample would leave, but is "
            "no such noise, as it is not alike at all times: the model lacks something else. What is smaller is hidden."
        )
    elif force["taken"] > force["usual"]:
        told.append(
            "The drive is rougher than its model: beside the unknown force, which is slower, its force scatters by "
            f"{taken} from sample to sample, which no effect of the catalogue describes, unless "
            "it is the model that lacks something as fast, such as friction at another place or a mode that friction "
            "stiffens."
        )
    left, far = results["chi_square_per_sample"]["with_effects"], far_off(results)
    if far:
        each = listed(f"{one:.2g} in record {number}" if len(left) > 1 else f"{one:.2g}" for number, one in far)
        told.append(
            f"Chi-square per sample is {each} where 1 was expected, so that the stated deviations are too "
            f"{_small_or_large([one for _, one in far])}{_weighed(results)}."
        )
    return told


def _rough_logs(force: Results) -> str:
    """Which records are rough as their logs have one of several samples of the controller, in words; force [N]."""
    of: dict[int, list[str]] = {}
    for number, (white, every) in enumerate(zip(force["by_record"], force["log_has_one_of"], strict=True), 1):
        if every > 1 and white > force["usual"]:
            of.setdefault(every, []).append(f"{number}")
    said = listed([f"{_records(numbers)} one of {every}" for every, numbers in of.items()])
    return f"R{said[1:]}"


def _records(numbers: Sequence[str]) -> str:
    return f"records {listed(numbers)} have" if len(numbers) > 1 else f"record {numbers[0]} has"


def _small_or_large(far: Sequence[float]) -> str:
    """What deviations are with so much chi-square per sample [1] of each record."""
    small, large = (any(sign * math.log(one) > 0 for one in far) for sign in (1, -1))
    return "small for some and too large for others" if small and large else "small" if small else "large"


def _weighed(results: Results) -> str:
    """By which noise the detection limits go, where the scale's does not explain what is left."""
    weighed = results["where"]["details"].get("weighed") or {}
    walk = weighed.get("walk_N_per_sample")
    if walk is None:
        return ""
    left = listed(f"{one:.2g}" for one in weighed["chi_square_per_sample"])
    return (
        f"; detection limits take what is left for a force that walks at random by {show(walk, 'N', 2)} a sample, "
        f"beside which chi-square per sample is {left}"
    )


def far_off(results: Results) -> list[tuple[int, float]]:
    """The records, by number, whose chi-square per sample [1] is far from what their weights promise, and that."""
    left = results["chi_square_per_sample"]["with_effects"]
    return [
        (number, one) for number, one in enumerate(left, 1) if not 1 / MAX_CHI_SQUARE_RATIO < one < MAX_CHI_SQUARE_RATIO
    ]
