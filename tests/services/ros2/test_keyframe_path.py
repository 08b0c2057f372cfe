"""The path that ROS hears: stamps of a saved map and of a recording, on whatever clocks they are."""

import tracemalloc
from dataclasses import replace

import numpy as np

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_services.ros2.keyframe_path import keyframe_path
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.stamp_clock import StampClock
from tests.long_store import LongStore
from tests.small_room import room_frames

_NOW_NS = 1_700_000_000_000_000_000
_OFFSET_NS = 1_600_000_000_000_000_000  # from the clock of this run's source to that of ROS
_LATEST = (2**31 - 1, 999_999_999)


def _continued() -> KeyframeStore:
    """A saved map of three keyframes, stamped since 1970, and three of a recording that counts from 0."""
    frame = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), frame.camera, frame.depth_units_per_m, 16)
    for k in range(6):
        if k == 3:
            store.mark_inherited()
        stamp_ns = k + (_NOW_NS if k < 3 else 0)
        store.append(replace(frame, index=k, stamp_ns=stamp_ns), se3_exp(np.full(6, 0.1 * k)))
    return store


def test_keyframes_of_a_saved_map_have_the_stamp_of_the_message():
    store, robot, clock = _continued(), RobotFrames(), StampClock()
    clock.learn(3, _OFFSET_NS + 3)
    stamps_ns, poses = keyframe_path(store, robot, clock, _NOW_NS, most=6)
    assert stamps_ns == [_NOW_NS, _NOW_NS, _NOW_NS, _OFFSET_NS + 3] and len(poses) == 4  # yet
    clock.learn(5, _OFFSET_NS + 5)
    own_ns = [_OFFSET_NS + k for k in (3, 4, 5)]
    stamps_ns, poses = keyframe_path(store, robot, clock, _NOW_NS, most=6)
    assert stamps_ns == [_NOW_NS, _NOW_NS, _NOW_NS, *own_ns]
    np.testing.assert_allclose(poses, [robot.base_pose(T) for T in store.poses()])
    stamps_ns, poses = keyframe_path(store, robot, clock, _NOW_NS, most=4)
    assert stamps_ns == [_NOW_NS, _NOW_NS, own_ns[1]] and len(poses) == 3


def test_the_path_of_a_long_run_reads_only_the_poses_that_it_has():
    long = LongStore(MemoryAllocator())
    long.extend(3000)
    clock = StampClock()
    clock.learn(3000, 3000)
    tracemalloc.start()
    _, poses = keyframe_path(long.store, RobotFrames(), clock, _NOW_NS, most=50)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_allclose(poses, [RobotFrames().base_pose(T) for T in long.T_world_cam[::60]])
    assert peak_bytes < 2e5  # all poses are 384 kB


def test_a_time_that_ros_cannot_tell_becomes_the_nearest():
    make = RosMessages("test")
    path = make.path(_NOW_NS, "map", [-5, _NOW_NS + _OFFSET_NS], np.stack([np.eye(4)] * 2))
    told = make.decoded(make.encoded(path), "nav_msgs/msg/Path")
    stamps = [one.header.stamp for one in told.poses]
    assert [(stamp.sec, stamp.nanosec) for stamp in stamps] == [(0, 0), _LATEST]
