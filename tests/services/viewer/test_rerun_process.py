"""The viewer's process: its memory, its ports."""

import os
import socket
import subprocess
import time
from pathlib import Path

import msgspec
import psutil
import pytest
import rerun_cli

from hsslam_services.viewer import rerun_process
from hsslam_services.viewer.rerun_process import ViewerProcess
from hsslam_services.viewer.view import RerunView
from tests.services.wire_samples import frame

RERUN = str(Path(rerun_cli.__file__).parent / "rerun")
PICTURE = msgspec.structs.replace(
    frame(0, compressed=True), color=memoryview(os.urandom(1_000_000))
)


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
    ports = [_port(server.url) for server in servers]
    assert len(set(ports)) == len({server.page for server in servers}) == 3
    deadline = time.monotonic() + 30
    for port in ports:
        while not _answers(port):
            assert time.monotonic() < deadline
            time.sleep(0.02)
    assert not any(server.has_ended() for server in servers)
    for server in servers:
        server.close()


def test_a_viewer_that_starts_slowly_gets_its_data(tmp_path, monkeypatch):
    """rerun's client gives up a server that takes no connection for 7 s: a cold disk, a busy machine."""
    slow = tmp_path / "slow-rerun"
    slow.write_text(f'#!/bin/sh\nsleep 8\nexec {RERUN} "$@"\n')
    slow.chmod(0o700)
    monkeypatch.setattr(rerun_process, "_executable", lambda: str(slow))
    events = []
    view = RerunView(tmp_path / "run.rrd", "web", "run-1", lambda *event: events.append(event))
    assert view._process is not None
    taken, url, deadline = tmp_path / "taken.rrd", view._process.url, time.monotonic() + 60
    while not _answers(_port(url)):
        view.show(PICTURE)
        assert time.monotonic() < deadline
        time.sleep(0.05)
    page = [RERUN, "--bind", "127.0.0.1", "--port", "auto", "--save", taken, url]
    with subprocess.Popen(page, stderr=subprocess.DEVNULL) as subscriber:
        while not taken.exists() or taken.stat().st_size < 2 * len(PICTURE.color):
            view.show(msgspec.structs.replace(PICTURE, stamp_ns=time.monotonic_ns()))
            if time.monotonic() > deadline:
                break
            time.sleep(0.02)
        subscriber.terminate()
    view.close()
    assert time.monotonic() < deadline
    assert [level for level, _ in events] == ["info"]  # where the page is


def _port(url: str) -> int:
    return int(url.partition("127.0.0.1:")[2].partition("/")[0])


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_the_server_of_the_web_viewer_forgets_what_is_beyond_its_limit(tmp_path):
    server = ViewerProcess("web", 0.1)
    view = RerunView(tmp_path / "run.rrd", f"connect:{server.url}", "run-1", lambda *_: None)
    taken_mb, deadline = 0, time.monotonic() + 60
    for index in range(100_000):
        view.show(msgspec.structs.replace(PICTURE, index=index, stamp_ns=index * 10**9))
        time.sleep(0.005)
        taken_mb = index - view.dropped
        if taken_mb > 400:
            break
        assert time.monotonic() < deadline, f"took {taken_mb} MB only"
    memory_mb = psutil.Process(server.pid).memory_info().rss / 1e6
    view.close()
    server.close()
    assert memory_mb < 300, f"{memory_mb:.0f} MB of {taken_mb} MB"
