"""Compressed images of keyframes, as a saved map keeps them."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.image_decoding import decoded_as_stored, decoded_rgb
from hsslam_node.image_header import LARGEST_PIXELS, image_header
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.png.encode import encode_png

_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]


@dataclass(frozen=True)
class KeyframeImages:
    """Colour as JPEG (quality 95) and depth as 16-bit PNG of n keyframes, concatenated.

    Raises:
        ValueError: the arrays do not fit together.
    """

    color: np.ndarray  # [bytes] uint8
    color_end: np.ndarray  # [n] int64: where each JPEG ends
    depth: np.ndarray  # [bytes] uint8
    depth_end: np.ndarray  # [n] int64
    depth_units_per_m: float

    def __post_init__(self) -> None:
        if len(self.color_end) != len(self.depth_end):
            raise ValueError(f"{len(self.color_end)} JPEGs, {len(self.depth_end)} PNGs")
        for name in ("color", "depth"):
            data, end = getattr(self, name), getattr(self, f"{name}_end")
            if data.dtype != np.uint8 or end.dtype != np.int64 or data.ndim != 1 or end.ndim != 1:
                raise ValueError(f"{name} is {data.dtype}, {end.dtype}, not uint8 and int64")
            edges = [0, *end.tolist()]
            if edges != sorted(edges) or edges[-1] != len(data):
                raise ValueError(f"images of {name} do not fill its {len(data)} bytes")
        if not (np.isfinite(self.depth_units_per_m) and self.depth_units_per_m > 0):
            raise ValueError(f"depth_units_per_m = {self.depth_units_per_m}, not above 0")

    def __len__(self) -> int:
        return len(self.color_end)

    @classmethod
    def of(cls, store: KeyframeStore) -> tuple[np.ndarray, "KeyframeImages"]:
        """Ids [n] int64 of the kept keyframes, and their images, about 5 ms and 450 kB each at 640 x 480.

        Keyframes that are retired meanwhile are left out.
        """
        ids, colors, depths = [], [], []
        for k in store.kept():
            try:
                frame = store.frame(int(k))
            except RetiredKeyframeError:
                continue
            bgr = cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR)
            colors.append(cv2.imencode(".jpg", bgr, _JPEG)[1])
            depths.append(np.frombuffer(encode_png(frame.depth_raw), np.uint8))
            ids.append(k)
        images = cls(*_joined(colors), *_joined(depths), store.depth_units_per_m)
        return np.array(ids, np.int64), images

    def rolled(self, first: int) -> "KeyframeImages":
        """The images from keyframe `first` on, then those before it."""
        color, depth = (
            _rolled(data, end, first)
            for data, end in ((self.color, self.color_end), (self.depth, self.depth_end))
        )
        return KeyframeImages(*color, *depth, self.depth_units_per_m)

    def pixels(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 RGB and raw depth [H, W] uint16 of keyframe k.

        Raises:
            ValueError: they cannot be decoded.
        """
        color, depth = self.color_rgb(k), self.depth_raw(k)
        if depth.shape != color.shape[:2]:
            raise ValueError(
                f"keyframe {k}: depth is {list(depth.shape)}, colour {list(color.shape)}"
            )
        return color, depth

    def color_rgb(self, k: int) -> np.ndarray:
        """Colour [H, W, 3] uint8 RGB of keyframe k alone.

        Raises:
            ValueError: it cannot be decoded.
        """
        packed = _expect_header(_packed(self.color, self.color_end, k), k)
        return _expect_decoded(decoded_rgb(packed), k)

    def color_jpeg(self, k: int) -> bytes:
        """Colour of keyframe k as it is kept, a JPEG."""
        return _packed(self.color, self.color_end, k).tobytes()

    def depth_raw(self, k: int) -> np.ndarray:
        """Raw depth [H, W] uint16 of keyframe k alone.

        Raises:
            ValueError: it cannot be decoded.
        """
        packed = _expect_header(_packed(self.depth, self.depth_end, k), k)
        depth = _expect_decoded(decoded_as_stored(packed), k)
        if depth.dtype != np.uint16 or depth.ndim != 2:
            raise ValueError(f"keyframe {k}: depth is {depth.dtype}{list(depth.shape)}")
        return depth


def _joined(images: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    parts = [np.asarray(image, np.uint8).ravel() for image in images]
    end = np.cumsum([len(part) for part in parts], dtype=np.int64)
    return np.concatenate([np.zeros(0, np.uint8), *parts]), end


def _rolled(data: np.ndarray, end: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
    start = int(end[first - 1]) if first else 0
    ends = [end[first:] - start, end[:first] + len(data) - start]
    return np.roll(data, -start), np.concatenate(ends)


def _packed(data: np.ndarray, end: np.ndarray, k: int) -> np.ndarray:
    return data[int(end[k - 1]) if k else 0 : int(end[k])]


def _expect_header(packed: np.ndarray, k: int) -> np.ndarray:
    header = image_header(packed.data)
    if header is None or not 0 < header.pixels <= LARGEST_PIXELS:
        raise ValueError(f"keyframe {k}: expected a PNG or JPEG of at most {LARGEST_PIXELS} pixels")
    return packed


def _expect_decoded(image: np.ndarray | None, k: int) -> np.ndarray:
    if image is None:
        raise ValueError(f"keyframe {k}: its image cannot be decoded")
    return image
