"""Topics of a camera in ROS 2."""

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.options.topics import Ros2Options


def test_topics_are_below_the_camera_unless_they_say_otherwise():
    assert Ros2Options().topics_under("/camera") == (
        "/camera/color/image_raw",
        "/camera/aligned_depth_to_color/image_raw",
        "/camera/color/camera_info",
    )
    other = Ros2Options(color="rgb/image_rect_color/compressed", depth="/depth", info="info")
    assert other.topics_under("/a/b") == (
        "/a/b/rgb/image_rect_color/compressed",
        "/depth",
        "/a/b/info",
    )
    compressed = Ros2Options(color="/c/image_raw/compressed")
    assert compressed.topics_under("/")[2] == "/c/camera_info"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Ros2Options(color="a b"), "--ros2.color 'a b'"),
        (lambda: Ros2Options(depth="/"), "--ros2.depth '/'"),
        (lambda: Ros2Options(info="a//b"), "--ros2.info 'a//b'"),
        (lambda: Ros2Options(domain=-1), "--ros2.domain -1"),
        (lambda: Ros2Options(connect="localhost"), "--ros2.connect 'localhost'"),
        (lambda: Ros2Options(max_dt_ms=float("nan")), "--ros2.max-dt-ms nan"),
        (lambda: Ros2Options(timeout_s=0), "--ros2.timeout-s 0"),
        (lambda: Ros2Options().topics_under("camera"), "expected the camera's namespace"),
        (lambda: Ros2Options().topics_under("/camera/*"), "expected the camera's namespace"),
    ],
)
def test_wrong_ones_are_named(make, words):
    with pytest.raises(UserError, match=words.replace("*", r"\*")):
        make()
