"""`hsslam-replay` on a router of its own and towards a service that answers."""

import threading
import time
from dataclasses import replace

import msgspec
import pytest

from hsslam_node.errors import UserError
from hsslam_proto import messages, run_messages, topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_order import new_publisher
from hsslam_proto.topics import FRAME
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from hsslam_services.commands.log.replay import main, publish, wanted_names
from hsslam_services.commands.log.replay_step import StepByStep
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.reader import bus_messages
from tests.services.log.sample_log import write_log
from tests.services.wire_samples import frame, pose
from tests.until import until

_DELAY_S = 8.0  # for a listener to connect, on a busy machine


def test_a_log_is_published_again_byte_for_byte_at_twice_the_rate(tmp_path):
    path = write_log(tmp_path)
    endpoint = free_endpoint()
    port = endpoint.rpartition(":")[2]
    ended: list[int] = []
    args = [str(path), "--rate", "2", "--zenoh-port", port, "--delay", f"{_DELAY_S:g}"]
    replay = threading.Thread(target=lambda: ended.append(main(args)))
    start_s = time.monotonic()
    replay.start()
    with Bus(endpoint, "r", "listener") as bus:
        heard = {
            topic.name: bus.subscribe(topic, 64, history=False)
            for topic in (topics.FRAME, topics.POSE, topics.MESH, topics.EVENT)
        }
        replay.join()
        until(
            lambda: heard["out/mesh"].received and heard["out/pose"].received == 20
        )  # the last ones
        got = {name: [] for name in heard}
        for name, subscription in heard.items():
            while (received := subscription.poll_received()) is not None:
                got[name].append(received.payload)
    assert ended == [0]
    assert time.monotonic() - start_s > _DELAY_S + 1.9 / 2
    logged = {name: [] for name in heard}
    for message in bus_messages([path], set(heard)):
        logged[message.topic.name].append(message.payload)
    assert logged.pop("sys/event") and not got.pop("sys/event")  # what processes said is no data
    frames, heard_frames = logged.pop("in/frame"), got.pop("in/frame")
    assert got == logged
    # a link that is congested, as on a busy machine, drops frames
    assert [one for one in frames if one in heard_frames] == heard_frames
    assert len(heard_frames) > len(frames) / 2


def test_a_clock_that_was_set_is_not_waited_for(tmp_path, endpoint, capsys):
    entries = list(bus_messages([write_log(tmp_path, count=3)], {"out/pose"}))
    set_ns = (0, 86_400 * 10**9, -86_400 * 10**9)
    moved = [replace(one, log_ns=one.log_ns + by) for one, by in zip(entries, set_ns, strict=True)]
    with Bus(endpoint, "r", "replay") as bus:
        assert publish(bus, moved, rate=100) == {"out/pose": 3}
    forward, back = capsys.readouterr().err.splitlines()
    assert forward == "a gap of 86400.1 s before a message on out/pose: the replay waits 10 s"
    assert back == "a gap of -172799.9 s before a message on out/pose: the replay waits 0 s"


def test_after_a_clock_that_was_set_back_a_little_the_rate_stays(tmp_path, endpoint, capsys):
    entries = list(bus_messages([write_log(tmp_path, count=13)], {"out/pose"}))
    back_ns = [0 if k < 6 else 1_500_000_000 for k in range(13)]
    moved = [replace(one, log_ns=one.log_ns - by) for one, by in zip(entries, back_ns, strict=True)]
    begin_s = time.monotonic()
    with Bus(endpoint, "r", "replay") as bus:
        assert publish(bus, moved, rate=2) == {"out/pose": 13}
    assert time.monotonic() - begin_s > 11 * 0.1 / 2
    assert "a gap of -1.4 s" in capsys.readouterr().err


def test_messages_that_were_written_late_do_not_slow_the_replay(tmp_path, endpoint, capsys):
    """A frame waits in the recorder until it is 1.6 s older than the poses that are written before it."""
    entries = list(bus_messages([write_log(tmp_path, count=13)], {"out/pose", "in/frame"}))
    late_ns = 1_600_000_000
    begin_ns = min(one.log_ns for one in entries)
    moved = [replace(one, log_ns=one.log_ns - late_ns * (one.topic is FRAME)) for one in entries]
    span_s = (max(one.log_ns for one in moved) - begin_ns) / 1e9
    begin_s = time.monotonic()
    with Bus(endpoint, "r", "replay") as bus:
        assert publish(bus, moved, rate=1) == {"out/pose": 13, "in/frame": 13}
    assert time.monotonic() - begin_s < late_ns / 1e9 + span_s + 1
    assert "a gap of" not in capsys.readouterr().err


def test_a_service_gets_new_frames_from_each_replay_and_nothing_else(tmp_path, endpoint):
    path = write_log(tmp_path, count=3)
    to_service = ["--connect", endpoint, "--robot", "desk", "--delay", "0.2"]
    with Bus(endpoint, "desk", "supervisor") as bus:
        frames, poses = bus.subscribe(topics.FRAME, 16), bus.subscribe(topics.POSE, 16)
        heard = []
        for _ in range(2):
            assert main([str(path), *to_service]) == 0
            heard += [frames.wait(10.0) for _ in range(3)]
        assert not poses.pending()
    assert [message.index for message in heard] == [0, 1, 2] * 2
    first, second = heard[0].publisher, heard[3].publisher
    assert first != second
    assert [message.publisher for message in heard] == [first] * 3 + [second] * 3
    assert all(abs(time.time_ns() - message.stamp_ns) < 60e9 for message in heard)


def test_a_service_that_takes_no_frames_is_told(tmp_path, endpoint, capsys):
    args = [str(write_log(tmp_path, count=2)), "--connect", endpoint, "--robot", "desk"]
    with Bus(endpoint, "desk", "supervisor") as bus:
        for is_told in (True, False):
            assert main([*args, "--delay", "0.2"]) == 0
            told = f"no run takes frames at {endpoint}: expected hsslam-serve --source zenoh:"
            assert (told in capsys.readouterr().err) == is_told
            bus.subscribe(topics.FRAME, 2)
            bus.live_processes()  # a round trip: the router knows it


def test_a_service_of_another_robot_is_named_at_once(tmp_path, endpoint, capsys):
    with Bus(endpoint, "desk", "supervisor") as bus:
        bus.live_processes()  # a round trip: the router knows it
        assert main([str(write_log(tmp_path, count=2)), "--step", "--connect", endpoint]) == 2
    told = capsys.readouterr().err
    assert told == f"error: --robot r: no service of this robot at {endpoint}: expected desk\n"


@pytest.mark.parametrize("lockstep", [True, False])
def test_step_sends_a_frame_when_the_last_is_done_with(tmp_path, lockstep):
    """The count of a camera jumps twice in the log; the service would refuse a jump. Another one has a frame
    between."""
    log = PartedLog(tmp_path, "r", LogSettings())
    one, other = new_publisher(), new_publisher()
    rows = ((one, 0), (one, 1), (one, 2**40), (other, 0), (one, 2**40 + 1), (one, 2**41))
    for row, (camera, index) in enumerate(rows):
        message = msgspec.structs.replace(frame(row), index=index, publisher=camera)
        log.write(topics.FRAME, encode(topics.FRAME, message), row, row, row)
    log.close()
    (path,) = log_parts(tmp_path, print)
    endpoint = free_endpoint()
    router = open_router(endpoint)
    seen: list[tuple[int, int]] = []
    told: list[str] = []
    stop = threading.Event()
    service = threading.Thread(target=_service, args=(endpoint, lockstep, seen, stop))
    service.start()
    try:
        with Bus(endpoint, "r", "replay") as bus:
            step = StepByStep(bus, told.append, patience_s=30.0)
            sent = step.replay(bus_messages([path], {"in/frame"}))
    finally:
        stop.set()
        service.join()
        router.close()
    assert sent == {"in/frame": 6}
    assert [index for index, _ in seen] == [0, 1, 2, 0, 3, 4]  # none before its turn, none twice
    assert all(abs(time.time_ns() - stamp_ns) < 60e9 for _, stamp_ns in seen)
    assert len(told) == (0 if lockstep else 1)


def test_without_a_service_step_gives_up(tmp_path):
    path = write_log(tmp_path, count=2)
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with (
        Bus(endpoint, "r", "replay") as bus,
        pytest.raises(UserError, match="no service: expected"),
    ):
        StepByStep(bus, print, patience_s=0.3).replay(bus_messages([path]))
    router.close()


def test_keys_choose_topics():
    assert wanted_names(["in/**"]) == {"in/frame", "in/odometry", "in/imu", "in/end"}
    assert wanted_names(["out/pose", "out/mesh"]) == {"out/pose", "out/mesh"}
    assert wanted_names(["**"]) == {topic.name for topic in topics.TOPICS}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", "no log: expected FILE"),
        ("LOG --rate 0", "--rate 0: expected a number above 0"),
        ("LOG --step", "--step: waits for a service: expected --connect"),
        ("LOG --only out/posse", "--only out/posse: no such topic: expected some of in/frame"),
        ("LOG --only /a//b", "--only /a//b: expected keys such as in/**"),
        ("LOG --only sys/stop", "no messages: expected some on sys/stop"),
        (
            "LOG --only out/pose in/** --connect tcp/127.0.0.1:1",
            "--only out/pose in/**: out/pose comes from the service: expected in/** with --connect",
        ),
        ("LOG --zenoh-port 0", "--zenoh-port 0: expected 1 to 65535"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(tmp_path, capsys, line, expected):
    path = write_log(tmp_path, count=2)
    assert main(line.replace("LOG", str(path)).split()) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ") and told.count("\n") == 1
    assert expected in told


def _service(endpoint, lockstep, seen, stop):
    """Answers frames as tracker, mapper and global BA do, with a map after the first."""
    with Bus(endpoint, "r", "tracker") as bus:
        frames = bus.subscribe(topics.FRAME, 16)
        health, poses = bus.publisher(topics.HEALTH), bus.publisher(topics.POSE)
        steps, maps = bus.publisher(topics.STEP), bus.publisher(topics.MAP)
        while not stop.is_set():
            for process in ("tracker", "mapper", "global_ba"):
                health.put(
                    run_messages.Health(process=process, pid=1, state="running", rss_bytes=0)
                )
            frame = frames.wait(0.1)
            if frame is None:
                continue
            seen.append((frame.index, frame.stamp_ns))
            poses.put(msgspec.structs.replace(pose(frame.index), publisher=frame.publisher))
            time.sleep(0.05)
            if frame.index == 0:
                maps.put(
                    messages.MapVersion(
                        version=1, iterations=1, loss=1.0, keyframes=1, mapping_ms=1.0
                    )
                )
            if lockstep:
                steps.put(
                    run_messages.Step(stage="done", index=frame.index, publisher=frame.publisher)
                )
