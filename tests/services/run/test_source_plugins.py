"""Sources of other packages: one that works, and many that do not, which cost it nothing."""

from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source_row import SourceRow, guess_source
from hsslam_services.run.source_plugins import plugin_rows
from hsslam_services.run.source_table import OWN_SOURCES, comes_over_bus
from tests.services.run.installed_package import install

_ROW = """
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.source_row import SourceRow

def row(kind, opener, **more):
    return SourceRow(kind, (f"{kind}:FOLDER",), "frames", "frames", opener, **more)
"""
_ROWS = (
    _ROW
    + """
def cannot_look(path):
    raise RuntimeError("looked")

GOOD = row("good", "hsslam_node.sources.record:RecordSource", looks_like=lambda path: path.is_dir())
FALLS = row("falls", "plugin_rows_of_test:fall", looks_like=cannot_look)
NO_DRIVER = row("driverless", "plugin_driver_that_is_not_there:Source")
TUM = row("tum", "hsslam_node.sources.record:RecordSource")
EXAMPLES = SourceRow("examples", ("other:FOLDER",), "frames", "frames", "a:b")
NUMBERS = SourceRow("numbers", (1, 2), "frames", "frames", "a:b")
NUMBER = SourceRow("number", 1, "frames", "frames", "a:b")
LEAVES = row("leaves", "plugin_rows_of_test:leave")
NAMELESS = row("nameless", "plugin_rows_of_test:Nameless")
STILL = row("still", "plugin_rows_of_test:Still")

class Nameless:
    def __init__(self, name, options):
        pass

class Still(Nameless):
    name, camera, frame_count = "still", Camera(64, 48, 50.0, 50.0, 31.5, 23.5), None
    rate_hz = depth_units_per_m = 0.0

def fall(name, options):
    raise RuntimeError("camera\\non fire")

def leave(name, options):
    raise SystemExit(0)
"""
)
_POINTS = {
    "good": "plugin_rows_of_test:GOOD",
    "falls": "plugin_rows_of_test:FALLS",
    "driverless": "plugin_rows_of_test:NO_DRIVER",
    "tum": "plugin_rows_of_test:TUM",
    "examples": "plugin_rows_of_test:EXAMPLES",
    "numbers": "plugin_rows_of_test:NUMBERS",
    "number": "plugin_rows_of_test:NUMBER",
    "renamed": "plugin_rows_of_test:GOOD",
    "function": "plugin_rows_of_test:row",
    "gone": "plugin_rows_of_test:GONE",
    "unwritten": "plugin_that_is_not_there:ROW",
    "leaves": "plugin_rows_of_test:LEAVES",
    "nameless": "plugin_rows_of_test:NAMELESS",
    "still": "plugin_rows_of_test:STILL",
}


@pytest.fixture
def rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[SourceRow, ...]:
    """Our own sources and those of a package of fourteen, of which one works."""
    folder = tmp_path / "site"
    install(folder, "eleven-cameras", {"plugin_rows_of_test": _ROWS}, _POINTS)
    monkeypatch.syspath_prepend(str(folder))
    found = tuple(row for row in plugin_rows(OWN_SOURCES) if row.package != "hsslam-node")
    assert [row.kind for row in found] == sorted(_POINTS)
    return (*OWN_SOURCES, *found)


def test_a_source_of_another_package_is_one_as_our_own(rows, tmp_path):
    with pytest.raises(UserError, match="source record:"):  # what the row opens
        open_source("good:nothing-there", rows=rows)
    folder = tmp_path / "site" / "recording"
    folder.mkdir()
    assert guess_source(str(folder), rows) == f"good:{folder}"
    with pytest.raises(UserError, match=f"did you mean good:{folder}"):
        open_source(str(folder), rows=rows)


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("falls", "RuntimeError: camera on fire"),
        ("leaves", "SystemExit: 0"),
        ("driverless", "ModuleNotFoundError: No module named 'plugin_driver_that_is_not_there'"),
        ("examples", "examples ('other:FOLDER',): expected sources of kind examples"),
        ("numbers", "examples (1, 2): expected sources of kind numbers"),
        ("number", "examples 1: expected sources of kind number"),
        ("renamed", "plugin_rows_of_test:GOOD has kind 'good': expected 'renamed'"),
        ("function", "plugin_rows_of_test:row is function: expected SourceRow"),
        ("gone", "AttributeError: module 'plugin_rows_of_test' has no attribute 'GONE'"),
        ("unwritten", "ModuleNotFoundError: No module named 'plugin_that_is_not_there'"),
        ("nameless", "AttributeError: 'Nameless' object has no attribute 'name'"),
        ("still", "TypeError: rate_hz = 0.0: expected a number above 0"),
    ],
)
def test_one_that_does_not_work_says_why_in_one_line(rows, kind: str, reason: str):
    with pytest.raises(UserError) as caught:
        open_source(f"{kind}:x", rows=rows)
    told = f"source {kind}:x: package eleven-cameras does not work: {reason}"
    assert str(caught.value) == told


def test_a_package_cannot_take_a_kind_of_ours(rows, tmp_path):
    ours, theirs = (row for row in rows if row.kind == "tum")
    assert ours in OWN_SOURCES
    assert theirs.fault == "kind 'tum' is taken: expected another"
    with pytest.raises(UserError) as caught:
        open_source(f"tum:{tmp_path}/nothing", rows=rows)
    assert "eleven-cameras" not in str(caught.value)


def test_of_packages_with_one_kind_the_first_that_works_has_it(tmp_path, monkeypatch):
    """The kind `good` is of three packages; the entry point of the first does not work."""
    folder = tmp_path / "site"
    for package, module, rows in (
        ("a-broken", "a_rows_of_test", "ROW = 1"),
        ("b-works", "b_rows_of_test", _ROWS),
        ("c-late", "c_rows_of_test", _ROWS),
    ):
        name = "ROW" if rows == "ROW = 1" else "GOOD"
        install(folder, package, {module: rows}, {"good": f"{module}:{name}"})
    monkeypatch.syspath_prepend(str(folder))
    found = [row for row in plugin_rows(OWN_SOURCES) if row.kind == "good"]
    assert [(row.package, row.fault) for row in found] == [
        ("b-works", ""),
        ("a-broken", "a_rows_of_test:ROW is int: expected SourceRow"),
        ("c-late", "kind 'good' is taken: expected another"),
    ]
    with pytest.raises(UserError, match="source record:"):  # what the row of b-works opens
        open_source("good:nothing-there", rows=found)


def test_what_does_not_work_is_no_source_over_the_bus(rows):
    assert all(row.opener for row in rows if row.package)
    assert not comes_over_bus("unwritten:x")
