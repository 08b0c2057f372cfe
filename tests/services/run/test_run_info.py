"""run.json carries every option to the processes of a run."""

from dataclasses import replace
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.run_info import RunInfo

_LINE = "--preset paper --slam.tracker.points 777 --synth.size-m 5 5 3 --frames 9 --seed 4"


def test_options_survive_the_file(tmp_path: Path):
    info = RunInfo(
        "id", str(tmp_path), "/a", "tcp/h:1", "r", 1, 2, parse_command_line(_LINE.split())
    )
    info.write()
    assert RunInfo.read(tmp_path) == info


@pytest.mark.parametrize("text", [None, "{", '{"run_id": 3}'])
def test_a_folder_without_a_run_is_told_in_one_line(tmp_path: Path, text: str | None):
    if text is not None:
        (tmp_path / "run.json").write_text(text)
    with pytest.raises(UserError, match=r"expected run\.json of a run") as caught:
        RunInfo.read(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("asked", "endpoint"),
    [
        ("--ros2-out /hsslam", "unixsock-stream//a/router.sock"),
        ("--bind 10.0.0.7 --security certs", "unixsock-stream//a/router.sock"),
        ("--zenoh-port 7447", "unixsock-stream//a/router.sock"),
        ("--zenoh-port 7448", "tcp/127.0.0.1:7447"),  # beside rmw_zenohd
        ("--zenoh-port 7448 --ros2.connect tcp/192.168.1.1:7447", "tcp/192.168.1.1:7447"),
    ],
)
def test_ros_nodes_are_at_the_router_that_has_their_port(asked: str, endpoint: str):
    options = parse_command_line(asked.split())
    info = RunInfo("id", "/r", "/a", "unixsock-stream//a/router.sock", "r", 1, 2, options)
    assert info.ros_endpoint == info.source_options.ros2.connect == endpoint


def test_a_copy_that_does_not_fit_into_shared_memory_is_no_fault_of_the_run_folder(
    run_info: RunInfo, tmp_path: Path
):
    """A folder in the place of the file stands for memory without a free page."""
    arena = tmp_path / "arena"
    (arena / "run.json" / "full").mkdir(parents=True)
    with pytest.raises(UserError, match=f"{arena}: .*: expected more shared memory"):
        replace(run_info, arena_dir=str(arena)).write_into_arena()
