"""Options of what goes out to ROS 2: wrong ones are one line, before a run begins."""

import importlib.util
import re
import shlex

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.launch.process_table import PROCESSES
from hsslam_services.ros2.type_store import expect_packages
from hsslam_services.run.options import ServeOptions
from tests.repository import ROOT


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"ros2_out": "hsslam"}, "--ros2-out 'hsslam': expected a namespace such as /hsslam"),
        ({"ros2_out": "/1"}, "expected a namespace such as /hsslam"),
        ({"ros2_frame_prefix": "/a"}, "--ros2-frame-prefix '/a': expected .* as robot1/"),
        ({"base_T_camera": (0.0,) * 7}, "--base-T-camera .* norm 0: expected a unit quaternion"),
        (
            {"grid_from_height_m": 0.41, "grid_to_height_m": 0.42},
            r"--grid-from-height-m 0.41 --grid-to-height-m 0.42: expected a multiple of 0.05 m",
        ),
    ],
)
def test_wrong_options(fields, words):
    with pytest.raises(UserError, match=words):
        ServeOptions(**fields)


def test_the_router_is_open_for_the_domain_of_ros():
    options = ServeOptions(ros2_out="/hsslam")
    assert options.ros_domain == 0 and options.outside_place
    assert ServeOptions().ros_domain is None


def test_the_process_is_there_if_it_is_asked_for():
    (spec,) = (spec for spec in PROCESSES if spec.name == "ros2_out")
    assert spec.exists(ServeOptions(ros2_out="/hsslam"))
    assert not spec.exists(ServeOptions())
    assert not spec.is_needed("realtime") and not spec.is_needed("lockstep")


def test_the_command_of_the_page_is_ours():
    text = (ROOT / "docs/ros2.md").read_text()
    (words,) = re.findall(r"^\$ hsslam-serve (.+)$", text, re.MULTILINE)
    options = parse_command_line(shlex.split(words))
    assert (options.source, options.ros2_out, options.grid) == (
        "ros2:/camera/camera",
        "/hsslam",
        True,
    )
    assert options.base_T_camera == (0.20, 0, 0.35, -0.5, 0.5, -0.5, 0.5)


def test_what_is_missing_is_named_with_its_remedy(monkeypatch):
    expect_packages("--ros2-out /hsslam")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        UserError, match=r"package rosbags is not installed: pip install 'hsslam-node"
    ):
        expect_packages("--ros2-out /hsslam")
