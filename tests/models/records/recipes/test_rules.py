"""Mappings by file: the most specific rule wins, signal by signal; what fits nothing or is no mapping is said."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from models.machine import load as load_machine
from models.records.columns import Columns
from models.records.files import read_record
from models.records.recipes.mapping_file import describe, read_rules, recipes
from models.records.recipes.rules import Rule, check_used, columns_for, rule_of
from models.records.tables.sizes import RecordError

EMPS = Path(__file__).parents[4] / "models" / "machines" / "emps.toml"


def test_the_most_specific_rule_wins_in_whatever_order_they_stand() -> None:
    rules = (
        Rule({"position": "all", "command": "u"}, "a"),
        Rule({"position": "pattern", "time": "t"}, "b", "sweep*"),
        Rule({"position": "longer"}, "c", "sweep_1*.csv"),
        Rule({"position": "named"}, "d", "sweep_17.csv"),
    )
    for order in permutations(rules):
        named = columns_for(Path("runs/sweep_17.csv"), order)
        assert (named.position, named.command, named.time) == ("named", "u", "t")
        assert columns_for(Path("sweep_18.csv"), order).position == "longer"
        assert columns_for(Path("sweep_2.csv"), order).position == "pattern"
        assert columns_for(Path("moves.csv"), order) == Columns(position="all", command="u")


def test_of_two_equal_rules_the_later_wins_and_an_empty_entry_takes_back() -> None:
    rules = [Rule({"position": "x", "feedforward": "ff"}, "a"), Rule({"position": "y", "feedforward": ""}, "b")]
    assert columns_for(Path("a.csv"), rules) == Columns(position="y")


def test_a_rule_that_fits_no_record_is_said() -> None:
    rule = Rule({"position": "x"}, "--column swep*.csv:position=x", "swep*.csv")
    with pytest.raises(RecordError, match=r"'swep\*.csv' fits none of the records \(sweep.csv\); correct the pattern"):
        check_used([rule], [Path("runs/sweep.csv")])


def test_a_mapping_file_has_a_table_for_each_record(tmp_path: Path) -> None:
    path = tmp_path / "maps.toml"
    path.write_text("""
        [[record]]
        time = "t [ms]"
        [[record]]
        files = ["sweep*.csv", "slow.csv"]
        position = "x [mm]"
        feedforward = "exc [V] * 35 N/V"
    """)
    rules = read_rules(path)
    assert columns_for(Path("slow.csv"), rules) == columns_for(Path("sweep_3.csv"), rules)
    assert columns_for(Path("slow.csv"), rules).feedforward == "exc [V] * 35 N/V"
    assert columns_for(Path("moves.csv"), rules) == Columns(time="t [ms]")
    assert [rule.pattern for rule in rules] == ["*", "sweep*.csv", "slow.csv"]


def test_a_mapping_file_may_serve_calls_with_other_records(tmp_path: Path) -> None:
    """Its patterns for sweeps had stopped a call that has none, although every record was mapped."""
    path = tmp_path / "maps.toml"
    path.write_text('[[record]]\nfiles = ["sweep*.csv", "moves.csv"]\nposition = "x [mm]"')
    rules, all_files = read_rules(path), Rule({"time": "t"}, "[record] of the machine file")
    for mapping in (rules, (all_files, *rules)):
        (said,) = check_used(mapping, [Path("moves.csv")])
        assert said.endswith("record 1: 'sweep*.csv' fits none of the records (moves.csv); it is not used")
    assert len(check_used((all_files, *rules), [Path("swep_1.csv")])) == 2  # told, although it may be as intended
    with pytest.raises(
        RecordError, match=r"record 1: 'sweep\*.csv' fits none of the records \(moves.csv, swep_1.csv\)"
    ):
        check_used(rules, [Path("moves.csv"), Path("swep_1.csv")])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "must have a table for each record; write a table such as"),
        ("record = 3", "must have a table for each record"),
        ("[[records]]\ntime = 't'", "'records' does not belong in a mapping file"),
        ("[record]\nposicion = 'x'", "record 1: 'posicion' is not a signal; did you mean position"),
        ("[record]\nposition = 'x [kg]'", "record 1: position: .* quantity in m"),
        ("[record]\nposition = 5", "record 1: position must be text in quotes"),
        ("[record]\nfiles = ['a.csv', 5]", "record 1: files must be text in quotes"),
        ("[record]\nfiles = 'runs/a.csv'", "must be the name of a file, or a pattern of names"),
        ("[record", "can't be read as TOML"),
        ("a = " + "[" * 5_000, "can't be read as TOML"),
        ("#" * 1_000_001, "is larger than a mapping file can be"),
    ],
)
def test_what_is_not_a_mapping_is_said_in_one_line(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "maps.toml").write_text(text)
    with pytest.raises(RecordError, match=says) as error:
        read_rules(tmp_path / "maps.toml")
    assert "\n" not in str(error.value)
    with pytest.raises(RecordError, match=r"none.toml: can't be read \(No such file"):
        read_rules(tmp_path / "none.toml")


@pytest.mark.parametrize("name", recipes())
def test_every_recipe_is_a_mapping_of_time_command_or_position_with_its_description(name: str) -> None:
    columns = columns_for(Path("any.mat"), read_rules(recipes()[name]))
    assert columns.command != Columns().command
    assert columns.position != Columns().position
    assert 20 < len(describe(name)) < 120


def test_the_recipe_of_emps_is_the_mapping_in_its_machine_file() -> None:
    columns = columns_for(Path("DATA_EMPS.mat"), read_rules(recipes()["emps"]))
    assert columns == load_machine(EMPS).record
    assert columns_for(Path("DATA_EMPS.mat"), rule_of(columns, "the machine file")) == columns


def test_a_matlab_log_is_read_by_its_recipe(tmp_path: Path) -> None:
    t = 5e-4 * np.arange(400)
    x = 1e-3 * np.sin(8 * t) ** 3
    u = 12 * np.gradient(np.gradient(x, t), t) + np.sin(40 * t)
    savemat(tmp_path / "run.mat", {"log": {"t": t, "x": x, "u": u, "r": 0 * t, "xd": x, "uff": u / 2}})
    columns = columns_for(tmp_path / "run.mat", read_rules(recipes()["matlab_log"]))
    record = read_record(tmp_path / "run.mat", columns)
    np.testing.assert_array_equal(record.feedforward, u / 2)
    np.testing.assert_array_equal(record.position, x)
