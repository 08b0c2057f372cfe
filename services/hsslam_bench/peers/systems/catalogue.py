"""The peers that this machine can run, and the sequences of their table."""

from hsslam_bench.peers.systems.open3d_slam import (
    MOST_DEPTH_M,
    TRUNCATION_VOXELS,
    VOXEL_M,
    expect_open3d,
)
from hsslam_bench.peers.systems.opencv_odometry import KEYFRAME_DEG, KEYFRAME_M
from hsslam_bench.peers.systems.peer import Peer

SEQUENCES = ("livingroom", "kitchen", "house", "house-kinect")
_SYSTEMS = "hsslam_bench.peers.systems"
_OPENCV = "colour and depth at full size, algorithm COMMON, depth up to 4 m"

PEERS = (
    Peer(
        name="hs-slam",
        title="HS-SLAM, realtime",
        settings="preset realtime in one process",
        estimate=f"{_SYSTEMS}.own_slam:track_and_map",
        prepare=f"{_SYSTEMS}.own_slam:prepare",
    ),
    Peer(
        name="opencv-frames",
        title="OpenCV odometry, frame to frame",
        settings=_OPENCV,
        estimate=f"{_SYSTEMS}.opencv_odometry:from_frame_to_frame",
    ),
    Peer(
        name="opencv-keyframes",
        title="OpenCV odometry, keyframes",
        settings=f"{_OPENCV}; a keyframe every {100 * KEYFRAME_M:g} cm or {KEYFRAME_DEG:g} degrees",
        estimate=f"{_SYSTEMS}.opencv_odometry:against_keyframes",
    ),
    Peer(
        name="open3d-slam",
        title="Open3D dense SLAM",
        settings=f"voxels of {1000 * VOXEL_M:.1f} mm cut off at {TRUNCATION_VOXELS:g} voxels, depth up to "
        f"{MOST_DEPTH_M:g} m",
        estimate=f"{_SYSTEMS}.open3d_slam:frame_to_model",
        expect=expect_open3d,
    ),
)
