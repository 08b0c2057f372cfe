"""What ROS 2 hears of a real run, beside the poses in the log of the run."""

import signal
from typing import Any

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse, quaternion_from_rotation, transform
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto.messages import Pose
from hsslam_proto.pose_codec import covariance_matrix, pose_matrix
from hsslam_services.commands.certs import make_certificates
from hsslam_services.log.reading.poses import logged_poses
from hsslam_services.ros2.initial_pose import KIND, TOPIC
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import TopicName
from hsslam_services.security.credentials import client_settings
from tests.services.recorded import read_viz
from tests.services.ros2.ros_listener import Heard, RosListener, gid_of
from tests.services.serve_process import SMALL_ROOM

_FRAMES, _MOST_FRAMES = 75, 600  # a busy machine needs more until it has computed a grid


def _mount() -> tuple[float, ...]:
    """Of the first camera on a robot that stands on the floor of the room: 20 cm ahead, looking down."""
    small = SourceOptions(frames=1, synth=SynthOptions(width_px=160, height_px=120))
    truth = open_ground_truth("synth:room", small)
    assert truth
    T_room_cam = truth.T_world_cam[0]
    x = T_room_cam[:3, 2] * [1, 1, 0]
    x /= np.linalg.norm(x)
    R_base_cam = np.stack([x, np.cross([0, 0, 1], x), [0, 0, 1]]) @ T_room_cam[:3, :3]
    q = quaternion_from_rotation(R_base_cam)
    return (0.2, 0.05, float(T_room_cam[2, 3]), *q.tolist())


_MOUNT = _mount()
_ROBOT = RobotFrames.mounted(_MOUNT)
_QOS = {
    "/hsslam/map": ":1:,1:,:,:,,",
    "/hsslam/odom": "::,10:,:,:,,",
    "/hsslam/path": "::,1:,:,:,,",
    "/hsslam/points": "2::,5:,:,:,,",
    "/hsslam/pose": "::,10:,:,:,,",
    "/hsslam/static_map_slice": "::,1:,:,:,,",
    "/tf": "::,100:,:,:,,",
    "/tf_static": ":1:,1:,:,:,,",
}


@pytest.mark.e2e
def test_a_run_is_told_to_ros(serve, own_address, tmp_path):
    """A node with a certificate hears it at another address than the one where nodes look first."""
    certs, endpoint = tmp_path / "certs", f"tls/{own_address}:7447"
    make_certificates(certs, (own_address,), 7)
    settings = client_settings(endpoint, str(certs / "viewer"))
    listener = RosListener(endpoint, settings=settings)  # before there is a router
    for topic in _QOS:
        if topic != "/tf_static":
            listener.hear(topic)
    try:
        run = serve(
            *SMALL_ROOM, "--frames", str(_MOST_FRAMES), "--finish-s", "1", "--rate-hz", "20",
            "--zenoh-port", "7447", "--bind", own_address, "--security", str(certs / "router"),
            "--ros2-out", "/hsslam", "--grid", "--base-T-camera", *map(str, _MOUNT),
        )  # fmt: skip
        listener.wait_until(lambda: listener.alive() == len(_QOS) + 2, 240)
        tokens = listener.tokens()
        listener.wait_until(lambda: listener.count("/hsslam/pose") > 2, 240)
        _set_initial_pose(listener)
        listener.hear_latched("/tf_static")  # after it was sent
        listener.wait_until(lambda: listener.count("/hsslam/pose") >= _FRAMES, 240)
        listener.wait_until(lambda: all(map(listener.count, _QOS)), 240)
        listener.wait_until(lambda: "/initialpose: the camera is found at " in run.stderr, 120)
        run.signal(signal.SIGINT)
        assert run.finish() == 0, run.stderr
        assert "grid: direction up by --base-T-camera: " in run.stderr
        assert " degrees off that by " not in run.stderr
        listener.wait_until(lambda: listener.alive() == 0)
    finally:
        listener.close()
    heard = {topic: listener.heard(topic) for topic in _QOS}
    logged = {pose.stamp_ns: pose for pose in logged_poses([run.out / "run.mcap"]).poses}
    _expect_graph(heard, tokens)
    _expect_poses(heard, logged)
    _expect_mount(heard["/tf_static"])
    _expect_layer(read_viz(run.out / "run.mcap"), heard["/tf"])
    _expect_path(heard["/hsslam/path"], logged)
    _expect_points(heard["/hsslam/points"], logged)
    _expect_map(heard["/hsslam/map"], logged)
    _expect_slice(heard["/hsslam/static_map_slice"], heard["/hsslam/map"])
    assert run.summary()["processes"]["ros2_out"]["restarts"] == 0


def _set_initial_pose(listener: RosListener) -> None:
    """The base has hardly left the origin of the map."""
    messages = RosMessages("test")
    name = TopicName(TOPIC, KIND, messages.type_hash(KIND))
    listener.send(name, messages.encoded(messages.pose(1, "map", np.eye(4), None)))


def _expect_graph(heard: dict[str, list[Heard]], tokens: set[str]) -> None:
    """Node and publishers, their QoS; messages are numbered and name their publisher."""
    (node,) = (token for token in tokens if "/NN/" in token)
    assert node.split("/")[6:] == ["%", "%hsslam", "slam"]
    for topic, qos in _QOS.items():
        (token,) = (t for t in tokens if f"/{topic.replace('/', '%')}/" in t)
        assert token.endswith(f"/{qos}")
        numbers = [one.sequence for one in heard[topic]]
        assert numbers == sorted(set(numbers)), topic  # a busy machine drops some
        assert {one.gid for one in heard[topic]} == {gid_of(topic, tokens)}


def _expect_poses(heard: dict[str, list[Heard]], logged: dict[int, Pose]) -> None:
    """Pose, odometry and transforms of a frame are those of the log, all three with the image's stamp."""
    poses, odometry, tf = (_by_stamp(heard[t]) for t in ("/hsslam/pose", "/hsslam/odom", "/tf"))
    all_three = sorted(poses.keys() & odometry.keys() & tf.keys())
    assert len(all_three) > _FRAMES // 3
    before: tuple[int, int, np.ndarray] | None = None  # index, stamp in ns, T_odom_base
    for stamp_ns in all_three:
        pose, ours = poses[stamp_ns], logged[stamp_ns]
        T_world_cam = transform(np.array(ours.t), np.array(ours.q))
        T_map_base = _ROBOT.base_pose(T_world_cam)
        T_odom_base = _ROBOT.base_pose(pose_matrix(ours.odometry))
        assert pose.header.frame_id == "map"
        np.testing.assert_allclose(_matrix(pose.pose.pose), T_map_base, atol=1e-9)
        map_odom, odom_base = tf[stamp_ns].transforms
        assert (map_odom.header.frame_id, map_odom.child_frame_id) == ("map", "odom")
        assert (odom_base.header.frame_id, odom_base.child_frame_id) == ("odom", "base_link")
        np.testing.assert_allclose(_matrix(odom_base.transform), T_odom_base, atol=1e-9)
        chain = _matrix(map_odom.transform) @ _matrix(odom_base.transform)
        np.testing.assert_allclose(chain, T_map_base, atol=1e-9)
        told = odometry[stamp_ns]
        assert (told.header.frame_id, told.child_frame_id) == ("odom", "base_link")
        np.testing.assert_allclose(_matrix(told.pose.pose), T_odom_base, atol=1e-9)
        covariance = covariance_matrix(ours.covariance)
        assert covariance is not None
        np.testing.assert_allclose(
            np.reshape(pose.pose.covariance, (6, 6)),
            _ROBOT.base_covariance(covariance, T_world_cam) + 1e-8 * np.eye(6),
            atol=1e-12,
        )
        if before is not None and ours.index == before[0] + 1:
            linear = told.twist.twist.linear
            moved_m = (inverse(before[2]) @ T_odom_base)[:3, 3]
            seconds = 1e-9 * (stamp_ns - before[1])
            # of the stamps that it has, although the recording is played at another rate
            np.testing.assert_allclose([linear.x, linear.y, linear.z], moved_m / seconds, atol=0.02)
            assert np.any(told.twist.covariance)
            assert np.linalg.norm(moved_m) < 0.2  # no jump
        before = ours.index, stamp_ns, T_odom_base


def _expect_layer(viz: dict[str, list], heard: list[Heard]) -> None:
    """The log has the transforms of /tf for Foxglove, between its world and its camera."""
    told = _by_stamp(heard)
    of: dict[str, dict[int, Any]] = {}
    for one in viz["/viz/tf"]:
        of.setdefault(one.child_frame_id, {})[one.timestamp.ToNanoseconds()] = one
    assert {child: {one.parent_frame_id for one in at.values()} for child, at in of.items()} == {
        "map": {"world"},
        "odom": {"map"},
        "base_link": {"odom"},
        "camera": {"base_link"},
    }
    for stamp_ns, tf in told.items():
        for one in tf.transforms:
            logged = _matrix(of[one.child_frame_id][stamp_ns])
            np.testing.assert_allclose(_matrix(one.transform), logged, atol=1e-9)


def _expect_mount(heard: list[Heard]) -> None:
    (mount,) = heard[-1].by_rosbags.transforms
    assert (mount.header.frame_id, mount.child_frame_id) == ("base_link", "camera_optical_frame")
    np.testing.assert_allclose(_matrix(mount.transform), _ROBOT.T_base_cam, atol=1e-12)
    ahead = _ROBOT.T_base_cam @ [0, 0, 1, 1]  # a metre in front of the camera
    assert 0.8 < ahead[0] < 1.2 and abs(ahead[1] - 0.05) < 1e-9 and ahead[2] < _MOUNT[2]


def _expect_path(heard: list[Heard], logged: dict[int, Pose]) -> None:
    path = heard[-1].by_rosbags
    assert path.header.frame_id == "map" and len(path.poses) >= 2
    stamps_ns = np.array(sorted(logged))
    for stamped in path.poses:
        nearest_ns = stamps_ns[np.abs(stamps_ns - _stamp_ns(stamped)).argmin()]
        assert abs(nearest_ns - _stamp_ns(stamped)) <= 5_000_000
        pose = logged[int(nearest_ns)]
        by_log = _ROBOT.base_pose(transform(np.array(pose.t), np.array(pose.q)))
        by_path = _matrix(stamped.pose)
        assert np.linalg.norm((by_path - by_log)[:3, 3]) < 0.05


def _expect_points(heard: list[Heard], logged: dict[int, Pose]) -> None:
    cloud = heard[-1].by_rosbags
    assert cloud.header.frame_id == "camera_optical_frame" and _stamp_ns(cloud) in logged
    points = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 4)
    assert 5000 < len(points) <= 20_000 and 0.2 < points[:, 2].min() < points[:, 2].max() < 10


def _expect_map(heard: list[Heard], logged: dict[int, Pose]) -> None:
    """The grid lies on the floor of `map`, with its axes, and is free where the robot looks along."""
    grid = heard[-1].by_rosbags
    assert grid.header.frame_id == "map" and _stamp_ns(grid) in logged
    assert heard[-1].by_pycdr2.data == grid.data.tolist()
    T_map_grid = _matrix(grid.info.origin)
    np.testing.assert_allclose(T_map_grid[:3, :3], np.eye(3), atol=1e-6)
    assert abs(T_map_grid[2, 3]) < 0.05
    pose = logged[_stamp_ns(grid)]
    T_map_cam = _ROBOT.T_base_cam @ transform(np.array(pose.t), np.array(pose.q))
    ahead = T_map_cam @ np.array([[0, 0, z, 1] for z in (0.6, 0.9)]).T
    cells = grid.data.reshape(grid.info.height, grid.info.width)
    column, row = np.floor((ahead[:2] - T_map_grid[:2, 3:]) / grid.info.resolution).astype(int)
    assert (cells[row, column] == 0).all() and (cells == 100).sum() > 50


def _expect_slice(heard: list[Heard], grids: list[Heard]) -> None:
    """Distances are those between the cells of the grid of the same frame."""
    grid_of = _by_stamp(grids)
    slices = [one.by_rosbags for one in heard if _stamp_ns(one.by_rosbags) in grid_of]
    found, grid = slices[-1], grid_of[_stamp_ns(slices[-1])]
    assert (found.header.frame_id, found.unknown_value) == ("map", 1000.0)
    assert (found.width, found.height) == (grid.info.width, grid.info.height)
    origin = grid.info.origin.position
    assert (found.origin.x, found.origin.y) == (origin.x, origin.y)
    np.testing.assert_array_equal(found.data == 1000.0, grid.data == -1)
    np.testing.assert_array_equal(found.data == 0.0, grid.data == 100)
    assert 0.5 < found.data[grid.data == 0].max() <= 2.0


def _by_stamp(heard: list[Heard]) -> dict[int, object]:
    return {_stamp_ns(_stamped(one.by_rosbags)): one.by_rosbags for one in heard}


def _stamped(message):
    return message if hasattr(message, "header") else message.transforms[0]


def _stamp_ns(message) -> int:
    stamp = message.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def _matrix(pose) -> np.ndarray:
    """[4, 4] of a `Pose` or a `Transform`."""
    t = pose.position if hasattr(pose, "position") else pose.translation
    q = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    return transform(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))
