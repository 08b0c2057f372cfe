"""Sequences in TUM layout."""

import threading

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory, associate, parse_stamp_ns, write_tum
from hsslam_node.sources.files import image_files
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import BadFrame, UnreadFrame
from hsslam_node.sources.tum import TumFolder, TumSource, tum_truth
from tests.sequence_folders import frame_images, write_tum_camera


def frames_of(folder, **options) -> list:
    return list(TumSource(str(folder), SourceOptions(**options)).frames())


def test_frames_come_in_order_with_exact_stamps(tum_folder):
    frames = frames_of(tum_folder)
    assert [f.index for f in frames] == [0, 1, 2, 3, 4]
    assert frames[1].stamp_ns == 1305031100_033333000
    color, depth = frame_images(3)
    np.testing.assert_array_equal(frames[3].color, color)
    np.testing.assert_array_equal(frames[3].depth_raw, depth)
    assert frames[3].depth_m()[0, 0] == pytest.approx(1.006)


def test_rate_and_selection(tum_folder):
    source = TumSource(str(tum_folder), SourceOptions(stride=2))
    assert source.rate_hz == pytest.approx(15, rel=1e-3)
    assert source.frame_count == 3
    assert [f.color[0, 0, 0] for f in frames_of(tum_folder, stride=2)] == [0, 40, 80]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda folder: (folder / "depth/2.png").unlink(),
        lambda folder: (folder / "rgb/2.png").write_bytes(b"\x89PNG nothing else"),
        lambda folder: cv2.imwrite(str(folder / "depth/2.png"), np.ones((9, 9), np.uint16)),
    ],
)
def test_a_bad_file_is_one_bad_frame_and_the_rest_goes_on(tum_folder, spoil):
    spoil(tum_folder)
    frames = frames_of(tum_folder)
    assert [type(f) for f in frames] == [Frame, Frame, BadFrame, Frame, Frame]
    assert (frames[2].index, "2.png" in frames[2].reason) == (2, True)


@pytest.mark.parametrize("back_after_s", [0.1, 1e3])
def test_an_image_that_a_failing_disk_does_not_give_is_read_again(
    tum_folder, monkeypatch: pytest.MonkeyPatch, back_after_s: float
):
    monkeypatch.setattr(image_files, "_WAITS_S", (0.1, 0.2))
    image, away = tum_folder / "depth/2.png", tum_folder / "away.png"
    image.rename(away)
    image.symlink_to("/proc/self/mem")  # its first byte is an input/output error
    back = threading.Timer(back_after_s, away.replace, (image,))
    back.start()
    frames = frames_of(tum_folder)
    back.cancel()
    is_back = back_after_s < 1
    assert [type(f) for f in frames] == [
        Frame,
        Frame,
        Frame if is_back else UnreadFrame,
        Frame,
        Frame,
    ]
    assert is_back or frames[2].reason == f"{image}: Input/output error"


def test_a_list_that_a_failing_disk_does_not_give_says_why(tum_folder):
    (tum_folder / "rgb.txt").unlink()
    (tum_folder / "rgb.txt").symlink_to("/proc/self/mem")
    with pytest.raises(UserError, match=r"rgb\.txt: Input/output error: expected"):
        frames_of(tum_folder)


def test_pairs_further_than_20_ms_apart_are_left_out(tum_folder):
    lines = (tum_folder / "depth.txt").read_text().splitlines()
    stamp, file = lines[3].split()
    # 20.5 ms after its colour, 12.8 before the next
    lines[3] = f"{float(stamp) + 0.0155:.6f} {file}"
    (tum_folder / "depth.txt").write_text("\n".join(lines))
    assert len(frames_of(tum_folder)) == 4
    (report,) = reports_of(TumSource(str(tum_folder), SourceOptions())).take()
    assert "only 4 of 5 colour images have a time and one of 5 depth images" in report.text


def test_depth_that_ends_early_is_reported(tum_folder):
    assert reports_of(TumSource(str(tum_folder), SourceOptions())).take() == []
    lines = (tum_folder / "depth.txt").read_text().splitlines()
    (tum_folder / "depth.txt").write_text("\n".join(lines[:-2]))
    (report,) = reports_of(TumSource(str(tum_folder), SourceOptions())).take()
    assert "the last 2 of 5 colour images are left out: images of depth end earlier" in report.text


def test_association_is_one_to_one_and_takes_the_closest():
    a, b = np.array([0, 10, 20]), np.array([1, 9, 12, 300])
    assert associate(a, b, 20) == [(0, 0), (1, 1), (2, 2)]
    assert associate(a, b, 1) == [(0, 0), (1, 1)]


@pytest.mark.parametrize("name", ["rgb.txt", "depth.txt"])
def test_a_missing_or_wrong_list_is_named(tum_folder, name):
    (tum_folder / name).write_text("yesterday rgb/0.png\n")
    with pytest.raises(UserError, match=f"{name}:1"):
        frames_of(tum_folder)
    (tum_folder / name).write_text("# nothing\n")
    with pytest.raises(UserError, match=f"{name}: holds no image"):
        frames_of(tum_folder)
    (tum_folder / name).unlink()
    with pytest.raises(UserError, match=name):
        frames_of(tum_folder)


def test_the_published_cameras_go_by_the_folder_name(tmp_path):
    for number, fx in (("1", 517.306408), ("2", 520.908620), ("3", 535.4)):
        folder = tmp_path / f"rgbd_dataset_freiburg{number}_x"
        folder.mkdir()
        camera, scale = TumFolder(folder).camera()
        assert (camera.fx, scale) == (fx, 5000.0)
        assert bool(camera.distortion) == (number != "3")
    other = tmp_path / "kitchen"
    other.mkdir()
    with pytest.raises(UserError, match=r"camera\.json: missing"):
        TumFolder(other).camera()


def test_names_are_found_under_the_data_folder(tum_folder, monkeypatch):
    monkeypatch.setenv("HSSLAM_DATA", str(tum_folder.parent))
    target = tum_folder.parent / "rgbd_dataset_freiburg3_long_office_household"
    tum_folder.rename(target)
    assert TumFolder.find("fr3/office").path == target
    assert TumFolder.find(target.name).path == target


def test_a_distorted_camera_delivers_pinhole_frames(tum_folder):
    write_tum_camera(tum_folder, distortion=[0.2, -0.5, 0.0, 0.0, 0.4])
    source = TumSource(str(tum_folder), SourceOptions())
    assert source.camera.distortion == ()
    assert all(isinstance(f, Frame) for f in source.frames())


@pytest.mark.parametrize(("name", "units"), [("kitchen", 5000.0), ("livingroom", 1000.0)])
def test_real_sequences(test_data, name, units):
    source = TumSource(str(test_data / name), SourceOptions(frames=3))
    frames = list(source.frames())
    assert all(isinstance(f, Frame) for f in frames)
    assert source.depth_units_per_m == units
    assert source.rate_hz == pytest.approx(30, rel=1e-3)
    assert 0.5 < np.median(frames[0].depth_m()[frames[0].depth_raw > 0]) < 5


@pytest.mark.parametrize("stamp", ["-0.1", "1e30", "nan", "20240131123045123"])
def test_a_stamp_that_no_frame_can_have_is_named(tum_folder, stamp: str):
    path = tum_folder / "rgb.txt"
    path.write_text(f"{stamp} rgb/0.png\n" + path.read_text())
    with pytest.raises(
        UserError, match=rf"rgb.txt.*{stamp}.*: expected ('timestamp file'|times from 0)"
    ):
        TumSource(str(tum_folder), SourceOptions())


def test_depth_may_have_been_taken_before_0(tum_folder):
    path = tum_folder / "depth.txt"
    path.write_text("-0.004 depth/none.png\n" + path.read_text())
    assert len(frames_of(tum_folder)) > 0


def test_stamps_in_nanoseconds_are_those_in_seconds(tum_folder):
    before = [f.stamp_ns for f in TumSource(str(tum_folder), SourceOptions()).frames()]
    for name in ("rgb.txt", "depth.txt"):
        path, lines = tum_folder / name, []
        for line in path.read_text().splitlines():
            word, _, file = line.partition(" ")
            is_stamp = not line.startswith("#")
            lines.append(f"{10**18 + parse_stamp_ns(word)} {file}\n" if is_stamp else line + "\n")
        path.write_text("".join(lines))
    after = [f.stamp_ns for f in TumSource(str(tum_folder), SourceOptions()).frames()]
    assert after == [10**18 + stamp_ns for stamp_ns in before]


def test_poses_of_the_truth_may_stand_in_any_order(tum_folder):
    stamps = [f.stamp_ns for f in TumSource(str(tum_folder), SourceOptions()).frames()]
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    poses[:, 0, 3] = np.arange(len(stamps))
    order = np.random.default_rng(0).permutation(len(stamps))
    write_tum(tum_folder / "groundtruth.txt", Trajectory(np.array(stamps)[order], poses[order]))
    truth = tum_truth(str(tum_folder), SourceOptions())
    assert truth is not None
    np.testing.assert_array_equal(truth[0].stamps_ns, stamps)
    np.testing.assert_allclose(truth[0].T_world_cam, poses, atol=1e-8)
