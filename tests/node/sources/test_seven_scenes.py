"""Sequences of 7-Scenes."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.seven_scenes import SevenScenesSource
from hsslam_node.sources.source import BadFrame
from tests.late_frames import expect_late_frames_left_out


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """Three frames; the depth of frame k is 1000 + k mm, its left column has none."""
    folder = tmp_path / "redkitchen/seq-01"
    folder.mkdir(parents=True)
    for k in range(3):
        pose = np.eye(4)
        pose[0, 3] = 0.1 * k
        depth = np.full((480, 640), 1000 + k, np.uint16)
        depth[:, 0] = 65535
        _write(folder, k, np.full((480, 640, 3), (10, 20, 30 + k), np.uint8), depth, pose)
    return folder


def _write(
    folder: Path, number: int, color: np.ndarray, depth: np.ndarray, pose: np.ndarray
) -> None:
    """A frame in the layout of the data set; colour RGB, depth mm."""
    name = f"{folder}/frame-{number:06d}"
    cv2.imwrite(f"{name}.color.png", color[..., ::-1])
    cv2.imwrite(f"{name}.depth.png", depth)
    np.savetxt(f"{name}.pose.txt", pose, fmt="%.9e", delimiter="\t")


def test_frames_camera_and_stamps(sequence):
    source = open_source(f"7scenes:{sequence}")
    frames = list(source.frames())
    assert source.camera == Camera(640, 480, 585.0, 585.0, 320.0, 240.0)
    assert (source.frame_count, source.rate_hz) == (3, 30.0)
    assert [frame.stamp_ns for frame in frames] == [0, 33333333, 66666667]
    assert [tuple(frame.color[0, 0]) for frame in frames] == [(10, 20, 30 + k) for k in range(3)]
    assert frames[2].depth_m()[0, 1] == pytest.approx(1.002)
    for path in sequence.glob("frame-000001.*"):
        path.unlink()
    assert open_source(f"7scenes:{sequence}").rate_hz == 15.0


def test_65535_means_no_depth(sequence):
    (frame,) = open_source(f"7scenes:{sequence}", SourceOptions(frames=1)).frames()
    assert isinstance(frame, Frame)
    assert not frame.depth_raw[:, 0].any()
    assert frame.depth_raw[:, 1:].all()


def test_the_truth_has_the_stamps_of_the_frames_and_leaves_out_unknown_poses(sequence):
    (sequence / "frame-000001.pose.txt").write_text("nan nan nan nan\n" * 4)
    truth = open_ground_truth(f"7scenes:{sequence}")
    assert truth is not None
    assert truth.stamps_ns.tolist() == [0, 66666667]
    assert truth.T_world_cam[:, 0, 3] == pytest.approx([0, 0.2])
    assert truth.mesh() is None
    for path in sequence.glob("*.pose.txt"):
        path.unlink()
    assert open_ground_truth(f"7scenes:{sequence}") is None


def test_registered_images_bring_their_own_camera(sequence):
    options = SourceOptions(camera=CameraOptions(fx=511.8, fy=511.8))
    assert open_source(f"7scenes:{sequence}", options).camera.fx == 511.8
    (sequence / "camera.json").write_text('{"fx": 500, "depth_scale": 5000}')
    source = open_source(f"7scenes:{sequence}")
    assert (source.camera.fx, source.depth_units_per_m) == (500.0, 5000.0)


def test_registered_images_may_have_another_size(sequence):
    """A broken first pair does not show the size; the file may name it, but not a wrong one."""
    for k in range(3):
        color, depth_mm = np.full((48, 64, 3), 9, np.uint8), np.full((48, 64), 1000, np.uint16)
        _write(sequence, k, color, depth_mm, np.eye(4))
    (sequence / "frame-000000.color.png").write_bytes(b"")
    with pytest.raises(
        UserError, match=r"fx and depth_scale are missing: expected in camera\.json"
    ):
        open_source(f"7scenes:{sequence}")
    own = CameraOptions(fx=52.5, depth_scale=1000.0)
    sources = [open_source(f"7scenes:{sequence}", SourceOptions(camera=own))]
    for size in ("", '"width": 64, "height": 48, '):
        (sequence / "camera.json").write_text("{" + size + '"fx": 52.5, "depth_scale": 1000}')
        sources.append(open_source(f"7scenes:{sequence}"))
    for source in sources:
        assert source.camera == Camera(64, 48, 52.5, 52.5, 31.5, 23.5)
        assert [type(frame) for frame in source.frames()] == [BadFrame, Frame, Frame]
    (sequence / "camera.json").write_text(
        '{"fx": 525, "width": 640, "height": 480, "depth_scale": 1}'
    )
    with pytest.raises(UserError, match="640x480 pixels, images have 64x48"):
        open_source(f"7scenes:{sequence}")


def test_a_damaged_image_is_one_bad_frame(sequence):
    damaged = sequence / "frame-000001.depth.png"
    damaged.write_bytes(damaged.read_bytes()[:100])
    (sequence / "frame-000002.color.png").unlink()
    frames = list(open_source(f"7scenes:{sequence}").frames())
    assert [type(frame) for frame in frames] == [Frame, BadFrame, BadFrame]


def test_what_is_wrong_is_one_line(sequence):
    with pytest.raises(UserError, match="no such folder here or in"):
        open_source(f"7scenes:{sequence}-none")
    with pytest.raises(
        UserError, match=r"redkitchen: no frames: expected frame-000000\.color\.png"
    ):
        open_source(f"7scenes:{sequence.parent}")
    with pytest.raises(UserError, match=f"did you mean 7scenes:{sequence}"):
        open_source(str(sequence))
    (sequence / "frame-000002.pose.txt").write_text("1 0 0 0\n0 1 0 0\n")
    with pytest.raises(UserError, match=r"frame-000002\.pose\.txt: 2x4 numbers") as caught:
        open_ground_truth(f"7scenes:{sequence}")
    assert "\n" not in str(caught.value)


def test_frames_of_the_real_kitchen_come_back_as_they_were(test_data, tmp_path):
    """The kitchen is a part of RedKitchen, registered to colour; its depth has 5000 units a metre."""
    kitchen, used = f"tum:{test_data / 'kitchen'}", SourceOptions(frames=3)
    truth = open_ground_truth(kitchen, used)
    source = open_source(kitchen, used)
    frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    assert truth is not None
    for k, frame in enumerate(frames):
        millimetres = np.round(1000 * frame.depth_m()).astype(np.uint16)
        depth = np.where(frame.depth_raw == 0, np.uint16(65535), millimetres)
        _write(tmp_path, k, frame.color, depth, truth.T_world_cam[k])
    camera = source.camera
    options = SourceOptions(
        camera=CameraOptions(fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy)
    )
    found = [
        f for f in open_source(f"7scenes:{tmp_path}", options).frames() if isinstance(f, Frame)
    ]
    assert len(found) == len(frames) == 3
    for one, other in zip(frames, found, strict=True):
        assert other.camera == one.camera
        assert (other.color == one.color).all()
        assert ((other.depth_raw == 0) == (one.depth_raw == 0)).all()
        assert np.abs(other.depth_m() - one.depth_m()).max() <= 0.00051
    again = open_ground_truth(f"7scenes:{tmp_path}")
    assert again is not None
    np.testing.assert_allclose(again.T_world_cam, truth.T_world_cam, atol=1e-8)


def test_late_frames_are_not_read(sequence):
    expect_late_frames_left_out(open_source(f"7scenes:{sequence}"))


def test_fy_is_fx_if_only_that_is_given(sequence):
    source = SevenScenesSource(str(sequence), SourceOptions(camera=CameraOptions(fx=525.0)))
    assert (source.camera.fx, source.camera.fy, source.camera.cx) == (525.0, 525.0, 320.0)
