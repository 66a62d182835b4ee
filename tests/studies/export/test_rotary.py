"""What is exported for an axis that turns says so, in its page, in its sources and in its FMUs."""

from __future__ import annotations

import io
import zipfile

import pytest

from models.machine import Machine, load
from studies.export.__main__ import STUDY
from studies.new_machine.__main__ import main as new_machine
from tests.models.test_rotary import ANSWERS
from tests.studies.test_new_machine import TEN, command
from tests.studies.test_rotary_reports import linear_units


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    path = tmp_path_factory.mktemp("rotary") / "axis.toml"
    assert new_machine(command(path, dict(zip(TEN, ANSWERS, strict=True)))) == 0
    return load(path)


def test_the_page_the_sources_and_the_fmus_are_in_the_axis_units(machine: Machine) -> None:
    files = STUDY(machine, quick=True).files
    page = str(files["README.md"])
    assert "targets r and readings x in radians" in page
    assert "thrust u in newton metres" in page
    assert linear_units(page) == []
    header = str(files["c/axis_law.h"])
    assert "at rest on a reading [rad], with the thrust [N m] that is on the axis" in header
    for name, text in files.items():
        if name.endswith((".c", ".h", ".m")):
            assert linear_units(str(text)) == [], name
    for kind, thrust in (("controller", "thrust"), ("plant", "command")):
        with zipfile.ZipFile(io.BytesIO(files[f"fmi3/axis_{kind}.fmu"])) as archive:
            description = archive.read("modelDescription.xml").decode()
        assert '<Unit name="N m"><BaseUnit kg="1" m="2" s="-2"/></Unit>' in description
        line = next(one for one in description.splitlines() if f'name="{thrust}"' in one)
        assert 'unit="N m"' in line
        assert 'unit="m"' not in description
