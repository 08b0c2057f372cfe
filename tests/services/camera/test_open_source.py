"""What is refused when a source is opened, or before a live camera is waited for."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import SourceOptions
from hsslam_proto.frame_codec import LARGEST_IMAGE_PX
from hsslam_services.camera.open_source import check_source_exists, open_any_source
from hsslam_services.run.options import ServeOptions

_CAMERA = CameraOptions(fx=900.0, fy=900.0, cx=450.0, cy=30.0, depth_scale=1000.0)


def _record(folder: Path, width_px: int, height_px: int) -> str:
    for name, kind in (("color", (3,)), ("depth", ())):
        (folder / name).mkdir()
        pixels = np.zeros((height_px, width_px, *kind), np.uint8 if kind else np.uint16)
        assert cv2.imwrite(str(folder / name / "1.000000.png"), pixels)
    return f"record:{folder}"


@pytest.mark.parametrize(
    ("width_px", "height_px"), [(8193, 8), (4096, LARGEST_IMAGE_PX // 4096 + 1)]
)
def test_images_that_are_too_large_are_named(width_px, height_px, tmp_path: Path):
    size = f"images of {width_px}x{height_px} pixels: expected at most 8192 a side and 13.4 million"
    with pytest.raises(UserError, match=size):
        open_any_source(_record(tmp_path, width_px, height_px), SourceOptions(camera=_CAMERA))


def test_images_that_are_too_small_to_track_are_named(tmp_path: Path):
    with pytest.raises(UserError, match="images of 8x7 pixels: expected at least 8 a side"):
        open_any_source(_record(tmp_path, 8, 7), SourceOptions(camera=_CAMERA))


def test_a_wide_image_that_fits_is_opened(tmp_path: Path):
    source = open_any_source(_record(tmp_path, 8192, 8), SourceOptions(camera=_CAMERA))
    assert source.camera.width_px == 8192


@pytest.mark.parametrize("kind", ["missing", "folder"])
def test_a_mask_of_a_live_camera_is_a_file(kind: str, tmp_path: Path):
    mask = str(tmp_path if kind == "folder" else tmp_path / "gone.png")
    with pytest.raises(UserError, match=f"--mask {mask}: no such file: expected an image"):
        check_source_exists(ServeOptions("ros2:/camera", mask=mask))
