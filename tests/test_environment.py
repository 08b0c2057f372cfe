"""Environment variables are read in one place, where they are documented."""

import re

import pytest

from hsslam_node.environment import VARIABLES, environment_table
from tests.repository import ROOT

_CODE = [
    path
    for folder in ("hsslam_node", "proto", "services")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
_ONE_PLACE = ROOT / "hsslam_node/environment.py"
_OTHER_PLACE = ROOT / "hsslam_node/kernels/cache_folder.py"  # see the first lines of the one place
_READS_ONE = re.compile(
    r"environ(?:\.get\(|\.setdefault\(|\.pop\(|\[)|getenvb?\(\"?\w*|import environ\b"
)
_IN_C = {'getenv("CLOCK_OFFSET'}  # of a library that a check of the bench compiles


def test_no_other_module_reads_a_variable():
    found = {
        str(path.relative_to(ROOT)): reads
        for path in _CODE
        if path not in (_ONE_PLACE, _OTHER_PLACE)
        and (reads := set(_READS_ONE.findall(path.read_text())) - _IN_C)
    }
    assert found == {}
    named = set(re.findall(r"environ\.get\(\"(\w+)\"", _OTHER_PLACE.read_text()))
    assert named == {"XDG_CACHE_HOME"}


def test_every_variable_of_ours_that_is_named_is_in_the_table():
    files = [*_CODE, *(ROOT / "docs").glob("*.md"), ROOT / "README.md"]
    named = {name for path in files for name in re.findall(r"\bHSSLAM_[A-Z_]+\b", path.read_text())}
    assert named == {v.name for v in VARIABLES if v.name.startswith("HSSLAM_")}
    assert environment_table().count("\n") == 1 + len(VARIABLES)


@pytest.mark.parametrize("value", ["", "somewhere"])
def test_a_variable_is_read_when_it_is_asked_for(monkeypatch, value):
    for variable in VARIABLES:
        monkeypatch.setenv(variable.name, value)
        assert variable.value() == value
        monkeypatch.delenv(variable.name)
        assert variable.value() == ""
