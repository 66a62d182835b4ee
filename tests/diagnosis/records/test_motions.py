"""Records cut into motions: their kinds in words and as data, and how many a diagnosis needs."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from diagnosis.records.motions import FEWEST, MotionKind, check_count, pieces, repeated
from models.records.record import Record
from models.records.tables.sizes import RecordError

TS = 1e-3
LOOP = 3.6e-3  # s


def record(*targets: float, excited: bool = False) -> Record:
    """Straight moves [m] of 0.1 s from one target to the next, each followed by 0.2 s of rest."""
    parts = [np.concatenate([np.linspace(a, b, 100), np.full(200, b)]) for a, b in pairwise((0.0, *targets))]
    reference = np.concatenate([np.zeros(100), *parts])
    force = np.sin(np.arange(reference.size)) if excited else np.zeros(reference.size)
    target = np.concatenate([np.zeros(100), *(np.full(300, part[-1]) for part in parts)])
    return Record(TS, target, reference, force, force, reference)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (MotionKind(10**-4.5, 1e-3), "moves of 18 to 56 µm at 0.56 to 1.8 mm/s"),
        (MotionKind(1e-2, 10**-0.5), "moves of 5.6 to 18 mm at 180 to 560 mm/s"),
        (MotionKind(1e-1, 10.0), "moves of 56 to 180 mm at 5.6 to 18 m/s"),
        (MotionKind(1e-6, 1e-5), "moves of 0.56 to 1.8 µm at 5.6 to 18 µm/s"),
        (MotionKind(), "rest"),
        (MotionKind(excited=True), "the excitation at rest"),
    ],
)
def test_a_kind_has_its_words(kind: MotionKind, text: str) -> None:
    assert str(kind) == text
    assert kind.rests == (text == "rest")


def test_moves_of_nearly_one_size_are_of_one_kind_and_equal_ones_repeat() -> None:
    back_and_forth = record(10e-6, 0.0, 10e-6, 0.0, 11e-6, 0.0)
    moving = [piece for piece in pieces([back_and_forth]) if not piece.kind.rests]
    (kind,) = {piece.kind for piece in moving}
    assert (kind.stroke, kind.speed) == pytest.approx((1e-5, 1e-4))
    assert [piece.direction for piece in moving] == [1, -1] * 3
    groups = repeated(moving, [back_and_forth])
    assert sorted(groups) == [(0, 2), (1, 3)], "the last two moves are longer"


def test_steps_of_a_reference_that_is_the_target_are_motions_that_repeat() -> None:
    """Within a piece such a reference stands still: it jumps on its first sample."""
    moves = record(10e-6, 0.0, 10e-6, 0.0, 11e-6, 0.0)
    stepping = replace(moves, reference=moves.target)
    rest, *moving = pieces([stepping])
    assert rest.kind.rests
    (kind,) = {piece.kind for piece in moving}
    assert (kind.stroke, kind.speed) == pytest.approx((1e-5, 1e-2))
    assert [piece.direction for piece in moving] == [1, -1] * 3
    assert [piece.origin for piece in moving] == [0.0, 10e-6, 0.0, 10e-6, 0.0, 11e-6]
    assert sorted(repeated(moving, [stepping])) == [(0, 2), (1, 3)], "the last two moves are longer"


def test_what_happens_at_rest_is_a_kind() -> None:
    (piece,) = pieces([record(excited=True)])
    assert piece.kind == MotionKind(excited=True)


def test_too_few_motions_are_refused() -> None:
    with pytest.raises(RecordError, match=f"too few.*give {FEWEST} or more"):
        check_count([record(1e-5, 0.0)], LOOP)
    check_count([record(*([1e-5, 0.0] * FEWEST))], LOOP)
    with pytest.raises(RecordError, match="too few"):
        check_count([record(*([1e-5, 0.0] * FEWEST))], 100 * LOOP)  # a slow loop's motions are longer
