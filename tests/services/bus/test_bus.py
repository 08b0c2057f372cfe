import os
import signal
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_proto import messages, run_messages, topics
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from hsslam_services.bus.dead_pools import pools_of
from hsslam_services.bus.zenoh_session import open_client
from tests.services.bus.expect import expect
from tests.services.wire_samples import frame
from tests.until import until

_BLOCKED_S = 0.25  # no bound on speed: a publisher that waits for a reader waits 1 s


def test_messages_arrive_in_order_with_their_envelope(endpoint):
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        stops = b.subscribe(topics.STEP, depth=64)
        publisher = a.publisher(topics.STEP)
        until(publisher.has_subscribers)
        for index in range(1, 40):
            publisher.put(run_messages.Step(stage="done", index=index))
        assert [expect(stops).index for _ in range(1, 40)] == list(range(1, 40))
        assert (stops.dropped, stops.rejected) == (0, 0)


_LAST_WORDS = """
import sys
from hsslam_services.bus.bus import Bus
from hsslam_proto import run_messages, topics
with Bus(sys.argv[1], "r", "a") as bus:
    events, end = bus.publisher(topics.EVENT), bus.publisher(topics.SOURCE_END)
    for index in range(20):
        events.put(run_messages.Event(process="a", level="info", text=str(index), stamp_ns=1))
    end.put(run_messages.SourceEnd(frame_count=7))
"""


def test_what_a_process_says_last_arrives_though_it_ends_at_once(endpoint):
    with Bus(endpoint, "r", "b") as bus:
        events, ends = bus.subscribe(topics.EVENT, 64), bus.subscribe(topics.SOURCE_END, 1)
        subprocess.run([sys.executable, "-c", _LAST_WORDS, endpoint], check=True)
        assert expect(ends).frame_count == 7
        assert [event.text for event in events.drain()] == [str(index) for index in range(20)]


def test_shared_memory_is_open_before_the_first_frame(endpoint):
    """Else the first frame goes by socket in pieces, and is lost if one is not read in time."""
    with Bus(endpoint, "r", "a") as a:
        before = pools_of(os.getpid())
        a.publisher(topics.POSE)
        a.publisher(topics.FRAME, block=True)  # waits for its reader
        assert not pools_of(os.getpid()) - before
        a.publisher(topics.FRAME)
        until(lambda: pools_of(os.getpid()) - before)


def test_newest_wins_and_the_rest_is_counted(endpoint):
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        frames = b.subscribe(topics.FRAME, depth=1)
        publisher = a.publisher(topics.FRAME, block=True)
        until(publisher.has_subscribers)
        for index in range(1, 6):
            publisher.put(_frame(index))
        until(lambda: frames.received == 5)
        assert [frame.index for frame in frames.drain()] == [5]
        assert frames.dropped == 4


def test_each_message_says_how_many_were_dropped_before_it(endpoint):
    """So a reader can save a count that fits the messages it has read, with others still waiting."""
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        frames = b.subscribe(topics.FRAME, depth=2)
        publisher = a.publisher(topics.FRAME, block=True)
        until(publisher.has_subscribers)
        for index in range(5):
            publisher.put(_frame(index))
        until(lambda: frames.received == 5)
        read = [frames.poll_received(), frames.poll_received()]
        assert [(each.message.index, each.missed) for each in read] == [(3, 3), (4, 0)]
        awaited = {read[-1].envelope.publisher: read[-1].envelope.sequence + 1}
        frames.close()
        until(lambda: not publisher.has_subscribers())
        publisher.put(_frame(5))
        later = b.subscribe(topics.FRAME, depth=2, awaited=awaited)
        until(publisher.has_subscribers)
        publisher.put(_frame(6))
        missed_one = later.wait_received(10)
        assert (missed_one.message.index, missed_one.missed, later.dropped) == (6, 1, 1)


def test_a_frame_wakes_the_waiting_reader(endpoint):
    with Bus(endpoint, "r", "a") as a, _reader(endpoint, wait_s=1000.0) as reader:
        assert reader.stdout is not None and reader.stdout.readline() == "eady\n"
        publisher = a.publisher(topics.FRAME)
        latencies_ms = []
        for index in range(40):
            publisher.put(_frame(index))
            latencies_ms.append(float(reader.stdout.readline()))
        reader.kill()
    print(f"1.5 MB frame, process to process: median {statistics.median(latencies_ms):.2f} ms")


def test_late_publishers_are_found(endpoint):
    with Bus(endpoint, "r", "a") as a:
        ends = a.subscribe(topics.SOURCE_END, depth=4)
        with Bus(endpoint, "r", "b") as b:
            b.publisher(topics.SOURCE_END).put(run_messages.SourceEnd(frame_count=7))
            assert expect(ends).frame_count == 7
        assert ends.wait(0.2) is None


def test_what_cannot_be_read_is_counted_and_told(endpoint):
    outsider = open_client(endpoint)
    with Bus(endpoint, "r", "b") as b:
        poses = b.subscribe(topics.POSE, depth=8)
        key = topics.POSE.key("r")
        known = "application/msgpack;hsslam.Pose.v1"
        publisher = outsider.declare_publisher(key)
        until(lambda: publisher.matching_status.matching)
        publisher.put(b"\xc1" * 9, encoding=known)
        publisher.put(b"\x80", encoding="application/msgpack;hsslam.Pose.v2")
        publisher.put(bytes(2**17), encoding=known)
        publisher.put(b"", encoding="application/msgpack;hsslam.Frame.v1")
        until(lambda: poses.received == 4)
        assert (poses.rejected, poses.pending()) == (4, 0)
        reasons = [rejected.reason for rejected in poses.take_rejections()]
        assert sorted(reasons) == ["malformed", "schema", "size", "version"]
    outsider.close()


def test_live_processes_follow_sigkill(endpoint):
    with Bus(endpoint, "r", "a") as a, _reader(endpoint) as reader:
        assert ("reader", reader.pid) in a.live_processes()
        assert ("a", os.getpid()) in a.live_processes()
        reader.kill()
        reader.wait()
        until(lambda: ("reader", reader.pid) not in a.live_processes())


def test_sigkill_of_a_reader_does_not_disturb_the_others(endpoint):
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        frames = b.subscribe(topics.FRAME, depth=100)
        publisher = a.publisher(topics.FRAME)
        until(publisher.has_subscribers)
        with _reader(endpoint) as reader:
            slowest_s = 0.0
            for index in range(1, 60):
                if index == 20:
                    reader.kill()
                begin = time.monotonic()
                publisher.put(_frame(index))
                slowest_s = max(slowest_s, time.monotonic() - begin)
                time.sleep(0.01)
            assert [expect(frames).index for _ in range(1, 60)] == list(range(1, 60))
            assert slowest_s < _BLOCKED_S


def test_a_frozen_reader_does_not_hold_up_frames_and_poses(endpoint):
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        frames = b.subscribe(topics.FRAME, depth=1)
        publisher = a.publisher(topics.FRAME)
        until(publisher.has_subscribers)
        with _reader(endpoint) as reader:
            reader.send_signal(signal.SIGSTOP)
            slowest_s, received = 0.0, 0
            for index in range(1, 60):
                begin = time.monotonic()
                publisher.put(_frame(index))
                slowest_s = max(slowest_s, time.monotonic() - begin)
                received += frames.wait(0.5) is not None
            reader.kill()
            assert received >= 50
            assert slowest_s < _BLOCKED_S


@pytest.mark.parametrize("how", ["close", "leave open", "raise", "router gone"])
def test_the_interpreter_ends(endpoint, how):
    code = f"""
from hsslam_services.bus.bus import Bus, open_router
from hsslam_proto import topics
endpoint = {endpoint!r}
if {how!r} == "router gone":
    from hsslam_services.bus.bus import free_endpoint
    endpoint = free_endpoint()
    router = open_router(endpoint)
bus = Bus(endpoint, "r", "p")
for topic in topics.TOPICS:
    bus.subscribe(topic, depth=4, history=True), bus.publisher(topic)
if {how!r} == "close": bus.close()
if {how!r} == "raise": raise SystemExit(3)
if {how!r} == "router gone": router.close()
"""
    done = subprocess.run([sys.executable, "-c", code], timeout=20, capture_output=True, text=True)
    assert done.returncode == (3 if how == "raise" else 0), done.stderr
    assert "Traceback" not in done.stderr


def test_a_busy_port_is_one_line(endpoint):
    with pytest.raises(UserError, match="expected a free port") as error:
        open_router(endpoint)
    assert "\n" not in str(error.value)


def test_a_free_port_goes_to_no_connection_before_a_router_takes_it():
    given_by_kernel = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    ports = [int(free_endpoint().rpartition(":")[2]) for _ in range(20)]
    assert max(ports) < given_by_kernel
    assert len(set(ports)) > 1


def test_no_router_is_one_line():
    with pytest.raises(UserError, match="expected a router"):
        open_client(free_endpoint(), timeout_s=0.3)


def test_names_that_are_no_key_are_refused(endpoint):
    with pytest.raises(UserError, match="robot 'a/b'"):
        Bus(endpoint, "a/b", "p")


def test_clients_come_back_after_the_router(endpoint):
    address = free_endpoint()
    router = open_router(address)
    with Bus(address, "r", "a") as a, Bus(address, "r", "b") as b:
        router.close()
        until(lambda: not a.is_connected())
        router = open_router(address)
        steps, publisher = b.subscribe(topics.STEP, depth=4), a.publisher(topics.STEP)
        until(publisher.has_subscribers)
        publisher.put(run_messages.Step(stage="done", index=1))
        assert expect(steps).index == 1
    router.close()


def _reader(endpoint, wait_s=0.05) -> subprocess.Popen:
    """Another process that reads frames and prints the latency of each, ms; its "r" has been read."""
    code = f"""
import signal, time
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
stop = []
signal.signal(signal.SIGTERM, lambda *_: stop.append(1))
with Bus({endpoint!r}, "r", "reader") as bus:
    frames = bus.subscribe(topics.FRAME, depth=1)
    time.sleep(0.2)
    print("ready", flush=True)
    while not stop:
        frame = frames.wait({wait_s})
        if frame is not None:
            print((time.time_ns() - frame.stamp_ns) / 1e6, flush=True)
"""
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert process.stdout is not None
    process.stdout.read(1)
    return process


def _frame(index: int) -> messages.Frame:
    return frame(index, width_px=640, height_px=480)
