"""The sentences of where: each says what was found, and only that."""

from __future__ import annotations

from types import SimpleNamespace

from diagnosis.where.sentences import _drive


def test_a_drive_that_follows_beyond_its_rating_is_said() -> None:
    said = list(_drive(SimpleNamespace(beyond_rating=158.12)))  # type: ignore[arg-type]
    assert [one.text for one in said] == [
        "The drive followed commands of up to 158 N, more than the rated thrust of the machine file."
    ]
    assert not list(_drive(SimpleNamespace(beyond_rating=None)))  # type: ignore[arg-type]
