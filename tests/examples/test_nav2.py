"""The files for Nav2 name the topics and frames that a run publishes."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import yaml

from hsslam_services.ros2.names import FrameNames
from tests.repository import ROOT

_FOLDER = ROOT / "examples/nav2"
_FRAMES = FrameNames.of("")
_TOPICS = {
    line.split("`")[1]
    for line in (ROOT / "docs/ros2.md").read_text().splitlines()
    if line.startswith("| `/")
}


def _values(tree: Any, key: str) -> Iterator[str]:
    if isinstance(tree, dict):
        for name, value in tree.items():
            if name == key:
                yield value
            yield from _values(value, key)


def test_the_parameters_name_what_a_run_publishes():
    parameters = yaml.safe_load((_FOLDER / "navigation.yaml").read_text())
    keys = ("topic", "odom_topic", "map_topic")
    topics = {topic for key in keys for topic in _values(parameters, key)}
    assert topics == {"/hsslam/odom", "/hsslam/points", "/hsslam/map"} and topics <= _TOPICS
    assert {*_values(parameters, "global_frame")} == {_FRAMES.map, _FRAMES.odom}
    assert {*_values(parameters, "robot_base_frame")} == {_FRAMES.base}
    assert {*_values(parameters, "sensor_frame")} == {_FRAMES.camera}


def test_the_collision_monitor_looks_at_the_points_and_at_nothing_else():
    """Nav2's own parameters name the frame base_footprint and a lidar, without which the robot stands."""
    parameters = yaml.safe_load((_FOLDER / "navigation.yaml").read_text())
    monitor = parameters["collision_monitor"]["ros__parameters"]
    assert (monitor["base_frame_id"], monitor["odom_frame_id"]) == (_FRAMES.base, _FRAMES.odom)
    (source,) = (monitor[name] for name in monitor["observation_sources"])
    assert (source["type"], source["topic"]) == ("pointcloud", "/hsslam/points")
    costmap = parameters["local_costmap"]["local_costmap"]["ros__parameters"]["obstacle_layer"]
    heights = (costmap["min_obstacle_height"], costmap["depth"]["max_obstacle_height"])
    assert (source["min_height"], source["max_height"]) == heights


def test_the_costmap_takes_each_map_in_before_the_next_comes():
    """Else it is out of date most of the time, and Nav2 waits with its plans."""
    parameters = yaml.safe_load((_FOLDER / "navigation.yaml").read_text())
    often_hz = parameters["global_costmap"]["global_costmap"]["ros__parameters"]["update_frequency"]
    lines = (ROOT / "docs/ros2.md").read_text().splitlines()
    (row,) = (line for line in lines if line.startswith("| `/hsslam/map`"))
    told = re.search(r"\| (\d+) Hz at most \|", row)
    assert told and often_hz >= 2 * float(told[1])


def test_points_of_the_floor_clear_the_costmap_and_do_not_mark_it():
    """Nav2 drops points outside the heights of a source; the layer marks with those in its own heights."""
    parameters = yaml.safe_load((_FOLDER / "navigation.yaml").read_text())
    layer = parameters["local_costmap"]["local_costmap"]["ros__parameters"]["obstacle_layer"]
    assert layer["depth"]["clearing"]
    assert layer["depth"]["min_obstacle_height"] < 0 < layer["min_obstacle_height"]


def test_the_page_says_in_which_frames_heights_count():
    """The height of `odom` drifts, and then the floor is an obstacle."""
    parameters = yaml.safe_load((_FOLDER / "navigation.yaml").read_text())
    odom = parameters["local_costmap"]["local_costmap"]["ros__parameters"]["global_frame"]
    base = parameters["collision_monitor"]["ros__parameters"]["base_frame_id"]
    told = " ".join((ROOT / "docs/ros2.md").read_text().split())
    assert f"heights from z of `{odom}`" in told
    assert f"from `min_height` to `max_height` over `{base}`" in told


def test_the_parameters_are_merged_into_those_of_nav2(tmp_path):
    theirs = {
        "amcl": {"ros__parameters": {"z_hit": 0.5}},
        "bt_navigator": {"ros__parameters": {"odom_topic": "/odom", "bt_loop_duration": 10}},
        "collision_monitor": {"ros__parameters": {"observation_sources": ["scan"]}},
    }
    (tmp_path / "nav2_params.yaml").write_text(yaml.safe_dump(theirs))
    command = [sys.executable, _FOLDER / "merged_parameters.py", tmp_path / "nav2_params.yaml"]
    found = yaml.safe_load(subprocess.run(command, check=True, capture_output=True).stdout)
    ours = yaml.safe_load((_FOLDER / "navigation.yaml").read_text())
    bt = found["bt_navigator"]["ros__parameters"]
    assert bt == {**ours["bt_navigator"]["ros__parameters"], "bt_loop_duration": 10}
    assert found["collision_monitor"] == ours["collision_monitor"]
    assert found["amcl"] == theirs["amcl"] and found["local_costmap"] == ours["local_costmap"]


def test_a_python_without_pyyaml_is_one_line(tmp_path):
    (tmp_path / "yaml.py").write_text("raise ImportError")
    done = subprocess.run(
        [sys.executable, _FOLDER / "merged_parameters.py", "nav2_params.yaml"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1 and not done.stdout
    assert done.stderr == (
        f"{sys.executable}: no PyYAML: expected the Python of ROS, /usr/bin/python3\n"
    )


def test_the_topics_of_the_page_are_those_of_the_code():
    services = ROOT / "services/hsslam_services"
    files = ("processes/ros2_out.py", "ros2/floor_out.py")
    code = "".join((services / file).read_text() for file in files)
    names = re.findall(r'node\.publisher\(\s*"([^"]+)"', code)
    assert {name if name.startswith("/") else f"/hsslam/{name}" for name in names} == _TOPICS


def test_the_launch_file_starts_nav2_without_localisation():
    launch = ElementTree.parse(_FOLDER / "navigation.launch.xml").getroot()
    include = launch.find("include")
    assert include is not None and include.get("file", "").endswith("/navigation_launch.py")
    environment = launch.find("set_env")
    assert environment is not None and environment.get("value") == "rmw_zenoh_cpp"


def test_the_page_says_who_publishes_each_transform_if_the_run_does_not():
    _, _, told = (ROOT / "docs/ros2.md").read_text().partition("add `--no-ros2-tf`")
    chain = (_FRAMES.map, _FRAMES.odom, _FRAMES.base, _FRAMES.camera)
    assert all(f"| `{parent}` -> `{child}`" in told for parent, child in pairwise(chain))
    assert f"--frame-id {_FRAMES.base} --child-frame-id {_FRAMES.camera} " in told
