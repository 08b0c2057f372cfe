"""Sequences in Replica layout."""

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.replica import ReplicaFolder, ReplicaSource
from hsslam_node.sources.source import BadFrame


def test_frames_are_stamped_at_30_hz(replica_folder):
    frames = list(ReplicaSource(str(replica_folder), SourceOptions()).frames())
    assert [f.stamp_ns for f in frames] == [0, 33333333, 66666667, 100000000]
    assert frames[2].depth_m()[0, 0] == pytest.approx(5020 / 6553.5)


def test_a_missing_depth_image_is_one_bad_frame(replica_folder):
    (replica_folder / "results/depth000001.png").unlink()
    frames = list(ReplicaSource(str(replica_folder), SourceOptions()).frames())
    assert [type(f) for f in frames] == [Frame, BadFrame, Frame, Frame]


def test_a_part_of_a_sequence_has_the_poses_of_its_numbers(replica_folder):
    """Every second of its four frames is there, and all lines of traj.txt."""
    whole = open_ground_truth(f"replica:{replica_folder}", SourceOptions())
    for number in (0, 2):
        for file in (replica_folder / "results").glob(f"*{number:06d}.*"):
            file.unlink()
    part = open_ground_truth(f"replica:{replica_folder}", SourceOptions())
    assert part is not None and whole is not None
    np.testing.assert_array_equal(part.T_world_cam, whole.T_world_cam[[1, 3]])
    np.testing.assert_array_equal(part.stamps_ns, whole.stamps_ns[[1, 3]])
    assert ReplicaSource(str(replica_folder), SourceOptions()).rate_hz == 15.0
    lines = (replica_folder / "traj.txt").read_text().splitlines(keepends=True)
    (replica_folder / "traj.txt").write_text("".join(lines[:3]))
    with pytest.raises(
        UserError, match="3 poses: expected 2, one a frame, or one for each number up"
    ):
        open_ground_truth(f"replica:{replica_folder}", SourceOptions())


def test_camera_and_mesh_beside_the_folder_as_published(replica_folder):
    shared = replica_folder.parent / "cam_params.json"
    (replica_folder / "cam_params.json").rename(shared)
    (replica_folder.parent / "room_mesh.ply").touch()
    folder = ReplicaFolder.find(str(replica_folder))
    assert folder.camera_file == shared
    assert folder.mesh_file == replica_folder.parent / "room_mesh.ply"


@pytest.mark.parametrize("content", [b"", b"ply\nformat ascii 1.0\nelement vertex 3\n"])
def test_a_damaged_true_mesh_is_one_line(replica_folder, content):
    (replica_folder.parent / "room_mesh.ply").write_bytes(content)
    truth = open_ground_truth(f"replica:{replica_folder}")
    assert truth is not None
    with pytest.raises(UserError, match=r"room_mesh\.ply: damaged mesh: .*: expected a mesh$"):
        truth.mesh()


def test_what_is_missing_is_named(replica_folder, tmp_path):
    with pytest.raises(UserError, match="no such folder"):
        ReplicaSource(str(tmp_path / "none"), SourceOptions())
    (replica_folder / "cam_params.json").unlink()
    with pytest.raises(UserError, match=r"cam_params\.json"):
        ReplicaSource(str(replica_folder), SourceOptions())
    with pytest.raises(UserError, match="no frames"):
        _ = ReplicaFolder(tmp_path).pairs


@pytest.fixture
def vmap_folder(tmp_path):
    """Two frames in the layout of vMAP."""
    folder = tmp_path / "room_0/imap/00"
    for kind, image in (
        ("rgb", np.full((680, 1200, 3), 90, np.uint8)),
        ("depth", np.full((680, 1200), 2500, np.uint16)),
    ):
        (folder / kind).mkdir(parents=True)
        for k in (2, 10):
            cv2.imwrite(str(folder / f"{kind}/{kind}_{k}.png"), image)
    np.savetxt(folder / "traj_w_c.txt", np.stack([np.eye(4), 2 * np.eye(4)]).reshape(2, 16))
    return folder


def test_layout_of_vmap(vmap_folder, tmp_path):
    source = ReplicaSource(str(vmap_folder), SourceOptions())
    frames = list(source.frames())
    assert [f.stamp_ns for f in frames] == [66666667, 333333333]  # by number, not by name
    assert source.rate_hz == 30 / 8
    assert frames[0].depth_m()[0, 0] == 2.5
    assert (frames[0].camera.fx, frames[0].camera.cx) == (600.0, 599.5)
    truth = open_ground_truth(f"replica:{vmap_folder}")
    assert truth is not None and truth.T_world_cam[1, 0, 0] == 2
    assert truth.mesh() is None
    (tmp_path / "room0_mesh.ply").touch()
    assert ReplicaFolder.find(str(vmap_folder)).mesh_file == tmp_path / "room0_mesh.ply"
    (vmap_folder / "rgb/rgb_2.png").unlink()
    frames = list(ReplicaSource(str(vmap_folder), SourceOptions()).frames())
    assert [type(f) for f in frames] == [BadFrame, Frame]


def test_real_sequence(test_data):
    source = ReplicaSource(str(test_data / "house"), SourceOptions(stride=100))
    frames = list(source.frames())
    assert len(frames) == 6
    assert all(isinstance(f, Frame) for f in frames)
    assert 0.3 < np.median(frames[0].depth_m()) < 6
