"""Keyframes: pixels in preallocated slabs, poses in two banks that readers copy without a lock."""

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import ArrayAllocator

SLAB_KEYFRAMES = 8  # 12 MB at 640x480: the system clears it while the tracker waits, in 7 ms
_COUNT, _POSE_VERSION, _INHERITED = 0, 1, 2  # fields of the header
_FRAME_INDEX, _STAMP_NS = 0, 1  # columns of the meta rows


class KeyframeStore:
    """Append-only keyframes over named arrays.

    One writer per array: the tracker appends (pixels, meta, a pose row in both banks, then the
    count); only bundle adjustment rewrites poses, into the bank that is not current, then bumps the
    pose version.
    """

    def __init__(self, arrays: ArrayAllocator) -> None:
        """Attach to a store; KeyError where nobody has created it yet."""
        self._arrays = arrays
        self._header = arrays.open("keyframes")  # [16] int64
        self._meta = arrays.open("keyframe_meta")  # [capacity, 2] int64
        self._poses = arrays.open("keyframe_poses")  # [2, capacity, 4, 4] float64, T_world_cam
        width, height, fx, fy, cx, cy, units = arrays.open("keyframe_camera")
        if width == 0:  # the width is written last: its maker is still at it
            raise KeyError("keyframe_camera")
        self.camera = Camera(int(width), int(height), float(fx), float(fy), float(cx), float(cy))
        self.depth_units_per_m = float(units)
        self._slabs: list[tuple[np.ndarray, np.ndarray]] = []

    @classmethod
    def create(
        cls, arrays: ArrayAllocator, camera: Camera, depth_units_per_m: float, capacity: int
    ) -> "KeyframeStore":
        """Create the arrays, or attach to those that a former process of this run left."""
        arrays.create("keyframes", (16,), np.int64)
        arrays.create("keyframe_meta", (capacity, 2), np.int64)
        arrays.create("keyframe_poses", (2, capacity, 4, 4), np.float64)
        row = arrays.create("keyframe_camera", (7,), np.float64)
        row[1:] = camera.height_px, camera.fx, camera.fy, camera.cx, camera.cy, depth_units_per_m
        row[0] = camera.width_px  # last: it says that the row is complete
        return cls(arrays)

    @property
    def count(self) -> int:
        """Keyframes that are complete."""
        return int(self._header[_COUNT])

    @property
    def capacity(self) -> int:
        """Most keyframes that fit."""
        return len(self._meta)

    @property
    def pose_version(self) -> int:
        """Grows with every correction by bundle adjustment."""
        return int(self._header[_POSE_VERSION])

    @property
    def inherited(self) -> int:
        """Keyframes that come from a saved map: the first ones."""
        return int(self._header[_INHERITED])

    def mark_inherited(self) -> None:
        """Say that the keyframes of now come from a saved map."""
        self._header[_INHERITED] = self.count

    def append(self, frame: Frame, T_world_cam: np.ndarray) -> int:
        """Add a keyframe and return its id.

        Raises:
            UserError: the store is full, or the frame's camera or depth scale is not the store's.
        """
        k = self.count
        if k >= self.capacity:
            raise UserError(f"keyframes.capacity = {self.capacity}: the run needs more keyframes")
        self.expect_like(frame)
        color, depth_raw = self._slab(k // SLAB_KEYFRAMES, create=True)
        color[k % SLAB_KEYFRAMES] = frame.color
        depth_raw[k % SLAB_KEYFRAMES] = frame.depth_raw
        self._meta[k] = frame.index, frame.stamp_ns
        self._poses[:, k] = T_world_cam
        self._header[_COUNT] = k + 1
        return k

    def expect_like(self, frame: Frame) -> None:
        """UserError where the frame is not of the store's camera."""
        if frame.depth_units_per_m != self.depth_units_per_m:
            raise UserError(
                f"frame {frame.index}: depth_units_per_m = {frame.depth_units_per_m}: expected "
                f"{self.depth_units_per_m} as in the keyframes"
            )
        camera, own = frame.camera, self.camera
        if (camera.width_px, camera.height_px) != (own.width_px, own.height_px):
            raise UserError(
                f"frame {frame.index}: {camera.width_px} x {camera.height_px} px: expected "
                f"{own.width_px} x {own.height_px} as in the keyframes"
            )

    def pixels(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 and raw depth [H, W] uint16 of keyframe k, not copied."""
        color, depth_raw = self._slab(k // SLAB_KEYFRAMES, create=False)
        return color[k % SLAB_KEYFRAMES], depth_raw[k % SLAB_KEYFRAMES]

    def frame(self, k: int) -> Frame:
        """Keyframe k as a frame."""
        color, depth_raw = self.pixels(k)
        index, stamp_ns = map(int, self._meta[k])
        return Frame(index, stamp_ns, self.camera, color, depth_raw, self.depth_units_per_m)

    def frame_indices(self) -> np.ndarray:
        """Frame index of each keyframe, [n] int64."""
        return self._meta[: self.count, _FRAME_INDEX].copy()

    def stamps_ns(self) -> np.ndarray:
        """Sensor stamp of each keyframe, [n] int64 ns."""
        return self._meta[: self.count, _STAMP_NS].copy()

    def poses(self) -> np.ndarray:
        """T_world_cam of all keyframes, [n, 4, 4], a consistent copy."""
        while True:
            version = self.pose_version
            copy = self._poses[version % 2, : self.count].copy()
            if self.pose_version == version:
                return copy

    def pose(self, k: int) -> np.ndarray:
        """T_world_cam of keyframe k, [4, 4]."""
        while True:
            version = self.pose_version
            copy = self._poses[version % 2, k].copy()
            if self.pose_version == version:
                return copy

    def correct_poses(self, ids: np.ndarray, T_world_cam: np.ndarray) -> int:
        """Bundle adjustment only: replace the poses [n, 4, 4] of `ids`; returns the new version."""
        version = self.pose_version
        n = self.count
        bank, other = self._poses[version % 2], self._poses[(version + 1) % 2]
        other[:n] = bank[:n]
        other[ids] = T_world_cam
        self._header[_POSE_VERSION] = version + 1
        return version + 1

    def _slab(self, index: int, create: bool) -> tuple[np.ndarray, np.ndarray]:
        while len(self._slabs) <= index:
            k = len(self._slabs)
            size = (SLAB_KEYFRAMES, self.camera.height_px, self.camera.width_px)
            names = f"keyframe_color.{k:03d}", f"keyframe_depth.{k:03d}"
            if create:
                slab = (
                    self._arrays.create(names[0], (*size, 3), np.uint8),
                    self._arrays.create(names[1], size, np.uint16),
                )
            else:
                slab = self._arrays.open(names[0]), self._arrays.open(names[1])
            self._slabs.append(slab)
        return self._slabs[index]
