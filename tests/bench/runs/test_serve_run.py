"""A run that takes too long is ended, and does not count as a whole one."""

import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_bench.runs import serve_run
from hsslam_bench.runs.run_log import LogContent
from hsslam_bench.runs.serve_run import RunFailedError, ServeRun, finished


def test_a_run_that_is_ended_before_its_last_frame_is_not_whole(monkeypatch: pytest.MonkeyPatch):
    command = [sys.executable, "-c", "import time; time.sleep(60)"]
    monkeypatch.setattr(serve_run, "_TIMEOUT_S", 0.1)
    assert not serve_run._wait(subprocess.Popen(command), [])
    assert serve_run._wait(subprocess.Popen(["true"]), [])


def test_a_run_with_an_error_is_refused_even_if_its_exit_code_is_0():
    summary = {"frames": {"in": 9}}
    run = ServeRun("run", Path(), (), 0, 1.0, 0, "ended after an hour", summary, LogContent({}), "")
    with pytest.raises(RunFailedError, match="ended after an hour"):
        finished(run)
