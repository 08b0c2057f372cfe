"""PNG images of cameras and logs, read in 0.4 to 0.8 of the time of OpenCV's reader."""

import struct
from collections.abc import Iterator

import numpy as np
from isal import igzip_lib, isal_zlib

from hsslam_node.png.unfilter import unfilter

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_BYTES = {(8, 2): 3, (16, 0): 2}  # of a pixel, by bits and colour type
# chunks that do not change pixels as they are stored; others do, as transparency, or are not known
_OF_NO_EFFECT = {
    *(b"tEXt", b"zTXt", b"iTXt", b"tIME", b"pHYs", b"gAMA", b"cHRM", b"sRGB", b"sBIT", b"eXIf"),
}


def decode_png(data: bytes | memoryview | np.ndarray) -> np.ndarray | None:
    """RGB [H, W, 3] uint8 or grey [H, W] uint16 of a PNG.

    None: it has other pixels, is interlaced or damaged, or has chunks that change its pixels. OpenCV's reader
    decides about those.

    Source: PNG specification, third edition (W3C), sections 5, 9 and 11.
    """
    packed = np.frombuffer(data, np.uint8).data
    if packed[:8] != _SIGNATURE or packed[12:16] != b"IHDR" or len(packed) < 33:
        return None
    width, height, bits, color_type, *others = struct.unpack(">IIBBBBB", packed[16:29])
    step = _BYTES.get((bits, color_type))
    if step is None or others != [0, 0, 0] or not (width and height):
        return None
    pixels = _pixel_data(packed)
    rows = None if pixels is None else _inflated(pixels, (height, 1 + step * width))
    out = np.empty((height, step * width), np.uint8)
    if rows is None or not unfilter(rows, step, out):
        return None
    return out.reshape(height, width, 3) if step == 3 else out.view(">u2").astype(np.uint16)


def _pixel_data(packed: memoryview) -> bytes | None:
    """What all chunks of pixels hold; None if a chunk is damaged or may change the pixels."""
    parts = []
    for kind, content, is_whole in _chunks(packed):
        if not is_whole:
            return None
        if kind == b"IDAT":
            parts.append(content)
        elif kind == b"IEND":
            return b"".join(parts)
        elif kind != b"IHDR" and kind not in _OF_NO_EFFECT:
            return None
    return None


def _chunks(packed: memoryview) -> Iterator[tuple[bytes, memoryview, bool]]:
    """Kind and content of each chunk, and whether its checksum is right."""
    at = len(_SIGNATURE)
    while at + 12 <= len(packed):
        (length,) = struct.unpack(">I", packed[at : at + 4])
        end = at + 8 + length
        checksum = isal_zlib.crc32(packed[at + 4 : end]).to_bytes(4, "big")
        yield (
            bytes(packed[at + 4 : at + 8]),
            packed[at + 8 : end],
            packed[end : end + 4] == checksum,
        )
        at = end + 4


def _inflated(pixels: bytes, shape: tuple[int, int]) -> np.ndarray | None:
    """Rows [H, 1 + N] uint8; None if it is not as much as that. Never takes more memory than these."""
    size = shape[0] * shape[1]
    inflate = isal_zlib.decompressobj()
    try:
        raw = inflate.decompress(pixels, size + 1)
    except igzip_lib.IsalError:  # type: ignore[misc]
        return None
    is_all = inflate.eof and len(raw) == size
    return np.frombuffer(raw, np.uint8).reshape(shape) if is_all else None
