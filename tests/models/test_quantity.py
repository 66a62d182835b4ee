"""Text with units: right to the last digit, and wrong units found."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.quantity import (
    _USUAL,
    QuantityError,
    _factor,
    _factor_of_any,
    _is_any_rotary,
    is_rotary,
    json_name,
    keeps_to,
    listed,
    parse,
    rotary,
    show,
    span,
    turned,
    turned_but_quoted,
)
from reports.markup import escape


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("800 N/mm", "N/m", 8e5),
        ("20 um", "m", 2e-5),
        ("20 µm", "m", 2e-5),
        ("500 us", "s", 5e-4),
        ("0.1 um", "m", 1e-7),
        ("1.0 kW", "W", 1e3),
        ("9.5e3 N s/m", "N s/m", 9.5e3),
        ("6.2e7 N/(m s)", "N/(m s)", 6.2e7),
        ("0.02 1/kg", "1/kg", 0.02),
        ("2 kHz", "Hz", 2e3),
        ("0.028", "1", 0.028),
        ("5 %", "1", 0.05),
        (" -3 mm/s ", "m/s", -3e-3),
    ],
)
def test_a_text_becomes_the_nearest_float(text: str, unit: str, number: float) -> None:
    assert parse(text, unit) == number


SYMBOLS = st.sampled_from(sorted(_USUAL))
PRODUCTS = st.lists(SYMBOLS, min_size=1, max_size=2).map(" ".join)
UNITS = st.one_of(
    PRODUCTS, st.builds("{}/{}".format, PRODUCTS, SYMBOLS), st.builds("{}/({})".format, PRODUCTS, PRODUCTS)
)


@given(
    UNITS, st.sampled_from(["1", "m", "s", "Hz", "m/s", "N", "N/m", "N s/m", "N/(m s)", "1/kg", "kg", "W", "V", "A"])
)
def test_the_usual_units_are_those_of_the_registry(given_unit: str, unit: str) -> None:
    """The table of usual units only saves the time in which the registry of all units is made."""
    wanted = rotary(unit) if is_rotary(f"1 {given_unit}", unit) else unit
    assert outcome(lambda: _factor(given_unit, unit)) == outcome(lambda: _factor_of_any(given_unit, wanted, unit))


@given(UNITS, st.sampled_from(["m", "m/s", "N", "N/m", "N s/m", "1/kg", "kg", "N/A"]))
def test_what_turns_is_told_from_the_usual_units_as_from_the_registry(given_unit: str, unit: str) -> None:
    assert is_rotary(f"1 {given_unit}", unit) == _is_any_rotary(given_unit, unit)


def test_a_machine_file_in_usual_units_needs_no_registry() -> None:
    """It takes half a second to make, in every process that reads a machine."""
    code = "import sys; from models.machine import DEFAULT, load; load(DEFAULT); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def outcome(factor: Callable[[], Decimal]) -> Decimal | str:
    try:
        return factor()
    except QuantityError as error:
        return str(error)


@pytest.mark.parametrize(
    ("text", "unit", "in_its_place", "number"),
    [
        ("180 deg", "m", "rad", math.pi),
        ("2 urad", "m", "rad", 2e-6),
        ("60 rpm", "m/s", "rad/s", 2 * math.pi),
        ("0.5 N m", "N", "N m", 0.5),
        ("3 kg cm^2", "kg", "kg m^2", 3e-4),
        ("3 kg m2", "kg", "kg m^2", 3.0),
        ("50 1/(kg m^2)", "1/kg", "1/(kg m^2)", 50.0),
        ("2 mN m/mrad", "N/m", "N m/rad", 2.0),
        ("3 N m s/rad", "N s/m", "N m s/rad", 3.0),
        ("4 N m/(rad s)", "N/(m s)", "N m/(rad s)", 4.0),
        ("0.1 N m/A", "N/A", "N m/A", 0.1),
    ],
)
def test_a_rotary_axis_has_units_of_its_own(text: str, unit: str, in_its_place: str, number: float) -> None:
    assert rotary(unit) == in_its_place
    assert parse(text, unit) == pytest.approx(number, rel=1e-15)
    assert is_rotary(text, unit) is True
    assert is_rotary(f"1 {unit}", unit) is False


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("20 µm at 3 N", "20 µrad at 3 N m"),
        ("within ±2\u00a0µm after 25\u00a0ms", "within ±2\u00a0µrad after 25\u00a0ms"),
        ("4.5e+07 N/(m s) and 2 kN", "4.5e+07 N m/(rad s) and 2 kN m"),
        ("12\u00a0N\u00a0s/\u2060m, 0.1\u00a0m/\u2060s", "12\u00a0N\u00a0m\u00a0s/\u2060rad, 0.1\u00a0rad/\u2060s"),
        ("800 N/mm, 0.022 1/kg of 45 kg", "800 N m/mrad, 0.022 1/(kg m²) of 45 kg m²"),
        ("| gain, dead time | 1; 1/kg, N/(m s), s |", "| gain, dead time | 1; 1/(kg m²), N m/(rad s), s |"),
        ("position [µm] over thrust [N/µm]", "position [µrad] over thrust [N m/µrad]"),
        ("[mm]", "[mrad]"),
        ("gain [1/kg]", "gain [1/(kg m²)]"),
        ("$5$ N/m and $k_i$ = $3 \\cdot 10^3$ N/(m s)", "$5$ N m/rad and $k_i$ = $3 \\cdot 10^3$ N m/(rad s)"),
        ("payload mass by 3 %", "payload inertia by 3 %"),
        ("Moving mass by 3 %", "Moving inertia by 3 %"),
        ("power density [N$^2$/Hz]", "power density [(N m)$^2$/Hz]"),
        ("x in metres, 3 micrometres; u in newtons", "x in radians, 3 microradians; u in newton metres"),
        ("3 rad at 2 N m, 5 N m/rad, N = 5 in 10 modes, row[m] of a[N], 0.4 N²/Hz", None),
        ("7 min, 3 mA, 2 s, 30 Hz, 5 nodes, 4 m-files", None),
    ],
)
def test_a_text_has_the_units_of_a_rotary_axis(text: str, wanted: str | None) -> None:
    assert turned(text) == (text if wanted is None else wanted)
    assert turned(turned(text)) == turned(text)


@pytest.mark.parametrize(
    "text",
    ["150000 N s/m", "1028\u00a0N/\u2060mm", "0.00011 1/kg of 9000 kg", "4 N/(m s)", "by 4.6 N/m, [1/kg]", "5 kg m^2"],
)
def test_markdown_has_the_units_of_a_rotary_axis_as_the_text_that_it_shows(text: str) -> None:
    assert turned(escape(text)) == escape(turned(text))
    assert turned(turned(escape(text))) == turned(escape(text))


def test_what_a_message_quotes_keeps_its_units() -> None:
    said = "--stroke: '2 mm' can't be reached within 3 N"
    assert turned_but_quoted(said) == "--stroke: '2 mm' can't be reached within 3 N m"


def test_most_units_are_the_same_for_a_rotary_axis() -> None:
    for unit in ("s", "Hz", "W", "1", "1/s", "A"):
        assert (rotary(unit), is_rotary(f"1 {unit}", unit)) == (unit, None)


@given(st.decimals(min_value="1e-9", max_value="1e9", places=6))
def test_micrometres_are_rounded_once(number: object) -> None:
    assert parse(f"{number} um", "m") == float(f"{number}e-6")


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("800 kg", "N/m", "this is a quantity in N/m"),
        ("800", "N/m", "has no unit"),
        ("800 N/furlung", "N/m", "unknown unit"),
        ("nan m", "m", "not a finite number"),
        ("inf s", "s", "not a finite number"),
        ("240 rad/s", "Hz", "angle"),
        ("60 rpm", "Hz", "angle; give frequencies in Hz"),
        ("90 deg", "m/s", "for a rotary axis, write it in rad/s"),
        ("3 N m s/rad", "N/m", "for a rotary axis, write it in N m/rad"),
        ("60 rpm", "m", "for a rotary axis, write it in rad"),
        ("7 N m s", "N s/m", "this is a quantity in N s/m"),
        ("fast", "s", "must be a number with a unit"),
        ("2 m", "1", "a plain number"),
        ("1 m; import os", "m", "unknown unit"),
        (5.0, "m", "has no unit"),
    ],
)
def test_what_is_no_such_quantity_is_said(text: object, unit: str, says: str) -> None:
    with pytest.raises(QuantityError, match=says):
        parse(text, unit)


def test_a_reader_sees_prefixes() -> None:
    shown = [
        show(2e-5, "m"),
        show(0.0, "m"),
        show(8e5, "N/m"),
        show(1e-3, "s"),
        show(150.0, "N"),
        show(999.99999e-6, "s"),
        show(math.inf, "s"),
        show(9.996e-7, "m", 3),
    ]
    assert shown == ["20 µm", "0 m", "800 N/mm", "1 ms", "150 N", "1 ms", "never", "1 µm"]


def test_what_is_compared_is_in_the_same_unit() -> None:
    assert [show(one, "m", 2, like=1.45e-6) for one in (1.4e-6, 9.1e-7, 2e-9, 0.0)] == [
        *("1.4 µm", "0.91 µm", "0.002 µm", "0 µm")
    ]
    assert show(20.0, "N/m", like=8e5) == "0.02 N/mm"


def test_names_in_json_carry_the_unit() -> None:
    names = [json_name("kp", "N/m"), json_name("ki", "N/(m s)"), json_name("kd", "N s/m"), json_name("gain", "1/kg")]
    assert names == ["kp_N_per_m", "ki_N_per_ms", "kd_Ns_per_m", "gain_per_kg"]
    assert json_name("damping", "1") == "damping"


@pytest.mark.parametrize(
    ("words", "text"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_words_are_joined_as_one_reads_them_out(words: list[str], text: str) -> None:
    assert listed(words) == text
    assert listed(iter(words), "or") == text.replace(" and ", " or ")


def test_a_range_whose_ends_read_alike_is_told_once() -> None:
    assert span(show(3.401e-4, "s", 2), show(3.404e-4, "s", 2)) == "340 µs"
    assert span("1 s", "never") == "1 s to never"


@pytest.mark.parametrize("limit", [25e-3, -3.0, 0.0])
def test_a_number_keeps_to_a_limit_but_for_rounding(limit: float) -> None:
    size = abs(limit)
    assert keeps_to(limit, limit)
    assert keeps_to(limit + 1e-10 * size, limit)
    assert not keeps_to(limit + max(1e-8 * size, 1e-300), limit)
    assert not keeps_to(math.inf, limit)
