"""Which address the viewer of a benchmark's run connects to."""

import os
import socket
from pathlib import Path

import psutil

from hsslam_bench.runs.viewers import AttachedViewer

_PAGE = "info: viewer: open http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port}%2Fproxy\n"
_CONNECT_S = 30.0


def test_a_viewer_connects_to_the_address_that_the_log_of_the_run_names(tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(_CONNECT_S)
        _log_of_a_recorder(tmp_path, port=server.getsockname()[1])
        viewer = AttachedViewer(tmp_path)
        _touch(tmp_path, age_s=-60.0)
        viewer.poll()
        try:
            server.accept()[0].close()  # TimeoutError if it does not come
        finally:
            viewer.close()


def test_a_log_of_the_run_before_in_the_folder_is_passed_over(tmp_path: Path):
    _log_of_a_recorder(tmp_path, port=9)
    viewer = AttachedViewer(tmp_path)
    _touch(tmp_path, age_s=60.0)
    before = {child.pid for child in psutil.Process().children()}
    viewer.poll()
    try:
        assert {child.pid for child in psutil.Process().children()} <= before
    finally:
        viewer.close()


def _log_of_a_recorder(run: Path, port: int) -> None:
    (run / "logs").mkdir()
    (run / "logs" / "recorder.log").write_text(_PAGE.format(port=port))


def _touch(run: Path, age_s: float) -> None:
    log = run / "logs" / "recorder.log"
    written_s = log.stat().st_mtime - age_s
    os.utime(log, (written_s, written_s))
