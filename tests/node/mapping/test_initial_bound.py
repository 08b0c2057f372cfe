"""The first bound holds what the first frame sees, within its limits."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.config import BoundConfig, FieldConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.layout import FieldLayout
from hsslam_node.mapping.bound import first_pose, initial_bound
from hsslam_node.slam import Slam
from tests.small_room import SMALL, room_frames, with_black


def _wall(depth_m: float) -> Frame:
    camera = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
    depth = np.full((120, 160), round(depth_m * 1000), np.uint16)
    return Frame(0, 0, camera, np.zeros((120, 160, 3), np.uint8), depth, 1000.0)


def test_every_point_of_the_first_frame_lies_inside():
    frame = room_frames()[0]
    bound = initial_bound(frame, BoundConfig(), 8.0)
    v, u = np.mgrid[:120, :160]
    camera, z = frame.camera, frame.depth_m()
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], -1)
    assert bound.contains(points[z > 0]).all()
    np.testing.assert_allclose(np.add(bound.low, bound.high), 0)  # the room goes on behind


def test_reach_is_margin_times_the_farthest_distance():
    bound = initial_bound(_wall(4.0), BoundConfig(1.5, least_m=1.0, most_m=20.0), 8.0)
    corner = 4.0 * np.linalg.norm([79.5 / 140, 59.5 / 140, 1.0])
    assert bound.high[0] == pytest.approx(1.5 * corner, rel=0.02)
    assert bound.high[2] == bound.high[0]
    assert 0.3 < bound.high[1] / bound.high[0] < 0.7  # rooms are lower than wide


@pytest.mark.parametrize(("depth_m", "reach"), [(0.5, 3.0), (7.9, 10.0)])
def test_limits(depth_m, reach):
    bound = initial_bound(_wall(depth_m), BoundConfig(2.0, least_m=3.0, most_m=10.0), 8.0)
    assert bound.high[0] == bound.high[2] == reach
    assert 3.0 <= bound.high[1] <= reach


def test_a_few_far_outliers_do_not_widen_it():
    frame = _wall(3.0)
    depth = frame.depth_raw.copy()
    depth[0, 0] = 7900
    outlier = replace(frame, depth_raw=depth)
    plain = initial_bound(frame, BoundConfig(), 8.0)
    np.testing.assert_allclose(
        initial_bound(outlier, BoundConfig(), 8.0).high, plain.high, rtol=0.03
    )


@pytest.mark.parametrize("frame", [with_black(_wall(3.0)), _wall(9.0)])
def test_a_frame_without_depth_is_told(frame):
    with pytest.raises(UserError, match="frame 0: no depth within 8"):
        initial_bound(frame, BoundConfig(), 8.0)


@pytest.mark.parametrize("frame", [_wall(2.0), with_black(_wall(3.0))])
def test_a_box_that_is_given_is_the_bound_whatever_the_frame_shows(frame):
    config = BoundConfig(box=(-1.2, -0.96, -2.4, 2.4, 1.2, 3.6))
    bound = initial_bound(frame, config, 8.0)
    assert (*bound.low, *bound.high) == config.box
    laid_out = FieldLayout.over(FieldConfig(), bound).bound  # its sides are whole coarse cells
    np.testing.assert_allclose([*laid_out.low, *laid_out.high], config.box)


def test_the_sides_of_a_box_are_rounded_up_to_whole_cells():
    config = BoundConfig(box=(-1.0, -1.0, -1.0, 1.0, 1.0, 2.0))
    laid_out = FieldLayout.over(FieldConfig(), initial_bound(_wall(2.0), config, 8.0)).bound
    np.testing.assert_allclose(laid_out.extent_m, [2.16, 2.16, 3.12])


_TURNED = (0.0, -1.0, 0.0, 1.5, 1.0, 0.0, 0.0, 0.5, 0.0, 0.0, 1.0, -0.2)  # rows of T_world_cam


def test_a_first_camera_stands_where_it_is_told_in_its_box():
    box = (-1.0, -2.0, -3.0, 4.0, 5.0, 6.0)
    config = BoundConfig(box=box, first_camera=_TURNED)
    np.testing.assert_array_equal(first_pose(config)[:3].ravel(), _TURNED)
    np.testing.assert_array_equal(first_pose(BoundConfig(box=box)), np.eye(4))
    for tracker in ("alignment", "rendering"):
        small = replace(SMALL, tracker=replace(SMALL.tracker, method=tracker), bound=config)
        mapper = replace(small.mapper, first_iterations=1)
        slam = Slam(replace(small, mapper=mapper))
        result = slam.process(room_frames()[0])
        assert slam.store is not None and result.status == "initial"
        np.testing.assert_array_equal(result.T_world_cam, first_pose(config))
        np.testing.assert_array_equal(slam.store.pose(0), first_pose(config))


@pytest.mark.parametrize(
    "given",
    [
        {"first_camera": _TURNED},  # no box
        {"box": (0, 0, 0, 1, 1, 1), "first_camera": _TURNED[:11]},
        {"box": (0, 0, 0, 1, 1, 1), "first_camera": (2.0, *_TURNED[1:])},
        {"box": (0, 0, 0, 1, 1, 1), "first_camera": (0.0, 1.0, *_TURNED[2:])},  # a mirror
    ],
)
def test_a_first_camera_is_a_rigid_pose_in_a_box(given):
    with pytest.raises(UserError, match=r"^bound\.first_camera = .*expected the rows of a rigid"):
        BoundConfig(**given)
