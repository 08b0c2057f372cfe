"""The example that merges two runs, as a user runs it."""

import re

from tests.in_process import run_script
from tests.repository import ROOT
from tests.two_sessions import FIRST, SECOND, saved_session

EXAMPLE = ROOT / "examples/merge_two_sessions.py"


def test_each_run_had_seen_most_of_what_both_show(tmp_path):
    first = str(saved_session(tmp_path / "first", FIRST))
    second = str(saved_session(tmp_path / "second", SECOND))
    done = run_script(EXAMPLE, first, second, str(tmp_path / "both"))
    assert done.returncode == 0, done.stderr
    shares = re.findall(r"had seen (\d+)% of the surface", done.stdout)
    assert len(shares) == 2 and all(60 < int(share) <= 100 for share in shares)
    assert (tmp_path / "both/map.safetensors").is_file()


def test_bad_input_is_one_line(tmp_path):
    assert "merge_two_sessions.py" in run_script(EXAMPLE).stderr
    done = run_script(EXAMPLE, str(tmp_path), str(tmp_path))
    assert done.returncode == 2
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
