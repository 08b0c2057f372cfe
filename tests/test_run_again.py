import json
import subprocess
import sys

import pytest

from tests.run_again import run_again

_FAILS_ONCE = """
import pathlib

def test_once():
    flag = pathlib.Path(__file__).with_name("flag")
    if not flag.exists():
        flag.touch()
        assert False

def test_other(): ...
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_flaky.py").write_text(_FAILS_ONCE)
    return tmp_path


def test_only_what_failed_runs_again(folder, capfd):
    first = subprocess.run([sys.executable, "-m", "pytest", "-q"], cwd=folder, check=False)
    assert first.returncode == 1
    assert run_again(folder) == 0
    assert "1 passed" in capfd.readouterr().out


@pytest.mark.parametrize("failed", [{}, {"gw0": True}, {"test_flaky.py": True}])
def test_a_run_that_failed_as_a_whole_is_not_repeated(folder, failed):
    cache = folder / ".pytest_cache/v/cache"
    cache.mkdir(parents=True)
    (cache / "lastfailed").write_text(json.dumps(failed))
    assert run_again(folder) == 1
