"""Sequences in Replica layout."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.replica import ReplicaSource
from hsslam_node.sources.replica_folder import ReplicaFolder
from hsslam_node.sources.source import BadFrame, SourceOptions


def test_frames_are_stamped_at_30_hz(replica_folder):
    frames = list(ReplicaSource(str(replica_folder), SourceOptions()).frames())
    assert [f.stamp_ns for f in frames] == [0, 33333333, 66666667, 100000000]
    assert frames[2].depth_m()[0, 0] == pytest.approx(5020 / 6553.5)


def test_a_missing_depth_image_is_one_bad_frame(replica_folder):
    (replica_folder / "results/depth000001.png").unlink()
    frames = list(ReplicaSource(str(replica_folder), SourceOptions()).frames())
    assert [type(f) for f in frames] == [Frame, BadFrame, Frame, Frame]


def test_camera_and_mesh_beside_the_folder_as_published(replica_folder):
    shared = replica_folder.parent / "cam_params.json"
    (replica_folder / "cam_params.json").rename(shared)
    (replica_folder.parent / "room_mesh.ply").touch()
    folder = ReplicaFolder.find(str(replica_folder))
    assert folder.camera_file == shared
    assert folder.mesh_file == replica_folder.parent / "room_mesh.ply"


def test_what_is_missing_is_named(replica_folder, tmp_path):
    with pytest.raises(UserError, match="no such folder"):
        ReplicaSource(str(tmp_path / "none"), SourceOptions())
    (replica_folder / "cam_params.json").unlink()
    with pytest.raises(UserError, match=r"cam_params\.json"):
        ReplicaSource(str(replica_folder), SourceOptions())
    with pytest.raises(UserError, match="no frames"):
        _ = ReplicaFolder(tmp_path).pairs


def test_real_sequence(test_data):
    source = ReplicaSource(str(test_data / "house"), SourceOptions(stride=100))
    frames = list(source.frames())
    assert len(frames) == 6
    assert all(isinstance(f, Frame) for f in frames)
    assert 0.3 < np.median(frames[0].depth_m()) < 6
