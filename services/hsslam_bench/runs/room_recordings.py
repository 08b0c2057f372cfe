"""Writes the built-in room as TUM folders: of a pinhole camera, and through a lens of 8 coefficients."""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import format_stamp, write_tum
from hsslam_node.sources.files.undistortion import resampled_depth
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import Frame

SPEC = "synth:room"
# of the rational model, as for the colour camera of an Azure Kinect
LENS = (0.45, -2.6, 4e-4, -3e-4, 1.5, 0.33, -2.4, 1.42)
_FINER = 2  # scale of the images rendered for the lens
_FAST_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def write_recorded_room(folder: Path) -> None:
    """Write all frames lossless, so that a run of the recording renders nothing."""
    first = next(iter(_rendered(1, 1)))
    _begin(folder, first.camera, first.depth_units_per_m, ())
    stamps_ns: list[int] = []
    for frame in _rendered(None, 1):
        stamps_ns.append(frame.stamp_ns)
        _write(folder, frame.stamp_ns, frame.color, frame.depth_raw)
    _finish(folder, stamps_ns)


def write_distorted_room(folder: Path, frames: int) -> None:
    """Write `plain` and `lens` below a folder; both have the same K, size, stamps and truth."""
    coarse, fine = (_rendered(frames, scale) for scale in (1, _FINER))
    first = next(iter(_rendered(1, 1)))
    camera, units_per_m = first.camera, first.depth_units_per_m
    for name, lens in (("plain", ()), ("lens", LENS)):
        _begin(folder / name, camera, units_per_m, lens)
    lens_view = _LensView(camera, next(iter(_rendered(1, _FINER))).camera)
    stamps_ns: list[int] = []
    for plain, large in zip(coarse, fine, strict=True):
        stamps_ns.append(plain.stamp_ns)
        _write(folder / "plain", plain.stamp_ns, plain.color, plain.depth_raw)
        _write(folder / "lens", plain.stamp_ns, *lens_view.of(large))
    for name in ("plain", "lens"):
        _finish(folder / name, stamps_ns)


def _finish(folder: Path, stamps_ns: list[int]) -> None:
    """Write the lists of images, then the ground truth."""
    for kind in ("rgb", "depth"):
        lines = [f"{format_stamp(s)} {kind}/{format_stamp(s)}.png\n" for s in stamps_ns]
        (folder / f"{kind}.txt").write_text("".join(lines))
    truth = open_ground_truth(SPEC, _options(len(stamps_ns), 1))
    assert truth is not None
    write_tum(folder / "groundtruth.txt", truth.trajectory)


def _options(frames: int | None, scale: int) -> SourceOptions:
    size = SynthOptions()
    larger = SynthOptions(width_px=scale * size.width_px, height_px=scale * size.height_px)
    return SourceOptions(frames=frames, synth=larger)


def _rendered(frames: int | None, scale: int) -> Iterator[Frame]:
    source = open_source(SPEC, _options(frames, scale))
    return (frame for frame in source.frames() if isinstance(frame, Frame))


class _LensView:
    """Resamples images of a finer pinhole camera to images through the lens."""

    def __init__(self, camera: Camera, fine: Camera) -> None:
        pixels = (
            np.indices((camera.height_px, camera.width_px))[::-1].reshape(2, -1).T.astype(float)
        )
        rays = cv2.undistortPoints(pixels[:, None], camera.K, np.array(LENS)).reshape(-1, 2)
        seen = rays * [fine.fx, fine.fy] + [fine.cx, fine.cy]  # [H * W, 2]
        x, y = np.moveaxis(seen.reshape(camera.height_px, camera.width_px, 2), 2, 0).astype(
            np.float32
        )
        self._maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
        self._nearest, _ = cv2.convertMaps(x, y, cv2.CV_16SC2, nninterpolation=True)

    def of(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 and depth [H, W] uint16."""
        smooth = cv2.GaussianBlur(frame.color, (3, 3), 0.6)  # a pixel of the lens covers several
        color = cv2.remap(smooth, self._maps[0], self._maps[1], cv2.INTER_CUBIC)
        return color, resampled_depth(frame.depth_raw, self._maps, self._nearest)


def _begin(folder: Path, camera: Camera, units_per_m: float, lens: tuple[float, ...]) -> None:
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    about = {
        "width": camera.width_px,
        "height": camera.height_px,
        **{name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")},
        "distortion": lens,
        "depth_scale": units_per_m,
    }
    (folder / "camera.json").write_text(json.dumps(about))


def _write(folder: Path, stamp_ns: int, color: np.ndarray, depth: np.ndarray) -> None:
    name = f"{format_stamp(stamp_ns)}.png"
    cv2.imwrite(str(folder / "rgb" / name), cv2.cvtColor(color, cv2.COLOR_RGB2BGR), _FAST_PNG)
    cv2.imwrite(str(folder / "depth" / name), depth, _FAST_PNG)
