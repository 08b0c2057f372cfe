"""A live viewer that starts, is closed, freezes, or cannot be started."""

import os
import signal
import socket
import time
import urllib.request

import msgspec
import pytest

from hsslam_services.viewer.rerun_process import ViewerProcess
from hsslam_services.viewer.view import RerunView
from tests.services.recorded import rrd
from tests.services.viewer.shown_run import show_a_run
from tests.services.wire_samples import frame, pose


def test_a_viewer_that_is_closed_is_one_event(tmp_path):
    events = []
    server = ViewerProcess("web")
    assert server.page is not None and server.page.startswith("http://127.0.0.1:")
    view = RerunView(
        tmp_path / "run.rrd", f"connect:{server.url}", "run-1", lambda *event: events.append(event)
    )
    show_a_run(view)
    _expect_looked_at(view)  # and it was found alive
    assert events == []
    server.close()
    assert server.has_ended()
    deadline = time.monotonic() + 20
    while not events and time.monotonic() < deadline:
        view.show(pose(201))
        time.sleep(0.05)
    view.show(pose(202))
    view.close()
    assert [level for level, _ in events] == ["warning"]
    assert "is closed" in events[0][1]
    rrd("verify", tmp_path / "run.rrd")


def test_a_frozen_viewer_holds_nobody_up_and_goes_on_when_it_thaws(tmp_path):
    events = []
    server = ViewerProcess("web")
    view = RerunView(
        tmp_path / "run.rrd", f"connect:{server.url}", "run-1", lambda *event: events.append(event)
    )
    show_a_run(view)
    _expect_looked_at(view)  # for the first time, with patience
    os.kill(server.pid, signal.SIGSTOP)
    large = memoryview(os.urandom(1_000_000))  # soon nothing on the way takes any more
    picture = msgspec.structs.replace(frame(0, compressed=True), color=large)
    index, deadline = 0, time.monotonic() + 20
    while not (events and view.dropped) and time.monotonic() < deadline:
        view.show(msgspec.structs.replace(picture, index=index, stamp_ns=time.time_ns()))
        index += 1
        time.sleep(0.005)
    assert [level for level, _ in events] == ["warning"]
    assert "takes no data" in events[0][1]
    assert view.dropped  # `show` came back often enough to fill the queue: it does not wait
    os.kill(server.pid, signal.SIGCONT)
    dropped = -1
    while dropped != view.dropped and time.monotonic() < deadline:  # it is drawn to again
        dropped = view.dropped
        for _ in range(20):
            view.show(msgspec.structs.replace(picture, index=index, stamp_ns=time.time_ns()))
            index += 1
            time.sleep(0.05)
    assert dropped == view.dropped
    assert len(events) == 1  # it was not taken for closed
    server.close()
    view.close()


def test_the_web_viewer_is_served_on_loopback_until_the_end(tmp_path):
    events = []
    view = RerunView(tmp_path / "run.rrd", "web", "run-1", lambda *event: events.append(event))
    show_a_run(view)
    deadline = time.monotonic() + 30
    while not events:  # as soon as the page can be opened
        assert time.monotonic() < deadline
        time.sleep(0.01)
    ((level, text),) = events
    page = text.split()[-1]
    assert level == "info" and page.startswith("http://127.0.0.1:")
    assert _status(page, patience_s=0) == 200
    address = (socket.gethostbyname(socket.gethostname()), int(page.split(":")[2].split("/")[0]))
    if not address[0].startswith("127."):
        with socket.socket() as outside:
            assert outside.connect_ex(address) != 0
    view.close()
    with pytest.raises(OSError):
        _status(page, patience_s=0)


def test_a_viewer_that_cannot_be_started_costs_no_recording(tmp_path, monkeypatch):
    nowhere = "hsslam_services.viewer.rerun_process._executable"
    monkeypatch.setattr(nowhere, lambda: "/nowhere/rerun")
    events = []
    view = RerunView(tmp_path / "run.rrd", "web", "run-1", lambda *event: events.append(event))
    show_a_run(view)
    view.close()
    ((level, text),) = events
    assert level == "warning" and "--viewer web: cannot start /nowhere/rerun" in text
    assert text.endswith("the run goes on without a viewer")
    rrd("verify", tmp_path / "run.rrd")


def _expect_looked_at(view: RerunView) -> None:
    """Draw until the viewer has been looked at."""
    watch = view._threads[-1]._watch
    assert watch is not None
    due_s, deadline = watch._next_s, time.monotonic() + 30
    while watch._next_s == due_s:
        assert time.monotonic() < deadline
        view.show(pose(200))
        time.sleep(0.05)


def _status(page, patience_s=10.0) -> int:
    deadline = time.monotonic() + patience_s
    while True:
        try:
            return urllib.request.urlopen(page, timeout=5).status
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
