"""The router of a run: who meets where, what outsiders may do, and that frozen ones hold nobody up."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from hsslam_node.errors import UserError
from hsslam_proto import run_messages, topics
from hsslam_services.bus.bus import Bus, free_endpoint
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.run.options import ServeOptions
from hsslam_services.supervisor.descriptors import most_sessions
from hsslam_services.supervisor.router import RunRouter, open_run_router
from tests.services.ros2.ros_listener import ros_peer
from tests.services.wire_samples import frame, keyframe, pose
from tests.until import until

_LATEST_S = 0.05
_HELD_UP_S = 0.25  # a busy machine is late by itself; zenoh waits 1 s for one that takes nothing
_SENT_S = 5.0
_FROZEN = """
import sys, time, zenoh
from hsslam_services.bus.zenoh_session import open_client
session = open_client(sys.argv[1], settings={"transport/shared_memory/enabled": False})
subscriber = zenoh.ext.declare_advanced_subscriber(
    session, sys.argv[2], lambda sample: print(end="."),
    history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
    recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True))
print("ready", flush=True)
time.sleep(60)
"""
_SENDER = """
import sys, time
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
endpoint, process, name, rate_hz, nbytes, until_s = sys.argv[1:]
topic = next(topic for topic in topics.TOPICS if topic.name == name)
with Bus(endpoint, "r", process) as bus:
    publisher = bus.publisher(topic)
    print("ready", flush=True)
    for _ in range(int(float(until_s) * float(rate_hz))):
        publisher.put_payload(bytes(int(nbytes)), time.time_ns())
        time.sleep(1 / float(rate_hz))
"""
_SENT = (  # by the other processes of a run: process, topic, Hz, bytes
    ("camera", "in/frame", "30", "1500000"),
    ("mesher", "out/mesh", "4", "5000000"),
    ("saver", "out/mesh", "4", "5000000"),
    ("global_ba", "out/correction", "4", "2000000"),
    ("mapper", "out/correction", "4", "2000000"),
)


def test_without_a_port_only_this_user_s_processes_meet(tmp_path):
    with _router(tmp_path) as router:
        assert router.endpoint == f"unixsock-stream/{tmp_path}/router.sock"
        assert (tmp_path / "router.sock").is_socket()
        assert _tcp_ports() == set()
        with Bus(router.endpoint, "r", "a") as a, Bus(router.endpoint, "r", "b") as b:
            poses, sent = b.subscribe(topics.POSE, 4), a.publisher(topics.POSE)
            until(lambda: (sent.put(pose(0)), poses.wait(0.1))[1])


@pytest.mark.parametrize(
    ("asked", "place"),
    [
        ({}, ""),
        ({"source": "tum:fr1/desk"}, ""),
        ({"source": "zenoh:"}, "127.0.0.1:7447"),
        ({"source": "ros2:/camera"}, "127.0.0.1:7447"),
        ({"ros2_out": "/hsslam"}, "127.0.0.1:7447"),
        ({"zenoh_port": 9}, "127.0.0.1:9"),
        ({"bind": "0.0.0.0"}, "0.0.0.0:7447"),
        ({"security": "certs"}, "127.0.0.1:7447"),
    ],
)
def test_a_port_is_open_if_it_is_asked_for(asked, place):
    assert ServeOptions(**asked).outside_place == place


def test_an_open_port_takes_frames_and_no_heartbeats(tmp_path):
    port = int(free_endpoint().rpartition(":")[2])
    with (
        _router(tmp_path, source="zenoh:", zenoh_port=port) as router,
        Bus(router.endpoint, "r", "supervisor") as inside,
        Bus(f"tcp/127.0.0.1:{port}", "r", "tracker") as outside,
    ):
        heard = {topic: inside.subscribe(topic, 8) for topic in topics.TOPICS}
        looking = outside.subscribe(topics.KEYFRAME, 8)
        frames = outside.publisher(topics.FRAME)
        until(lambda: (frames.put(frame(0)), heard[topics.FRAME].wait(0.1))[1])
        forged = run_messages.Health(
            process="tracker", pid=os.getpid(), state="running", rss_bytes=1
        )
        outside.publisher(topics.HEALTH).put(forged)
        outside.publisher(topics.STOP).put(run_messages.Stop(reason="forged"))
        outside.publisher(topics.POSE).put(pose(0))
        with open_client(f"tcp/127.0.0.1:{port}") as plain:
            for key in ("hsslam/r/**", "hsslam/r/sys/health", "hsslam/**", "**"):
                plain.put(key, b"by any means")
            frames.put(frame(1))
            until(lambda: heard[topics.FRAME].pending())
        inside.publisher(topics.KEYFRAME).put(keyframe(0))
        until(lambda: looking.pending() and heard[topics.KEYFRAME].pending())
        taken = {topic.name for topic, subscription in heard.items() if subscription.received}
        assert taken == {"in/frame", "out/keyframe"}
        assert {live.process for live in inside.live_processes()} == {"supervisor"}


@pytest.mark.alone  # latencies
@pytest.mark.parametrize("key", ["hsslam/r/out/mesh", "hsslam/r/**"])
def test_a_frozen_subscriber_delays_no_pose(tmp_path, key):
    port = int(free_endpoint().rpartition(":")[2])
    with _router(tmp_path, zenoh_port=port) as router:
        frozen = [_started(_FROZEN, f"tcp/127.0.0.1:{port}", key) for _ in range(2)]
        senders = [_started(_SENDER, router.endpoint, *sent, str(_SENT_S)) for sent in _SENT]
        try:
            late_s = _latencies_s(router.endpoint, lambda: _freeze(frozen))
        finally:
            for process in (*frozen, *senders):
                process.kill()
        print(f"{key}: {len(late_s)} poses, slowest {1e3 * max(late_s):.1f} ms")
        assert len(late_s) > 20 * _SENT_S
        assert sorted(late_s)[int(0.99 * len(late_s))] < _LATEST_S
        assert max(late_s) < _HELD_UP_S


def test_sessions_are_bounded_by_the_descriptors_there_are(tmp_path, monkeypatch):
    monkeypatch.setattr("resource.getrlimit", lambda _: (16, 16))
    most = most_sessions()
    monkeypatch.undo()
    assert most == 4 < most_sessions() <= 1000
    monkeypatch.setattr("hsslam_services.supervisor.router.most_sessions", lambda: most)
    with _router(tmp_path) as router:
        sessions = [open_client(router.endpoint) for _ in range(most)]
        with pytest.raises(UserError, match="expected a router"):
            open_client(router.endpoint, timeout_s=1.0)
        sessions.pop().close()
        sessions.append(open_client(router.endpoint))  # there is room again
        for session in sessions:
            session.close()


def test_nodes_of_ros_and_of_the_run_meet_at_the_router(tmp_path):
    port = int(free_endpoint().rpartition(":")[2])
    with (
        _router(tmp_path, source="ros2:/camera", zenoh_port=port) as router,
        open_client(f"tcp/127.0.0.1:{port}") as outside,
        open_client(router.endpoint) as inside,
    ):
        _expect_met(outside, inside, "camera")
        _expect_met(inside, outside, "slam")


def test_nodes_of_ros_hear_one_another(tmp_path):
    """Peers set up as those of rmw_zenoh; what they send under keys of the run reaches no process of it."""
    port = int(free_endpoint().rpartition(":")[2])
    with (
        _router(tmp_path, ros2_out="/hsslam", zenoh_port=port) as router,
        open_client(router.endpoint) as inside,
        ros_peer(f"tcp/localhost:{port}") as one,
        ros_peer(f"tcp/localhost:{port}") as other,
    ):
        poses = inside.declare_subscriber("hsslam/**")
        _expect_met(one, other, "planner")
        _expect_met(other, one, "controller")
        one.put("hsslam/r/out/pose", b"by any means")
        _expect_met(one, inside, "planner")
        assert poses.try_recv() is None


def test_a_busy_port_is_named(tmp_path, own_address):
    (tmp_path / "other").mkdir()
    connects = "; if rmw_zenohd has 7447, the run then connects to it"
    advised = {
        ("zenoh:", None): "expected a free port, as --zenoh-port 7448",
        ("zenoh:", 7449): "expected a free port",
        ("ros2:/camera", None): f"expected a free port, as --zenoh-port 7448{connects}",
    }
    for (source, port), expected in advised.items():
        options = {"source": source, "zenoh_port": port, "bind": own_address}
        place = f"tcp/{own_address}:{port or 7447}: cannot listen there: Address already in use: "
        with _router(tmp_path, **options), pytest.raises(UserError) as refused:
            open_run_router(ServeOptions(**options), tmp_path / "other")
        assert place in str(refused.value) and str(refused.value).endswith(expected)


def _expect_met(node: zenoh.Session, other: zenoh.Session, name: str) -> None:
    """The other hears a topic and the token of the node."""
    images = other.declare_subscriber(f"0/{name}/**")
    nodes = other.liveliness().declare_subscriber(f"@ros2_lv/**/{name}", history=True)
    token = node.liveliness().declare_token(f"@ros2_lv/0/abc/0/0/NN/%/%/{name}")
    until(lambda: (node.put(f"0/{name}/image/type/hash", b"x"), images.try_recv())[1])
    until(nodes.try_recv)
    token.undeclare()


def _latencies_s(endpoint: str, freeze: Callable[[], None]) -> list[float]:
    """Of poses that go from one client to another at 60 Hz, from sending to receiving."""
    found = []
    with Bus(endpoint, "r", "tracker") as tracker, Bus(endpoint, "r", "supervisor") as other:
        sent, kept = tracker.publisher(topics.POSE), tracker.publisher(topics.KEYFRAME)
        heard = other.subscribe(topics.POSE, 64, history=False)
        until(lambda: (sent.put(pose(0)), heard.wait(0.1))[1])
        freeze()
        end_s = time.monotonic() + _SENT_S
        while time.monotonic() < end_s:
            begin_s = time.monotonic()
            sent.put(pose(0))
            kept.put(keyframe(0))
            if heard.wait(2.0) is not None:
                found.append(time.monotonic() - begin_s)
            time.sleep(1 / 60)
    return found


def _freeze(processes: list[subprocess.Popen]) -> None:
    for process in processes:
        process.send_signal(signal.SIGSTOP)


def _started(code: str, *arguments: str) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, env=environment
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    return process


@contextmanager
def _router(folder: Path, **options) -> Iterator[RunRouter]:
    router = open_run_router(ServeOptions(robot="r", **options), folder)
    try:
        yield router
    finally:
        router.session.close()


def _tcp_ports() -> set[int]:
    import psutil

    own = psutil.Process().net_connections("tcp")
    return {c.laddr.port for c in own if c.status == psutil.CONN_LISTEN}
