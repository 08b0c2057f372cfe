import re
from itertools import pairwise

from tests.order_of_tests import in_order
from tests.repository import ROOT

pytest_plugins = ("pytester",)

_FILE = """
import pytest

def test_small(): ...
@pytest.mark.e2e
def test_run(): ...
def test_tiny(): ...
"""


def test_files_stay_whole_and_runs_lie_between_them(pytester):
    names = "abcdefgh"
    pytester.makepyfile(**{f"test_{name}": _FILE for name in names})
    items, _ = pytester.inline_genitems()
    ordered = in_order(list(items))
    assert sorted(item.nodeid for item in ordered) == sorted(item.nodeid for item in items)
    parts = [f"{item.path.stem[-1]}.{item.name.removeprefix('test_')}" for item in ordered]
    for name in names:
        assert parts.index(f"{name}.tiny") == parts.index(f"{name}.small") + 1
    runs = [number for number, part in enumerate(parts) if part.endswith("run")]
    assert parts[-2:] == ["h.small", "h.tiny"]  # no run comes last
    assert max(b - a for a, b in pairwise(runs)) <= 3
    for item in ordered:
        groups = [mark.args[0] for mark in item.iter_markers("xdist_group")]
        assert groups == ([] if item.name == "test_run" else [item.path.name])


def test_runs_alone_keep_their_order(pytester):
    pytester.makepyfile(test_a=_FILE, test_b=_FILE)
    items, _ = pytester.inline_genitems()
    runs = [item for item in items if item.name == "test_run"]
    assert in_order(runs) == runs


def test_one_worker_takes_all_tests_of_a_file_and_those_that_fail_are_known(pytester, monkeypatch):
    """pytest-xdist 3.8 ignores groups with pytest 9.2, without a word."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    pytester.makeconftest(
        "from tests.conftest import pytest_collection_modifyitems, pytest_runtest_logreport"
    )
    failing = "\ndef test_unmet(): assert False\n"
    pytester.makepyfile(**{f"test_{name}": _FILE + failing for name in "abcd"})
    in_group = "import pytest\n@pytest.mark.e2e\n@pytest.mark.xdist_group('ray')\n"
    with_at = "@pytest.mark.parametrize('n', ['x@y'])\ndef test_unmet_run(n): assert False\n"
    pytester.makepyfile(test_e=in_group + with_at)
    options = ("--numprocesses", "2", "--dist", "loadgroup", "-v", "-W", "ignore")
    result = pytester.runpytest_subprocess(*options)
    result.assert_outcomes(passed=12, failed=5)
    workers: dict[str, set[str]] = {}
    for worker, name in re.findall(
        r"^\[(gw\d)\].*(?:PASSED|FAILED) test_(\w)\.py::test_(?!run|unmet_run)",
        result.stdout.str(),
        re.M,
    ):
        workers.setdefault(name, set()).add(worker)
    assert sorted(workers) == list("abcd")
    assert all(len(of_file) == 1 for of_file in workers.values()), workers
    again = pytester.runpytest_subprocess("--last-failed", "-W", "ignore")
    again.assert_outcomes(failed=5)
