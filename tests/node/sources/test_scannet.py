"""ScanNet scenes, exported and as recordings."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.scannet import on_depth
from hsslam_node.sources.source import BadFrame
from tests.late_frames import expect_late_frames_left_out
from tests.node.sources.scannet_files import (
    COLOR_K,
    DEPTH_K,
    HEIGHT,
    UNKNOWN,
    WIDTH,
    Sens,
    images,
    pose,
    write_export,
)

POSES = [pose(0), pose(1), UNKNOWN, pose(3), pose(4)]
CROP = np.s_[10:-10, 10:-10]


@pytest.fixture(params=["exported", "sens"])
def scene(request, tmp_path) -> str:
    """The source of one scene in both forms."""
    if request.param == "sens":
        return f"scannet:{Sens(poses=POSES).write(tmp_path / 'scene0000_00.sens')}"
    return f"scannet:{write_export(tmp_path / 'scene0000_00', POSES)}"


def test_frames_are_those_that_were_written(scene):
    source = open_source(scene)
    frames = list(source.frames())
    assert [f.stamp_ns for f in frames] == [0, 33333333, 66666667, 100000000, 133333333]
    assert source.frame_count == 5 and source.rate_hz == 30.0
    camera = source.camera
    assert (camera.width_px, camera.height_px) == (WIDTH - 20, HEIGHT - 20)
    assert (camera.fx, camera.fy) == (DEPTH_K[0, 0], DEPTH_K[1, 1])
    assert (camera.cx, camera.cy) == (DEPTH_K[0, 2] - 10, DEPTH_K[1, 2] - 10)
    for k, frame in enumerate(frames):
        assert isinstance(frame, Frame)
        assert np.array_equal(frame.depth_raw, images(k)[1][CROP])
        assert frame.depth_units_per_m == 1000.0
        assert abs(float(frame.color[..., 2].mean()) - 20 * k) < 2


def test_a_folder_as_downloaded_is_its_recording(tmp_path):
    folder = tmp_path / "scene0000_00"
    folder.mkdir()
    file = Sens(poses=POSES).write(folder / "scene0000_00.sens")
    (folder / "scene0000_00.txt").write_text("colorWidth = 1296\n")
    assert len(list(open_source(f"scannet:{folder}").frames())) == 5
    truth = open_ground_truth(f"scannet:{folder}")
    assert truth is not None and len(truth.T_world_cam) == 4
    file.with_stem("another").write_bytes(file.read_bytes())
    with pytest.raises(UserError, match=r"no frames: expected .*, or with one \.sens file"):
        open_source(f"scannet:{folder}")
    write_export(folder, POSES[:2])
    assert len(list(open_source(f"scannet:{folder}").frames())) == 2  # what is exported counts


def test_colour_is_where_the_depth_looks(scene):
    """Red is the column and green twice the row of the colour image that a depth pixel looks at."""
    frame = next(iter(open_source(scene).frames()))
    assert isinstance(frame, Frame)
    v, u = np.mgrid[: HEIGHT - 20, : WIDTH - 20].astype(float)
    x = (u + 10 - DEPTH_K[0, 2]) / DEPTH_K[0, 0]
    y = (v + 10 - DEPTH_K[1, 2]) / DEPTH_K[1, 1]
    assert np.abs(frame.color[..., 0] - (COLOR_K[0, 0] * x + COLOR_K[0, 2])).mean() < 1
    assert np.abs(frame.color[..., 1] - 2 * (COLOR_K[1, 1] * y + COLOR_K[1, 2])).mean() < 2


def test_truth_leaves_out_what_is_not_known(scene):
    truth = open_ground_truth(scene)
    assert truth is not None
    assert truth.stamps_ns.tolist() == [0, 33333333, 100000000, 133333333]
    assert np.allclose(truth.T_world_cam, [pose(0), pose(1), pose(3), pose(4)], atol=1e-6)
    assert truth.mesh() is None
    thinned = open_ground_truth(scene, SourceOptions(stride=2, frames=2))
    assert thinned is not None and thinned.stamps_ns.tolist() == [0]


def test_a_scene_of_unknown_poses_has_no_truth(tmp_path):
    path = Sens(poses=[UNKNOWN, UNKNOWN]).write(tmp_path / "a.sens")
    assert open_ground_truth(f"scannet:{path}") is None
    assert len(list(open_source(f"scannet:{path}").frames())) == 2


def test_mesh_beside_the_frames(scene, tmp_path):
    mesh = trimesh.creation.box()
    mesh.export(tmp_path / "scene0000_00_vh_clean_2.ply")
    truth = open_ground_truth(scene)
    assert truth is not None and truth.mesh() is not None


def test_stride_and_count_choose_the_same_frames(scene):
    frames = list(open_source(scene, SourceOptions(stride=2, frames=2)).frames())
    assert [f.stamp_ns for f in frames] == [0, 66666667]


def test_padded_numbers_with_gaps_have_their_poses_and_their_rate(tmp_path):
    folder = write_export(tmp_path / "scene", POSES)
    for path in [path for path in folder.glob("*/*") if path.stem.isdigit()]:
        path.rename(path.with_stem(f"{2 * int(path.stem):06d}"))
    source, truth = open_source(f"scannet:{folder}"), open_ground_truth(f"scannet:{folder}")
    assert source.rate_hz == 15.0
    assert open_source(f"scannet:{folder}", SourceOptions(stride=2, frames=1)).rate_hz == 7.5
    assert truth is not None
    assert truth.stamps_ns.tolist() == [0, 66666667, 200000000, 266666667]
    assert np.allclose(truth.T_world_cam, [pose(0), pose(1), pose(3), pose(4)], atol=1e-6)


def test_same_camera_leaves_colour_as_it_is():
    color = images(3)[0]
    camera = Camera(2 * WIDTH, 2 * HEIGHT, *(COLOR_K[k] for k in ((0, 0), (1, 1), (0, 2), (1, 2))))
    assert np.array_equal(on_depth(color, COLOR_K, camera), color)


def test_images_that_cannot_be_read_cost_one_frame_each(tmp_path):
    folder = write_export(tmp_path / "scene", POSES)
    (folder / "color/1.jpg").write_bytes((folder / "color/1.jpg").read_bytes()[:200])
    (folder / "depth/3.png").unlink()
    frames = list(open_source(f"scannet:{folder}").frames())
    assert [type(f) for f in frames] == [Frame, BadFrame, Frame, BadFrame, Frame]
    (folder / "pose/0.txt").unlink()
    truth = open_ground_truth(f"scannet:{folder}")
    assert truth is not None and len(truth.stamps_ns) == 3


def test_depth_of_another_size_costs_its_frame(tmp_path):
    folder = write_export(tmp_path / "scene", POSES)
    cv2.imwrite(str(folder / "depth/2.png"), np.zeros((7, 9), np.uint16))
    frames = list(open_source(f"scannet:{folder}").frames())
    assert [type(f) for f in frames] == [Frame, Frame, BadFrame, Frame, Frame]


def _halve(kind: str) -> Callable[[Path], None]:
    """Damage to a scene: images that were made smaller, with the intrinsics of the large ones."""

    def halve(folder: Path) -> None:
        for path in (folder / kind).iterdir():
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert image is not None and cv2.imwrite(str(path), image[::2, ::2])

    return halve


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: (f / "intrinsic/intrinsic_depth.txt").unlink(), "intrinsic_depth.txt"),
        (lambda f: (f / "intrinsic/intrinsic_color.txt").write_text("1 2\n"), "four lines of four"),
        (lambda f: [p.unlink() for p in f.glob("*/*.[jp][pn]g")], "no frames"),
        (lambda f: [p.write_bytes(b"") for p in f.glob("depth/*")], "no image can be read"),
        (
            _halve("color"),
            r"_color\.txt: cx = 81, cy = 59: expected about 39\.5 and 29\.5, the middle",
        ),
        (_halve("depth"), r"_depth\.txt: cx = 40\.25, cy = 29\.5: expected about 19\.5 and 14\.5"),
    ],
)
def test_what_a_folder_lacks_is_told(tmp_path, damage, message):
    folder = write_export(tmp_path / "scene", POSES)
    damage(folder)
    with pytest.raises(UserError, match=message) as told:
        open_source(f"scannet:{folder}")
    assert "\n" not in str(told.value)


def test_a_malformed_pose_is_told(tmp_path):
    folder = write_export(tmp_path / "scene", POSES)
    (folder / "pose/1.txt").write_text("1 0 0\n")
    with pytest.raises(UserError, match=r"pose/1\.txt"):
        open_ground_truth(f"scannet:{folder}")


def test_a_scene_that_is_not_there_is_told(tmp_path):
    with pytest.raises(UserError, match=r"expected a \.sens file, or a folder with color/"):
        open_source(f"scannet:{tmp_path / 'none'}")


def test_late_frames_are_not_read(scene):
    expect_late_frames_left_out(open_source(scene))


def test_masks_lie_on_the_colour_images(tmp_path):
    folder, masks = write_export(tmp_path / "scene", POSES), tmp_path / "masks"
    masks.mkdir()
    of_color = []
    for k in range(len(POSES)):
        of_color.append(np.full((2 * HEIGHT, 2 * WIDTH), 255, np.uint8))
        of_color[k][:40] = of_color[k][:, 80 + 4 * k :] = 0
        cv2.imwrite(str(masks / f"{k}.png"), of_color[k])
    options = SourceOptions(mask=str(masks), stride=2)
    y = (np.arange(10, HEIGHT - 10) - DEPTH_K[1, 2]) / DEPTH_K[1, 1]
    x = (np.arange(10, WIDTH - 10) - DEPTH_K[0, 2]) / DEPTH_K[0, 0]
    row = np.rint(COLOR_K[1, 1] * y + COLOR_K[1, 2]).astype(int)
    column = np.rint(COLOR_K[0, 0] * x + COLOR_K[0, 2]).astype(int)
    frames = list(open_source(f"scannet:{folder}", options).frames())
    for k, frame in zip((0, 2, 4), frames, strict=True):
        assert isinstance(frame, Frame)
        is_open = of_color[k][np.ix_(row, column)] > 0
        assert 0 < is_open.mean() < 1
        np.testing.assert_array_equal(frame.depth_raw, images(k)[1][CROP] * is_open)
    cv2.imwrite(str(masks / "2.png"), of_color[2][1:])
    bad = list(open_source(f"scannet:{folder}", options).frames())[1]
    assert isinstance(bad, BadFrame) and "2.png: 160x119 pixels: expected 160x120" in bad.reason
    (masks / "2.png").unlink()
    with pytest.raises(UserError, match=r"1 of 3 images have no mask: expected .*masks/2\.png for"):
        open_source(f"scannet:{folder}", options)
    recording = Sens(poses=POSES).write(tmp_path / "scene.sens")
    with pytest.raises(UserError, match=r"scene\.sens has no image files: expected one mask"):
        open_source(f"scannet:{recording}", options)
