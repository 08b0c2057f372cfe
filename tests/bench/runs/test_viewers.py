"""Which address the viewer of a benchmark's run connects to."""

import os
from pathlib import Path

import psutil
import pytest

from hsslam_bench.runs.viewers import AttachedViewer

_PAGE = "info: viewer: open http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9%2Fproxy\n"


@pytest.mark.parametrize(("age_s", "attached"), [(-60.0, True), (60.0, False)])
def test_a_log_of_the_run_before_in_the_folder_is_passed_over(
    tmp_path: Path, age_s: float, attached: bool
):
    log = tmp_path / "logs" / "recorder.log"
    log.parent.mkdir()
    log.write_text(_PAGE)
    written_s = log.stat().st_mtime - age_s
    os.utime(log, (written_s, written_s))
    viewer = AttachedViewer(tmp_path)
    viewer.poll()
    try:
        children = psutil.Process().children()  # other tests may have left some that have ended
        commands = [c.cmdline() for c in children if c.status() != psutil.STATUS_ZOMBIE]
        assert ["rerun+http://127.0.0.1:9/proxy"] * attached == [
            command[-1] for command in commands if "--save" in command
        ]
    finally:
        viewer.close()
