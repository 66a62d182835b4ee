"""The exported C gives the reference's bits at every level of optimisation, and its self-test catches every fault."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from design.deployment.c_source import law_sources, selftest_sources
from design.deployment.vectors import golden
from models.deployment.coefficients import Coefficients, load_coefficients
from models.deployment.running_law import INIT, LEARN, LEARNING, LIMITED, WIPING
from tests.design.deployment.compiling import NEEDS_CC, compiled, put, run
from tests.models.deployment.laws import KINDS, designed, motions, written


def known_of(kind: str, folder: Path, anti_windup: float = 0.0) -> Coefficients:
    return load_coefficients(written(kind, folder), math.nan, math.nan, anti_windup)


def exported(known: Coefficients, folder: Path) -> Path:
    return put(folder / "c", {**law_sources(known, "a test"), **selftest_sources(known, golden(known, 0))})


SOURCES = ("axis_law.c", "axis_selftest.c")


@NEEDS_CC
@pytest.mark.parametrize("kind", KINDS)
def test_the_self_test_of_every_kind_of_law_agrees_to_the_bit(kind: str, tmp_path: Path) -> None:
    folder = exported(known_of(kind, tmp_path), tmp_path)
    status, said = run(compiled(folder, SOURCES, ("-DAXIS_MAIN", "-O2")))
    assert (status, said.split()[0]) == (0, "all")


@NEEDS_CC
@pytest.mark.parametrize("flags", [("-O0",), ("-O3",), ("-O2", "-DAXIS_FLOAT")], ids=" ".join)
def test_so_it_does_with_every_optimisation_and_in_single_precision_within_its_tolerance(
    flags: tuple[str, ...], tmp_path: Path
) -> None:
    folder = exported(known_of("learning", tmp_path, anti_windup=5e-3), tmp_path)
    assert run(compiled(folder, SOURCES, ("-DAXIS_MAIN", *flags)))[0] == 0


def test_the_vectors_reach_every_branch(tmp_path: Path) -> None:
    """Without a compiler, too: what the self-test would replay."""
    known = known_of("PID", tmp_path)
    found = golden(known, 0)
    assert set(found.status.tolist()) >= {0, 1, 2, 3, 4, 8}
    assert found.asked.size < 4000  # of which most are the wipe
    taught = golden(known_of("learning", tmp_path), 0)
    assert set(taught.status.tolist()) >= {LEARNING, LEARNING | LIMITED, LEARNING | WIPING}
    assert set(taught.asked.tolist()) >= {LEARN, INIT}
    machine, _ = designed("PID")
    assert motions(machine).size > 100
