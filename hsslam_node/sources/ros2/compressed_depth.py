"""Decodes what image_transport's compressedDepth has beside PNG: RVL, and depth of floats as inverse depth.

Sources: ros-perception/image_transport_plugins, compressed_depth_image_transport, src/codec.cpp and
rvl_codec.cpp; A. D. Wilson, Fast Lossless Depth Image Compression, 2017.
"""

import struct

import numpy as np

from hsslam_node.sources.files.image_files import BadImageError

HEADER_BYTES = 12  # int32 format; float32 a and b of the inverse depth
_SIZE_BYTES = 8  # uint32 width and height of an RVL image, px


def rvl_size(data: np.ndarray) -> tuple[int, int]:
    """Width and height of a compressedDepth image in RVL, px, with its header, [N] uint8.

    Raises:
        BadImageError: it is too short.
    """
    start = data[HEADER_BYTES : HEADER_BYTES + _SIZE_BYTES].tobytes()
    if len(start) < _SIZE_BYTES:
        raise BadImageError(
            f"depth in RVL of {data.size} bytes: expected {HEADER_BYTES + _SIZE_BYTES} or more"
        )
    width_px, height_px = struct.unpack("<II", start)
    return width_px, height_px


def rvl_depth(data: np.ndarray, most_px: int) -> np.ndarray:
    """Depth [H, W] uint16 of a compressedDepth image in RVL with its header, [N] uint8.

    Raises:
        BadImageError: it has more than `most_px` pixels, or it is cut off or damaged.
    """
    from hsslam_node.sources.ros2.rvl_kernel import decode_rvl

    width_px, height_px = rvl_size(data)
    what, count = f"depth in RVL of {width_px}x{height_px} pixels", width_px * height_px
    if not 0 < count <= most_px:
        raise BadImageError(f"{what}: expected 1 to {most_px} pixels")
    words = data[HEADER_BYTES + _SIZE_BYTES :]
    depth = np.zeros(count, np.uint16)
    if not decode_rvl(np.frombuffer(words[: words.size // 4 * 4].tobytes(), "<u4"), depth):
        raise BadImageError(f"{what}: cut off or damaged")
    return depth.reshape(height_px, width_px)


def metres_of_inverse(inverse: np.ndarray, header: np.ndarray) -> np.ndarray:
    """Depth [H, W] float32, m, of inverse depth [H, W] uint16 and the header before it, [12] uint8; 0: not
    measured."""
    _, a, b = struct.unpack("<iff", header.tobytes())
    with np.errstate(divide="ignore", invalid="ignore"):
        metres = np.float32(a) / (inverse.astype(np.float32) - np.float32(b))
    return np.where(inverse > 0, metres, np.float32(0))
