"""PNG images of cameras and logs, read in 0.3 to 0.8 of the time of OpenCV's reader."""

from collections.abc import Iterator

import numpy as np
from isal import igzip_lib, isal_zlib

from hsslam_node.image_header import LARGEST_PIXELS, image_header
from hsslam_node.png.unfilter import unfilter

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_BYTES = {(3, 8): 3, (1, 16): 2}  # of a pixel, by channels and their bits
_PLAIN = bytes(3)  # deflate, standard filters, not interlaced
# chunks that do not change the stored pixels; all others may, as palettes do
_OF_NO_EFFECT = frozenset(b"tEXt zTXt iTXt tIME pHYs gAMA cHRM sRGB sBIT eXIf".split())


def decode_png(data: bytes | memoryview | np.ndarray) -> np.ndarray | None:
    """RGB [H, W, 3] uint8 or grey [H, W] uint16 of a PNG.

    None: it has other pixels, is interlaced or damaged, or has chunks that may change its pixels. OpenCV's
    reader handles these.

    Source: PNG specification, third edition (W3C), sections 5, 9 and 11.
    """
    packed = np.frombuffer(data, np.uint8).data
    header = image_header(packed) if packed[:8] == _SIGNATURE else None
    if header is None or not 0 < header.pixels <= LARGEST_PIXELS or packed[26:29] != _PLAIN:
        return None
    height, width = header.height_px, header.width_px
    step = _BYTES.get((header.channels, header.bits))
    if step is None or (pixels := _pixel_data(packed)) is None:
        return None
    rows = _inflated(pixels, (height, 1 + step * width))
    if rows is None:
        return None
    out = np.empty((height, step * width), np.uint8)
    if not unfilter(rows, step, out):
        return None
    return out.reshape(height, width, 3) if step == 3 else out.view(">u2").astype(np.uint16)


def _pixel_data(packed: memoryview) -> bytes | None:
    """The content of all IDAT chunks; None if a chunk is damaged or may change the pixels."""
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
        end = at + 8 + int.from_bytes(packed[at : at + 4], "big")
        checksum = isal_zlib.crc32(packed[at + 4 : end]).to_bytes(4, "big")
        yield (
            bytes(packed[at + 4 : at + 8]),
            packed[at + 8 : end],
            packed[end : end + 4] == checksum,
        )
        at = end + 4


def _inflated(pixels: bytes, shape: tuple[int, int]) -> np.ndarray | None:
    """Rows [H, 1 + N] uint8; None if the data has another size. Allocates one byte more at most."""
    size = shape[0] * shape[1]
    inflate = isal_zlib.decompressobj()
    try:
        raw = inflate.decompress(pixels, size + 1)
    except igzip_lib.IsalError:  # type: ignore[misc]
        return None
    is_all = inflate.eof and len(raw) == size
    return np.frombuffer(raw, np.uint8).reshape(shape) if is_all else None
