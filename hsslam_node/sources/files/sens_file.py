"""ScanNet's `.sens` recordings (version 4): a header, then every frame with its pose, compressed.

Little endian, without padding. Header: uint32 version; uint64 length and the sensor's name; four 4x4 float32
matrices, row-major: intrinsic and extrinsic of colour, of depth; int32 compression of colour (2: JPEG) and of
depth (1: zlib of uint16); uint32 width and height of colour, of depth; float32 depth units per metre; uint64
number of frames. Frame: 4x4 float32 camera to world (-inf: not known); uint64 stamps of colour and depth, us;
uint64 sizes of the two images; the images. What follows the frames (inertial data) is not read.

Source: the format's reference reader, github.com/ScanNet/ScanNet, SensReader.
"""

import os
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.sources.files.image_files import BadImageError, read_with_patience

_VERSION = 4
_JPEG, _ZLIB_USHORT = 2, 1
_MATRICES = 4 * 64
_SIZES = struct.Struct("<iiIIIIfQ")
_FRAME = struct.Struct("<16f4Q")
_LONGEST_NAME, _LARGEST_SIDE_PX = 4096, 16384


@dataclass(frozen=True)
class SensFrame:
    """Place of a frame's images in the file: colour, then depth."""

    offset: int  # bytes
    color_bytes: int
    depth_bytes: int


@dataclass(frozen=True)
class SensFile:
    """Header and index of a recording; images are read one frame at a time."""

    path: Path
    K_color: np.ndarray  # [3, 3]
    K_depth: np.ndarray  # [3, 3]
    color_size_px: tuple[int, int]  # width, height
    depth_size_px: tuple[int, int]
    depth_units_per_m: float
    frames: tuple[SensFrame, ...]
    T_world_cam: np.ndarray  # [N, 4, 4] float64; not finite if it is not known

    @classmethod
    def open(cls, path: Path) -> "SensFile":
        """Read the header and walk over the frames, without their images.

        Raises:
            UserError: not such a file, another version or compression, or cut short.
        """
        try:
            with path.open("rb") as file:
                return _read(path, file, os.fstat(file.fileno()).st_size)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}: expected a .sens file") from None

    def images(self, file: BinaryIO, index: int) -> tuple[bytes, np.ndarray]:
        """The JPEG of a frame and its depth, [H, W] uint16, from the open file.

        Raises:
            BadImageError: the depth cannot be decompressed, or the file was cut short meanwhile;
                UnreadImageError if the disk or its network fails.
        """
        frame = self.frames[index]

        def read() -> bytes:
            file.seek(frame.offset)
            return file.read(frame.color_bytes + frame.depth_bytes)

        data = read_with_patience(read, f"{self.path}: frame {index}")
        width, height = self.depth_size_px
        try:
            raw = _decompressed(data[frame.color_bytes :], 2 * width * height)
        except zlib.error as error:
            raise BadImageError(f"{self.path}: depth of frame {index}: {error}") from None
        if len(raw) != 2 * width * height:
            raise BadImageError(
                f"{self.path}: depth of frame {index}: {len(raw)} bytes: expected {width}x{height} "
                "pixels of 2 bytes"
            )
        depth = np.frombuffer(raw, "<u2").reshape(height, width)
        return data[: frame.color_bytes], depth.astype(np.uint16)


def _read(path: Path, file: BinaryIO, size: int) -> SensFile:
    (version,) = struct.unpack("<I", _take(path, file, 4, "header"))
    if version != _VERSION:
        raise UserError(f"{path}: version {version}: expected a .sens file of version {_VERSION}")
    (length,) = struct.unpack("<Q", _take(path, file, 8, "header"))
    if length > _LONGEST_NAME:
        raise UserError(f"{path}: a sensor's name of {length} bytes: expected a .sens file")
    _take(path, file, length, "header")
    matrices = np.frombuffer(_take(path, file, _MATRICES, "header"), "<f4").reshape(4, 4, 4)
    fields = _SIZES.unpack(_take(path, file, _SIZES.size, "header"))
    color_kind, depth_kind, color_w, color_h, depth_w, depth_h, units, count = fields
    if (color_kind, depth_kind) != (_JPEG, _ZLIB_USHORT):
        raise UserError(
            f"{path}: compression {color_kind} of colour and {depth_kind} of depth: expected "
            f"{_JPEG} (JPEG) and {_ZLIB_USHORT} (zlib)"
        )
    if not all(0 < side <= _LARGEST_SIDE_PX for side in (color_w, color_h, depth_w, depth_h)):
        sides = f"{color_w}x{color_h} and {depth_w}x{depth_h}"
        raise UserError(f"{path}: images of {sides} pixels: expected a .sens file")
    if not (np.isfinite(units) and units > 0):
        raise UserError(f"{path}: {units:g} depth units per metre: expected a number above 0")
    frames, poses = _walk(path, file, count, size)
    return SensFile(
        path=path,
        K_color=matrices[0, :3, :3].astype(np.float64),
        K_depth=matrices[2, :3, :3].astype(np.float64),
        color_size_px=(color_w, color_h),
        depth_size_px=(depth_w, depth_h),
        depth_units_per_m=float(units),
        frames=frames,
        T_world_cam=poses,
    )


def _walk(
    path: Path, file: BinaryIO, count: int, size: int
) -> tuple[tuple[SensFrame, ...], np.ndarray]:
    """Where the images of all frames are, and their poses [N, 4, 4]."""
    if count * _FRAME.size > size:
        raise UserError(f"{path}: {size} bytes for {count} frames: the file is cut short")
    frames, poses = [], np.empty((count, 16), np.float64)
    for index in range(count):
        what = f"frame {index} of {count}"
        *pose, _, _, color_bytes, depth_bytes = _FRAME.unpack(_take(path, file, _FRAME.size, what))
        offset = file.tell()
        end = offset + color_bytes + depth_bytes
        if end > size:
            raise _cut_short(path, what)
        poses[index] = pose
        frames.append(SensFrame(offset, color_bytes, depth_bytes))
        file.seek(end)
    return tuple(frames), poses.reshape(-1, 4, 4)


def _take(path: Path, file: BinaryIO, count: int, what: str) -> bytes:
    data = file.read(count)
    if len(data) < count:
        raise _cut_short(path, what)
    return data


def _cut_short(path: Path, what: str) -> UserError:
    return UserError(
        f"{path}: the file ends in {what}: expected a whole .sens file; fetch it again"
    )


def _decompressed(data: bytes, most: int) -> bytes:
    """At most one byte more than expected: a damaged stream must not fill the memory."""
    return zlib.decompressobj().decompress(data, most + 1)
