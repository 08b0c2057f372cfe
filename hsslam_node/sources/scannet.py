"""ScanNet scenes: exported frames, or a `.sens` recording read frame by frame."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import FAR_OFF_CENTRE, Camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.files.frame_masks import FrameMasks
from hsslam_node.sources.files.image_files import (
    BadImageError,
    DiskFailures,
    decode_color,
    read_any_color,
    read_any_depth,
    read_depth,
)
from hsslam_node.sources.files.image_pairs import numbered_rate_hz, without_image
from hsslam_node.sources.files.scannet_scene import (
    DEPTH_UNITS_PER_M,
    RATE_HZ,
    ScanNetFolder,
    ScanNetScene,
)
from hsslam_node.sources.files.truth_files import Truth, mesh_loader
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, IsLate, LateFrame, ReadsInTime

_CROP_PX = 10  # colour has a black border


class ScanNetSource(ReadsInTime):
    """A ScanNet scene. Depth is registered to colour; colour is resampled to the pixels of depth, and
    ten pixels are cropped on every side. Frame n is stamped n / 30 s.

    Raises:
        UserError: the scene or its calibration is missing or damaged.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        self._scene = ScanNetScene.find(name)
        stamps = self._scene.stamps_ns()
        self._rows = list(options.selected(len(stamps)))
        self._stamps_ns = [int(stamps[row]) for row in self._rows]
        if not self._rows:
            raise UserError(f"source scannet:{name}: no frames: expected 1 or more")
        self._whole, self.depth_units_per_m, K_color = _calibration(self._scene)
        self._K_color = K_color
        folder = self._scene.folder
        self.reads_masks = folder is not None
        color_files = [] if folder is None else [folder.files[row][1] for row in self._rows]
        self._masks = FrameMasks.found(options.mask, None, color_files)
        self.name = f"scannet:{name}"
        self.camera = _cropped(self._whole)
        recorded = stamps[list(options.recorded(len(stamps)))]
        self.rate_hz = numbered_rate_hz(recorded, RATE_HZ)
        self.frame_count: int | None = len(self._rows)

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """Every frame; an unreadable one is a `BadFrame`, a late one a `LateFrame`."""
        with ExitStack() as stack:
            read = self._reader(stack)
            for index in range(first, len(self._rows)):
                row, stamp_ns = self._rows[index], self._stamps_ns[index]
                if is_late(index, stamp_ns):
                    yield LateFrame(index, stamp_ns)
                    continue
                try:
                    color, depth = read(row)
                except BadImageError as error:
                    yield without_image(index, stamp_ns, error)
                    continue
                inner = np.s_[_CROP_PX:-_CROP_PX, _CROP_PX:-_CROP_PX]
                color = on_depth(color, self._K_color, self._whole)
                yield Frame(
                    index=index,
                    stamp_ns=stamp_ns,
                    camera=self.camera,
                    color=np.ascontiguousarray(color[inner]),
                    depth_raw=np.ascontiguousarray(depth[inner]),
                    depth_units_per_m=self.depth_units_per_m,
                )

    def _reader(self, stack: ExitStack) -> Callable[[int], tuple[np.ndarray, np.ndarray]]:
        """Maps the row of a frame to colour [H, W, 3] RGB, of any size, and depth [H, W]."""
        sens, folder = self._scene.sens, self._scene.folder
        if sens is not None:
            file = stack.enter_context(sens.path.open("rb"))

            def from_sens(row: int) -> tuple[np.ndarray, np.ndarray]:
                jpeg, depth = sens.images(file, row)
                return decode_color(jpeg, f"{sens.path}: colour of frame {row}"), depth

            return from_sens
        assert folder is not None

        def from_folder(row: int) -> tuple[np.ndarray, np.ndarray]:
            _, color_file, depth_file = folder.files[row]
            color, depth = read_any_color(color_file), read_depth(depth_file, self._whole)
            if self._masks is not None:
                height, width = color.shape[:2]
                of_color = _camera((width, height), self._K_color)
                hidden = self._masks.hidden(color_file, of_color)
                depth[hidden_on_depth(hidden, self._K_color, self._whole)] = 0
            return color, depth

        return from_folder


def on_depth(color: np.ndarray, K_color: np.ndarray, camera: Camera) -> np.ndarray:
    """The colour image [h, w, 3] as the camera of the depth sees it, [H, W, 3]; same centre and axes.

    First shrunk by area, so that every pixel counts, then moved by the rest (pixel centres at
    integers).
    """
    h, w = color.shape[:2]
    size = (camera.width_px, camera.height_px)
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    s_x, s_y = size[0] / w, size[1] / h
    fx, fy = K_color[0, 0] * s_x, K_color[1, 1] * s_y
    cx, cy = (K_color[0, 2] + 0.5) * s_x - 0.5, (K_color[1, 2] + 0.5) * s_y - 0.5
    K_small = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return _moved(small, K_small, camera, cv2.INTER_LINEAR)


def hidden_on_depth(hidden: np.ndarray, K_color: np.ndarray, camera: Camera) -> np.ndarray:
    """Mask [H, W] of the depth pixels whose nearest colour pixel is hidden by the mask [h, w] of colour."""
    return _moved(hidden.astype(np.uint8), K_color, camera, cv2.INTER_NEAREST) > 0


def _moved(image: np.ndarray, K: np.ndarray, camera: Camera, interpolation: int) -> np.ndarray:
    """An image of a camera with this K [3, 3] as `camera` sees it; same centre and axes."""
    a_x, a_y = K[0, 0] / camera.fx, K[1, 1] / camera.fy
    from_camera = np.array(
        [[a_x, 0, K[0, 2] - a_x * camera.cx], [0, a_y, K[1, 2] - a_y * camera.cy]]
    )
    return cv2.warpAffine(
        image,
        from_camera,
        (camera.width_px, camera.height_px),
        flags=interpolation | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )


def _calibration(scene: ScanNetScene) -> tuple[Camera, float, np.ndarray]:
    """The camera of the whole depth image, its units per metre, and K of colour [3, 3]."""
    if scene.sens is not None:
        K, units = scene.sens.K_depth, scene.sens.depth_units_per_m
        size, K_color = scene.sens.depth_size_px, scene.sens.K_color
    else:
        assert scene.folder is not None
        (K_color, K), units = scene.folder.intrinsics(), DEPTH_UNITS_PER_M
        size = _expect_resized_alike(scene.folder, K_color, K)
    if min(size) <= 2 * _CROP_PX:
        raise UserError(
            f"{scene.path}: depth of {size[0]}x{size[1]} pixels: expected larger images"
        )
    if not (np.isfinite(K_color).all() and K_color[0, 0] > 0 and K_color[1, 1] > 0):
        raise UserError(f"{scene.path}: K of colour {K_color.tolist()}: expected focal lengths > 0")
    return _camera(size, K), units, K_color


def _camera(size: tuple[int, int], K: np.ndarray) -> Camera:
    return Camera(*size, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))


def _cropped(camera: Camera) -> Camera:
    return Camera(
        camera.width_px - 2 * _CROP_PX,
        camera.height_px - 2 * _CROP_PX,
        camera.fx,
        camera.fy,
        camera.cx - _CROP_PX,
        camera.cy - _CROP_PX,
    )


def _expect_resized_alike(
    folder: ScanNetFolder, K_color: np.ndarray, K_depth: np.ndarray
) -> tuple[int, int]:
    """Width and height of depth; UserError if the images have another size than their intrinsics."""
    size = _size((depth for _, _, depth in folder.files), read_any_depth)
    if size is None:
        raise UserError(f"{folder.path}/depth: no image can be read: expected 0.png and so on")
    color_size = _size((color for _, color, _ in folder.files), read_any_color)
    for kind, images_px, K in (("color", color_size, K_color), ("depth", size, K_depth)):
        if images_px and max(map(abs, _camera(images_px, K).off_centre)) > FAR_OFF_CENTRE:
            width, height = images_px
            raise UserError(
                f"{folder.path}/intrinsic/intrinsic_{kind}.txt: cx = {K[0, 2]:g}, cy = {K[1, 2]:g}: expected "
                f"about {(width - 1) / 2:g} and {(height - 1) / 2:g}, the middle of the images in {kind}/, "
                f"{width}x{height} pixels"
            )
    return size


def _size(files: Iterable[Path], read: Callable[[Path], np.ndarray]) -> tuple[int, int] | None:
    """Width and height of the first image that can be read; None if there is none.

    Raises:
        UserError: the disk fails twice.
    """
    failures = DiskFailures()
    for file in files:
        try:
            height, width = read(file).shape[:2]
        except BadImageError as error:
            failures.take(error)
        else:
            return width, height
    return None


def scannet_truth(name: str, options: SourceOptions) -> Truth | None:
    """Poses and mesh, without frames of unknown pose (-inf in the scene); None if no pose is known. For
    the evaluator only.
    """
    scene = ScanNetScene.find(name)
    rows = np.array(options.selected(len(scene.numbers())), np.int64)
    poses = scene.T_world_cam()[rows]
    known = np.isfinite(poses).all(axis=(1, 2))
    if not known.any():
        return None
    return Trajectory(scene.stamps_ns()[rows][known], poses[known]), mesh_loader(scene.mesh_file)
