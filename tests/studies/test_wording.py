"""Numbers as reports print them: no exponent of a program, no digit that means nothing, no sign of nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.quantity import turned
from studies import wording
from studies.scattered import QUANTILE, high_end

SPACE = "\u00a0"


def plain(text: str) -> str:
    """The text with blanks in place of what keeps a line from ending."""
    return text.replace(SPACE, " ").replace("\u2060", "")


@pytest.mark.parametrize(
    ("number", "unit", "printed"),
    [
        (2.535e-12, "1", "2.535 · 10⁻¹²"),
        (1e-9, "1", "10⁻⁹"),
        (7.3305e7, "N/(m s)", "7.3305 · 10⁷ N/(m s)"),
        (9.2e-5, "N s/m", "9.2 · 10⁻⁵ N s/m"),
        (9.2e-5, "N", "92 µN"),
        (1.46668e-7, "N m", "146.67 nN m"),
        (6.42e-10, "s^2", "6.42 · 10⁻¹⁰ s²"),
        (220.0, "1", "220"),
        (2e-5, "m", "20 µm"),
    ],
)
def test_a_number_is_printed_without_the_exponent_of_a_program(number: float, unit: str, printed: str) -> None:
    assert plain(wording.quantity(number, unit, 5)) == printed


@pytest.mark.parametrize(
    ("number", "std", "unit", "printed"),
    [
        (0.1904001, 6.5e-6, "m", "190.4001 mm ± 6.5 µm"),  # of which 33 are a turn
        (140.00432, 0.03, "Hz", "140.004 Hz ± 30 mHz"),
        (2.34, 1.0, "m", "2.3 m ± 1 m"),
        (0.0, 1e-3, "m", "0 m ± 1 mm"),
        (0.1904001, 0.0, "m", "190 mm at the end of its range"),
        (0.1904001, None, "m", "190 mm"),
    ],
)
def test_a_fitted_value_has_the_digits_of_its_deviation(
    number: float, std: float | None, unit: str, printed: str
) -> None:
    assert plain(wording.fitted({"value": number, "std": std, "unit": unit}, 3)) == printed


def test_two_digits_of_a_large_number_are_written_out() -> None:
    assert wording.quantity(224.0, "1", 2) == "220"
    assert plain(wording.scientific(2.535e-12)) == "2.5 · 10⁻¹²"
    assert wording.scientific(0.0) == "0"


def test_a_motion_settles_in_a_time_or_never_settles() -> None:
    assert [plain(wording.settles(time, 3)) for time in (4.924e-3, math.inf, None)] == [
        *("settles in 4.92 ms", "never settles", "never settles")
    ]
    assert plain(wording.all_settle(2e-3)) == "every motion settles in 2 ms"
    assert wording.all_settle(None) == "some motions never settle"


def test_a_rotary_axis_has_its_units_behind_a_power_of_ten() -> None:
    assert plain(turned(wording.quantity(9.2e-5, "N s/m", 2))) == "9.2 · 10⁻⁵ N m s/rad"
    assert plain(turned(wording.quantity(9.2e-5, "N", 2))) == "92 µN m"


@pytest.mark.parametrize(
    ("number", "std", "printed"),
    [
        (331.48e-6, 47e-6, "331 µs"),
        (0.33769, 0.24, "0.34 N"),
        (80.9e6, 122e6, "80000 N/mm"),
        (204.26, 2.48, "204.3 N"),
        (0.0, 1.0, "0 N"),
        (1.234567, math.inf, "1.2346 N"),
    ],
)
def test_a_value_ends_where_its_deviation_has_its_second_digit(number: float, std: float, printed: str) -> None:
    unit = "s" if number < 1e-3 and number else "N/m" if number > 1e6 else "N"
    assert plain(wording.beside(number, std, unit)) == printed


def test_a_parameter_of_several_numbers_has_the_digits_of_each() -> None:
    row = {"name": "friction.limit", "number": [2e-7, 1.757e-4], "std": [3.03e-7, 1.8e-5], "unit": "m"}
    assert plain(wording.rounded(row)) == "200 nm, 176 µm"
    assert plain(wording.deviation(row)) == "300 nm, 18 µm"
    assert wording.deviation({"name": "tolerance.offset", "number": 0.45, "std": 0.45, "unit": "N"}) == "–"
    assert plain(wording.rounded({**row, "std": None})) == "200 nm, 175.7 µm"


def test_a_check_that_is_missed_does_not_print_its_limit() -> None:
    assert wording.checked(2.2021, 2.2, "1", 3) == "2.202"
    assert wording.checked(2.2, 2.2, "1", 3) == "2.2"
    assert wording.checked(1.0000071, 1.0, "1") == "1.00001"
    assert plain(wording.checked(0.0195, 0.025, "s")) == "19.5 ms"
    assert wording.checked(None, 0.025, "s") == "never"


def test_what_rounds_to_nothing_has_no_sign() -> None:
    assert wording.signed(-0.001) == "0.00"
    assert wording.signed(0.126) == "+0.13"
    assert wording.percent(-1e-5) == "0.0 %"
    assert wording.percent(-0.002) == "-0.2 %"


def test_a_motion_is_in_the_unit_of_its_length() -> None:
    assert plain(wording.from_to(0.0, 20e-6)) == "0 → 20 µm"
    assert plain(wording.from_to(0.06, 0.04)) == "60 → 40 mm"


def test_one_thing_is_singular() -> None:
    assert [plain(wording.several(count, "table")) for count in (0, 1, 2)] == ["0 tables", "1 table", "2 tables"]


@pytest.mark.parametrize("runs", [4, 10, 19, 20, 21, 40, 100])
def test_the_high_end_of_few_runs_is_the_longest_one(runs: int) -> None:
    times = np.arange(runs)
    longest = np.quantile(times, QUANTILE, method="higher") == times[-1]
    assert high_end(runs) == (f"longest of {runs}" if longest else "95 %")
    assert longest == (runs <= 20)
