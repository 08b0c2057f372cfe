"""What a process file says at its beginning is what the process does."""

import ast
import time
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_proto.request_messages import Ask
from hsslam_proto.requests import PAUSE, RESUME
from hsslam_proto.topics import EVENT, HEALTH, IMU, ODOMETRY, TOPICS
from hsslam_services.bus.ask import ask
from hsslam_services.processes.process_diagram import (
    ARENA_ARRAYS,
    process_diagram,
    process_headers,
    read_header,
)
from tests.repository import ROOT
from tests.services.serve_process import SMALL_ROOM

_SERVICES = ROOT / "services"
_LOGGED = {topic.name for topic in TOPICS if topic.logged}
_HEADERS = {header.name: header for header in process_headers()}
# besides its own file, a process opens topics in these
_ROOMS = {
    "camera": ("camera/*.py", "bus/peers.py", "bus/robot_sensors.py"),
    "distances": ("tracked/waiting_frames.py",),
    "ros2_out": ("ros2/floor_out.py", "tracked/waiting_frames.py"),
    "supervisor": ("supervisor/*.py", "health/*.py", "requests/*.py"),
    "tracker": ("tracked/poses_out.py", "tracked/keyframes_out.py"),
}


def _files_of(name: str) -> list[Path]:
    services = _SERVICES / "hsslam_services"
    own = [] if name == "supervisor" else [services / "processes" / f"{name}.py"]
    return own + [file for room in _ROOMS.get(name, ()) for file in services.glob(room)]


def _opened(files: list[Path], method: str) -> set[str]:
    """Names of the topics in calls of `bus.<method>(topic, ...)`."""
    found: set[str] = set()
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == method:
                found |= _topics_of(node)
    return found


def _topics_of(call: ast.Call) -> set[str]:
    word = call.args[0] if call.args else None
    name = word.attr if isinstance(word, ast.Attribute) else getattr(word, "id", "")
    if name == "topic":  # a loop over the table
        return _LOGGED
    return {topic.name} if (topic := getattr(topics, name, None)) in TOPICS else set()


@pytest.mark.parametrize("name", _HEADERS)
def test_topics_of_a_header_are_those_of_the_code(name: str):
    files = _files_of(name)
    assert _opened(files, "subscribe") == set(_HEADERS[name].subscribes)
    assert _opened(files, "publisher") == set(_HEADERS[name].publishes)


def test_the_table_of_topics_names_the_same_publishers():
    for topic in TOPICS:
        if topic in (HEALTH, EVENT):  # of every process
            continue
        if topic in (ODOMETRY, IMU):  # of a program of the robot: no process of ours may publish it
            assert topic.publisher == "outside"
            assert not any(topic.name in header.publishes for header in _HEADERS.values())
            continue
        publishers = {name for name, header in _HEADERS.items() if topic.name in header.publishes}
        assert set(topic.publisher.split(", ")) == publishers, topic.name


@pytest.mark.e2e
def test_processes_map_the_arrays_of_their_headers(serve):
    run = serve(*SMALL_ROOM, "--pace", "lockstep", "--frames", "16")
    seen: dict[str, set[str]] = {}

    def look() -> None:
        for name in _HEADERS:
            if (pid := run.pid_of(name)) is not None:
                seen.setdefault(name, set()).update(_mapped_groups(pid))
        time.sleep(0.1)  # the run needs the cores

    def mesher_has_mapped_all() -> bool:
        look()
        return seen.get("mesher", set()) >= set(_HEADERS["mesher"].reads)

    run.wait_for_poses(4)
    ask(run.endpoint, "robot", PAUSE, Ask())  # else the run may end before the mesher gets a core
    run.wait_until(mesher_has_mapped_all, timeout_s=120)
    ask(run.endpoint, "robot", RESUME, Ask())
    while run.process.poll() is None:
        look()
    assert run.finish() == 0, run.stderr
    assert {"tracker", "mapper", "global_ba", "mesher", "camera"} <= set(seen)
    for name, groups in seen.items():
        header = _HEADERS[name]
        assert groups <= {*header.reads, *header.writes}, name
        if name in ("tracker", "mapper", "global_ba", "mesher"):  # they live long enough to map all
            assert groups == {*header.reads, *header.writes}, name


def _mapped_groups(pid: int) -> set[str]:
    try:
        lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    except OSError:
        return set()
    arrays = {Path(line.split()[-1]).name for line in lines if "/dev/shm/hsslam-" in line}
    return {_group_of(array) for array in arrays}


def _group_of(array: str) -> str:
    return next(group for group, starts in ARENA_ARRAYS.items() if array.startswith(starts))


def test_the_diagram_of_the_document_is_current():
    assert process_diagram() in (ROOT / "docs/architecture.md").read_text()


def test_a_header_with_an_unknown_topic_is_refused(tmp_path):
    file = tmp_path / "tracker.py"
    file.write_text('"""A process.\n\nSubscribes: in/frames\n"""\n')
    with pytest.raises(UserError, match="header of tracker: in/frames: expected one of"):
        read_header(file)
