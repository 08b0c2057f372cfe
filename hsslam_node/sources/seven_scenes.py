"""Sequences of 7-Scenes: `frame-000000.color.png`, `.depth.png` and `.pose.txt` in one folder."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.download.data_folder import possible_places
from hsslam_node.sources.files.camera_file import read_record_camera
from hsslam_node.sources.files.image_pairs import ImagePair, ImagePairSource, first_size_px
from hsslam_node.sources.files.name_stamp import numbered_stamp_ns
from hsslam_node.sources.files.truth_files import Truth, read_matrix
from hsslam_node.sources.options.source import SourceOptions

RATE_HZ = 30.0  # of a Kinect v1; the layout has no stamps
_SIZE_PX = (640, 480)
# Of the depth camera, from the data set's page: those of KinectFusion, which made the poses.
_DEPTH_CAMERA = {"fx": 585.0, "fy": 585.0, "cx": 320.0, "cy": 240.0, "depth_scale": 1000.0}


class SevenScenesSource(ImagePairSource):
    """A sequence folder such as `redkitchen/seq-01`; frame n is stamped n / 30 s.

    Depth keeps its own pixels and intrinsics. The published colour images are not registered to it, and the
    data set has no calibration to do so: shape and poses are right, colour is off by some pixels. For
    registered images, a `camera.json` in the folder or `--camera` replaces the intrinsics; images of another
    size than the published ones need one of the two.

    Raises:
        UserError: the folder or its images are missing, or the camera is wrong.
    """

    numbered_hz = RATE_HZ

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = _find(name)
        own = folder / "camera.json"
        given = options.camera.given()
        pairs = _pairs(folder)
        size = _size_px(f"7scenes:{name}", pairs)
        is_published = size == _SIZE_PX and not own.exists()
        fields = _DEPTH_CAMERA | given if is_published else given
        camera, units_per_m = read_record_camera(own, fields, size)
        super().__init__(f"7scenes:{name}", pairs, camera, units_per_m, options)


def seven_scenes_truth(name: str, options: SourceOptions) -> Truth | None:
    """Poses of the depth camera by KinectFusion; None if no frame has one. For the evaluator only."""
    folder = _find(name)
    pairs = _pairs(folder)
    stamps, poses = [], []
    for row in options.selected(len(pairs)):
        stamp_ns, color_file, _ = pairs[row]
        path = folder / color_file.name.replace(".color.png", ".pose.txt")
        if path.exists() and np.isfinite(pose := read_matrix(path)).all():
            stamps.append(stamp_ns)
            poses.append(pose)
    return (Trajectory(np.array(stamps, np.int64), np.stack(poses)), None) if poses else None


def _find(name: str) -> Path:
    for path in possible_places(name):
        if path.is_dir():
            return path
    raise UserError(
        f"source 7scenes:{name}: no such folder here or in $HSSLAM_DATA: expected a sequence such "
        "as redkitchen/seq-01"
    )


def _size_px(name: str, pairs: Sequence[ImagePair]) -> tuple[int, int]:
    """Width and height of the first pair that can be used; those of the data set if there is none."""
    try:
        return first_size_px(name, pairs)
    except UserError:
        return _SIZE_PX


def _pairs(folder: Path) -> list[ImagePair]:
    """Stamp, colour file and depth file of every number with at least one of them."""
    names = (re.fullmatch(r"frame-(\d+)\.(?:color|depth)\.png", f.name) for f in folder.iterdir())
    digits = sorted({found[1] for found in names if found}, key=int)
    if not digits:
        raise UserError(
            f"{folder}: no frames: expected frame-000000.color.png and frame-000000.depth.png, as in the "
            "folder seq-01 of a scene"
        )
    return [
        (
            numbered_stamp_ns(int(number), RATE_HZ),
            folder / f"frame-{number}.color.png",
            folder / f"frame-{number}.depth.png",
        )
        for number in digits
    ]
