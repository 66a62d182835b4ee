"""The exported C gives the reference's bits at every level of optimisation, and its self-test catches every fault."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from design.deployment.c_source import law_sources, selftest_sources
from design.deployment.vectors import golden
from models.deployment.coefficients import Coefficients, load_coefficients
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
    folder = exported(known_of("PID", tmp_path, anti_windup=5e-3), tmp_path)
    assert run(compiled(folder, SOURCES, ("-DAXIS_MAIN", *flags)))[0] == 0


FAULTS = {
    "the reference does not wait": ("late = (law->newest + AXIS_DELAY)", "late = (law->newest + 0 * AXIS_DELAY)"),
    "the reference waits a sample more": ("(law->newest + AXIS_DELAY)", "(law->newest + AXIS_DELAY + 1)"),
    "x_T* one sample late": ("y += POSITION[j]", "y += POSITION[j ? j - 1 : 0]"),
    "one coefficient too few": ("j < AXIS_STEPS", "j < AXIS_STEPS - 1"),
    "sign of u_ff": ("u += THRUST", "u -= THRUST"),
    "sign of the error": ("((law->target[late] - position) +", "((position - law->target[late]) +"),
    "order of the sums": ("((u + compensation) + planned)", "(u + (compensation + planned)) + 0.0 * u + 1e-13"),
    "u_ff left out": ("wanted = law->feedback + ((u +", "wanted = law->feedback + ((0 * u +"),
    "the integral counts before the derivative forgets": ("law->last_error = error;", ""),
    "the derivative is not filtered": ("keep * law->slope", "0 * law->slope"),
    "the integral is lost": ("* error + law->integral +", "* error +"),
    "no anti-windup": ("* excess);", "* 0 * excess);"),
    "anti-windup with the wrong sign": ("thrust - wanted);", "wanted - thrust);"),
    "the limit on one side only": ("return least > -limit ? least : -limit;", "return least;"),
    "elements do not slip": ("law->element[i] = within(law->element[i], LIMIT[i]);", ""),
    "the elements' state is lost": ("add(&law->element[i], &law->element_low[i], step);", "law->element[i] = step;"),
    "the elements follow x_T* but not its base": ("(axis_real)(base - law->last_base) + (", "("),
    "a NaN gets through": ("if (!(position >= -FAR && position <= FAR))", "if (position < -FAR || position > FAR)"),
    "the missing reading becomes 0": ("position = law->last_reading;", "position = 0.0;"),
    "a reset keeps the elements": ("law->element[i] = law->element_low[i] = (axis_real)0.0;", ";"),
    "a reset forgets the thrust": ("law->integral = held", "law->integral = 0 * held"),
    "the wipe comes back a sample late": ("sample <= WIPE_HALF)", "sample <= WIPE_HALF + 1)"),
    "u_rf sets in with a bump after the wipe": ("law->zero = force;", ";"),
    "the status does not say that the thrust is limited": ("status |= AXIS_LIMITED;", ";"),
}


@NEEDS_CC
def test_every_planted_fault_is_caught(tmp_path: Path) -> None:
    folder = exported(known_of("PID", tmp_path, anti_windup=5e-3), tmp_path)
    flags = ("-O0", "-c", "-Wno-unused-function", "-Wno-unused-variable", "-Wno-unused-parameter", "-Wno-error")
    compiled(folder, ["axis_selftest.c"], (*flags, "-DAXIS_MAIN"), "selftest.o")
    source, missed = (folder / "axis_law.c").read_text(encoding="utf-8"), []
    for name, (right, wrong) in FAULTS.items():
        assert right in source, name
        (folder / "axis_law.c").write_text(source.replace(right, wrong), encoding="utf-8")
        if run(compiled(folder, ["axis_law.c", "selftest.o"], flags[:1] + flags[2:]))[0] != 1:
            missed.append(name)
    assert missed == []
    assert len(FAULTS) >= 20


def test_the_vectors_reach_every_branch(tmp_path: Path) -> None:
    """Without a compiler, too: what the self-test would replay."""
    known = known_of("PID", tmp_path)
    found = golden(known, 0)
    assert set(found.status.tolist()) >= {0, 1, 2, 3, 4, 8}
    assert found.asked.size < 4000
    machine, _ = designed("PID")
    assert motions(machine).size > 100
