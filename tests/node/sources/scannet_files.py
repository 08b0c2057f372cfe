"""ScanNet scenes written from the format's definition, without the reader's code."""

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 80, 60  # of depth; colour has twice that
COLOR_K = np.array([[140.0, 0, 81.0], [0, 141.0, 59.0], [0, 0, 1]])
DEPTH_K = np.array([[70.5, 0, 40.25], [0, 70.0, 29.5], [0, 0, 1]])
UNKNOWN = np.full((4, 4), -np.inf)


def pose(k: int) -> np.ndarray:
    """Camera to world of frame k."""
    T = np.eye(4)
    T[:3, 3] = 0.1 * k, 0.5, -0.25
    return T


def images(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour [2 H, 2 W, 3] RGB, smooth so that JPEG keeps it, and depth [H, W] in mm, of frame k."""
    v, u = np.mgrid[: 2 * HEIGHT, : 2 * WIDTH]
    color = np.stack([u, 2 * v, np.full_like(u, 20 * k)], axis=-1).astype(np.uint8)
    depth = (1000 + 10 * k + np.arange(WIDTH)[None] + np.arange(HEIGHT)[:, None]).astype(np.uint16)
    depth[0, :3] = 0
    return color, depth


@dataclass
class Sens:
    """The fields of a `.sens` file; change one and write it."""

    version: int = 4
    name: bytes = b"StructureSensor"
    color_kind: int = 2
    depth_kind: int = 1
    depth_size: tuple[int, int] = (WIDTH, HEIGHT)
    units: float = 1000.0
    count: int | None = None  # None: as many as there are frames
    poses: list[np.ndarray] = field(default_factory=lambda: [pose(k) for k in range(5)])
    jpegs: dict[int, bytes] = field(default_factory=dict)  # in place of the frame's own
    depths: dict[int, bytes] = field(default_factory=dict)

    def encoded(self) -> bytes:
        count = len(self.poses) if self.count is None else self.count
        out = [struct.pack("<I", self.version), struct.pack("<Q", len(self.name)), self.name]
        for K in (COLOR_K, None, DEPTH_K, None):
            matrix = np.eye(4)
            if K is not None:
                matrix[:3, :3] = K
            out.append(struct.pack("<16f", *matrix.ravel()))
        out.append(struct.pack("<ii", self.color_kind, self.depth_kind))
        out.append(struct.pack("<II", 2 * WIDTH, 2 * HEIGHT))
        out.append(struct.pack("<II", *self.depth_size))
        out.append(struct.pack("<fQ", self.units, count))
        for k, T in enumerate(self.poses):
            color, depth = images(k)
            jpeg = cv2.imencode(".jpg", color[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])[1]
            color_data = self.jpegs.get(k, jpeg.tobytes())
            depth_data = self.depths.get(k, zlib.compress(depth.astype("<u2").tobytes()))
            out.append(struct.pack("<16f", *T.ravel()))
            out.append(struct.pack("<QQ", 33_333 * k, 33_333 * k))
            out.append(struct.pack("<QQ", len(color_data), len(depth_data)))
            out += [color_data, depth_data]
        out.append(struct.pack("<Q", 0))  # inertial frames
        return b"".join(out)

    def write(self, path: Path) -> Path:
        path.write_bytes(self.encoded())
        return path


def write_export(folder: Path, poses: list[np.ndarray]) -> Path:
    """The same scene as the reference exporter leaves it."""
    for kind in ("color", "depth", "pose", "intrinsic"):
        (folder / kind).mkdir(parents=True)
    for k, T in enumerate(poses):
        color, depth = images(k)
        cv2.imwrite(
            str(folder / f"color/{k}.jpg"), color[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98]
        )
        cv2.imwrite(str(folder / f"depth/{k}.png"), depth)
        np.savetxt(folder / f"pose/{k}.txt", T, fmt="%f")
    for name, K in (("color", COLOR_K), ("depth", DEPTH_K)):
        matrix = np.eye(4)
        matrix[:3, :3] = K
        np.savetxt(folder / f"intrinsic/intrinsic_{name}.txt", matrix, fmt="%f")
    return folder
