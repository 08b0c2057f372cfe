"""The viewer's process: its memory, its ports."""

import os
import socket
import time

import msgspec
import psutil
import pytest

from hsslam_services.viewer.rerun_process import ViewerProcess
from hsslam_services.viewer.view import RerunView
from tests.services.wire_samples import frame


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("web", ["--server-memory-limit", "1500MB"]),
        ("spawn", ["--memory-limit", "1500MB", "--server-memory-limit", "375MB"]),
    ],
)
def test_the_viewer_is_started_with_its_limit_of_memory(kind, expected):
    process = ViewerProcess(kind, 1.5)
    words = process.command
    psutil.Process(process.pid).kill()
    while not process.has_ended():
        time.sleep(0.01)
    assert words[-len(expected) :] == expected


def test_viewers_of_runs_that_start_at_once_get_ports_of_their_own():
    servers = [ViewerProcess("web") for _ in range(3)]  # none listens yet when the next one begins
    ports = [int(server.url.partition("127.0.0.1:")[2].partition("/")[0]) for server in servers]
    assert len(set(ports)) == len({server.page for server in servers}) == 3
    deadline = time.monotonic() + 30
    for port in ports:
        while not _answers(port):
            assert time.monotonic() < deadline
            time.sleep(0.02)
    assert not any(server.has_ended() for server in servers)
    for server in servers:
        server.close()


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_the_server_of_the_web_viewer_forgets_what_is_beyond_its_limit(tmp_path):
    server = ViewerProcess("web", 0.1)
    view = RerunView(tmp_path / "run.rrd", f"connect:{server.url}", "run-1", lambda *_: None)
    large = memoryview(os.urandom(1_000_000))
    picture = msgspec.structs.replace(frame(0, compressed=True), color=large)
    taken_mb, deadline = 0, time.monotonic() + 60
    for index in range(100_000):
        view.show(msgspec.structs.replace(picture, index=index, stamp_ns=index * 10**9))
        time.sleep(0.005)
        taken_mb = index - view.dropped
        if taken_mb > 400:
            break
        assert time.monotonic() < deadline, f"took {taken_mb} MB only"
    memory_mb = psutil.Process(server.pid).memory_info().rss / 1e6
    view.close()
    server.close()
    assert memory_mb < 300, f"{memory_mb:.0f} MB of {taken_mb} MB"
