"""A periodic effect of the user's own, in one file beside the catalogue's, is searched for as the catalogue's are."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import pytest

import models.effects
from diagnosis.diagnose import diagnose
from diagnosis.model.fit import parameters_at_bounds
from diagnosis.records.motions import numbered, pieces
from diagnosis.refit import refit_within
from diagnosis.verdict import Outcome
from diagnosis.which.detectors.scan import partial_out, scan
from models.effects.base import Effect
from models.effects.catalogue import every
from tests.diagnosis.tables import fitted_with, recorded, short, table

MACHINE = table()
PLAN = (short(MACHINE),)

OWN = '''"""What a screw does once a turn."""

import math
from dataclasses import dataclass
from typing import ClassVar

from models.effects.base import Effect, Numbers, X, hook, parameter, period, phase, Place


@hook
def _wobbling(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value * (1.0 + p[0] * math.sin(2.0 * math.pi * now[X] / p[1] + p[2]))


@hook
def _tightening(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    turn = math.sin(math.pi * now[X] / p[1] + 0.5 * p[2])
    return value * (1.0 + p[0] * (math.exp(-4.0 * turn * turn) - 0.5))


@dataclass(frozen=True)
class ScrewRipple(Effect):
    """The thrust varies with the turns of a screw."""

    name: ClassVar = "screw_ripple"
    family: ClassVar = "motor"
    equation: ClassVar = r"u(1 + a \\sin(2 \\pi x/h + \\varphi))"
    source: ClassVar = "assumed"
    hooks: ClassVar = {Place.THRUST: _wobbling}
    part: float = parameter("1", "variation a", 0.01, 0.1, "amplitude", at_least=0)
    lead: float = period("m", "lead h", 2e-3, 1e-2, "position", above=0)
    phase: float = phase()


@dataclass(frozen=True)
class TightSpot(Effect):
    """The friction grows at one angle of a screw: a narrow peak once a turn."""

    name: ClassVar = "tight_spot"
    family: ClassVar = "friction"
    equation: ClassVar = r"F(1 + a (e^{-4 \\sin^2(\\pi x/h + \\varphi/2)} - 1/2))"
    source: ClassVar = "assumed"
    hooks: ClassVar = {Place.FRICTION: _tightening}
    part: float = parameter("1", "growth a", 0.03, 0.3, "amplitude", at_least=0)
    lead: float = period("m", "lead h", 2e-3, 1e-2, "position", above=0)
    phase: float = phase()
'''


@pytest.fixture(scope="module", autouse=True)
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The file in a folder in which the package looks for effects, too, as long as these tests run."""
    folder = tmp_path_factory.mktemp("effects")
    (folder / "screw.py").write_text(OWN, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(models.effects, "__path__", [*models.effects.__path__, str(folder)])
        yield
    sys.modules.pop("models.effects.screw", None)


def made(name: str, lead: float) -> Effect:
    """The effect at its typical size, with this lead [m]."""
    return replace(every()[name].typical(), **{"lead": lead})


def test_the_scan_finds_a_periodic_friction_that_is_no_sine() -> None:
    effect = made("tight_spot", 2.345e-3)
    records = recorded(MACHINE, PLAN, [effect], seed=31)
    nominal = refit_within(MACHINE, records)
    findings, _ = scan(nominal, records, partial_out(nominal, numbered(pieces(records), records)))
    tried = {one.effect.name: fitted_with(nominal, one.effect, records) for one in findings[:2]}
    assert set(tried) == {"tight_spot", "position_dependent_friction"}  # the latter a sine of the same period
    assert min(tried, key=lambda name: tried[name].cost) == "tight_spot"
    (fitted,) = tried["tight_spot"].candidate.effects
    assert vars(fitted)["lead"] == pytest.approx(2.345e-3, rel=1e-3)
    assert fitted.strength() == pytest.approx(effect.strength(), rel=0.15)
    assert not parameters_at_bounds(fitted, MACHINE.priors)


def test_the_diagnosis_names_a_ripple_and_its_period() -> None:
    """Without the catalogue's own ripple, which is a sine as well and explains it as well."""
    records = recorded(MACHINE, PLAN, [made("screw_ripple", 4.321e-3)], seed=31)
    found = diagnose(MACHINE, records, disabled=("thrust_ripple",))
    assert found.outcome is Outcome.ATTRIBUTED
    assert found.effects == ("screw_ripple",)
    effect, deviations = found.which[0].members[0]
    assert vars(effect)["lead"] == pytest.approx(4.321e-3, rel=1e-3)
    assert deviations["lead"] < 1e-3 * 4.321e-3
