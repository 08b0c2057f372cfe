"""Frames without depth where a mask is black."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.kernels.cache_folder import cache_root
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import BadFrame

SYNTH = SynthOptions(width_px=96, height_px=72)


def _first(**options) -> Frame:
    (frame,) = open_source("synth:room", SourceOptions(frames=1, synth=SYNTH, **options)).frames()
    assert isinstance(frame, Frame)
    return frame


def _mask(path: Path, width_px: int = 96, channels: int = 1) -> str:
    """Black in the lower third."""
    image = np.full((72, width_px, channels), 255, np.uint8)
    image[48:] = 0
    cv2.imwrite(str(path), image)
    return str(path)


@pytest.mark.parametrize("noise", ["none", "kinect"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_black_pixels_have_no_depth_and_the_others_keep_theirs(tmp_path, noise, channels):
    plain = _first(noise=noise)
    masked = _first(noise=noise, mask=_mask(tmp_path / "mask.png", channels=channels))
    assert plain.depth_raw[48:].any() and not masked.depth_raw[48:].any()
    assert np.array_equal(plain.depth_raw[:48], masked.depth_raw[:48])
    assert np.array_equal(plain.color, masked.color)


def test_a_coloured_pixel_is_not_black(tmp_path):
    image = np.zeros((72, 96, 3), np.uint8)
    image[:, :, 0] = 1
    cv2.imwrite(str(tmp_path / "mask.png"), image)
    assert np.array_equal(_first(mask=str(tmp_path / "mask.png")).depth_raw, _first().depth_raw)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_labels_of_16_bit_are_not_black(tmp_path, channels):
    labels = np.ones((72, 96, channels), np.uint16)
    labels[48:, :, :3] = 0  # alpha stays
    cv2.imwrite(str(tmp_path / "mask.png"), labels)
    masked, plain = _first(mask=str(tmp_path / "mask.png")), _first()
    assert not masked.depth_raw[48:].any()
    assert np.array_equal(masked.depth_raw[:48], plain.depth_raw[:48])
    folder = _recording(tmp_path / "recorded")
    (folder / "mask").rename(folder / "of_8_bit")
    (folder / "mask").mkdir()
    for file in (folder / "of_8_bit").iterdir():
        label = (cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) > 0).astype(np.uint16)
        cv2.imwrite(str(folder / "mask" / file.name), label)
    every = [list(range(8 * n, 8 * (n + 1))) for n in range(4)]
    assert _hidden_columns(open_source(f"record:{folder}")) == every


def test_a_mask_has_the_size_of_the_frames_before_they_are_made_smaller(tmp_path):
    small = _first(mask=_mask(tmp_path / "mask.png"), downscale=2)
    assert small.depth_raw[:24].any() and not small.depth_raw[24:].any()


def test_a_mask_that_does_not_fit_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"--mask .*wide.png: 100x72 pixels: expected 96x72"):
        _first(mask=_mask(tmp_path / "wide.png", width_px=100))
    (tmp_path / "mask.txt").write_text("no image")
    for name, why in (("mask.txt", "not an image"), ("gone.png", "No such file")):
        with pytest.raises(UserError, match=f"--mask .*{name}: {why}"):
            _first(mask=str(tmp_path / name))
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros((72, 96), np.uint8))
    with pytest.raises(UserError, match=r"--mask .*black.png: hides 100.0% of the image: expected"):
        _first(mask=str(tmp_path / "black.png"))


def _recording(folder: Path, distortion: tuple[float, ...] = ()) -> Path:
    """Four frames with depth everywhere, and masks that hide column after column, of eight pixels each."""
    for name in ("color", "depth", "mask"):
        (folder / name).mkdir(parents=True)
    for n in range(4):
        mask = np.full((72, 96), 255, np.uint8)
        mask[:, 8 * n : 8 * (n + 1)] = 0
        images = np.full((72, 96, 3), 99, np.uint8), np.full((72, 96), 5000, np.uint16), mask
        for name, image in zip(("color", "depth", "mask"), images, strict=True):
            cv2.imwrite(str(folder / name / f"{n:03d}.png"), image)
    camera = {"fx": 80.0, "depth_scale": 5000.0, "distortion": list(distortion)}
    (folder / "camera.json").write_text(json.dumps(camera))
    return folder


def test_a_mask_may_lie_below_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache_root().parent))  # it has the kernels
    monkeypatch.setenv("HOME", str(tmp_path))
    _mask(tmp_path / "mask.png")
    assert not _first(mask="~/mask.png").depth_raw[48:].any()


def _hidden_columns(source) -> list[list[int]]:
    frames = list(source.frames())
    assert all(isinstance(frame, Frame) for frame in frames), frames
    return [np.flatnonzero((frame.depth_raw == 0).all(axis=0)).tolist() for frame in frames]


def test_each_frame_of_a_recording_has_its_own_mask(tmp_path):
    folder = _recording(tmp_path / "recording")
    every = [list(range(8 * n, 8 * (n + 1))) for n in range(4)]
    assert _hidden_columns(open_source(f"record:{folder}")) == every
    part = SourceOptions(start=1, stride=2)
    assert _hidden_columns(open_source(f"record:{folder}", part)) == every[1::2]
    moved = folder.with_name("people")
    (folder / "mask").rename(moved)
    assert _hidden_columns(open_source(f"record:{folder}")) == [[]] * 4
    named = SourceOptions(mask=str(moved))
    assert _hidden_columns(open_source(f"record:{folder}", named)) == every


def test_a_mask_of_a_frame_has_the_distortion_of_its_image(tmp_path):
    folder, k1 = _recording(tmp_path, (1.0, 0, 0, 0)), 1.0
    frame = list(open_source(f"record:{folder}").frames())[3]
    assert isinstance(frame, Frame)
    x = (np.arange(96) - 47.5) / 80.0  # the middle row of an image without distortion
    in_file = np.rint(47.5 + 80.0 * x * (1 + k1 * x**2))
    hidden = (in_file >= 24) & (in_file < 32)
    inside = (in_file >= 0) & (in_file < 96)
    np.testing.assert_array_equal((frame.depth_raw[36] == 0)[inside], hidden[inside])
    assert not hidden[24] and hidden[32]


def test_masks_of_frames_that_do_not_fit_are_told(tmp_path):
    folder = _recording(tmp_path / "recording")
    options = SourceOptions(frames=1, synth=SYNTH, mask=str(folder / "mask"))
    with pytest.raises(UserError, match=r"--mask .*mask: source synth:room has no image files"):
        open_source("synth:room", options)
    (folder / "mask" / "001.png").write_text("no image")
    frames = list(open_source(f"record:{folder}").frames())
    assert isinstance(frames[1], BadFrame) and "001.png" in frames[1].reason
    (folder / "mask" / "002.png").unlink()
    with pytest.raises(UserError, match=r"1 of 4 images have no mask: expected .*mask/002.png for"):
        open_source(f"record:{folder}")
