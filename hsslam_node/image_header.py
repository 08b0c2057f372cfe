"""Size of a PNG or JPEG from its first bytes, and whether it has its end: OpenCV has no such functions."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

LARGEST_PIXELS = 2**26  # 8192 x 8192: the limit for images of all sources
_PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # by colour type; palettes hold RGB
PNG_START, _PNG_END = _PNG[:4], b"IEND\xaeB`\x82"
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_TAIL_BYTES = 256  # some writers pad after the end marker
_SCAN = 0xDA
_STANDALONE = {0x01, *range(0xD0, 0xD9)}  # markers without a length
_NO_FRAME = {0xC4, 0xC8, 0xCC}  # of the range of frame headers: tables and extensions


@dataclass(frozen=True)
class ImageHeader:
    """What an image claims to be; decoding may still fail."""

    kind: Literal["png", "jpeg"]
    width_px: int
    height_px: int
    channels: int
    bits: int  # of a channel

    @property
    def pixels(self) -> int:
        return self.width_px * self.height_px


def image_header(data: bytes | memoryview) -> ImageHeader | None:
    """The header of a PNG or JPEG; None if these are the bytes of neither, or are cut short.

    Sources: PNG specification, third edition (W3C), 11.2.1; ITU-T T.81, B.1 and B.2.2.
    """
    if bytes(data[: len(_PNG)]) == _PNG:
        return _png_header(bytes(data[len(_PNG) : len(_PNG) + 10]))
    if bytes(data[:2]) == _JPEG:
        return _jpeg_header(data)
    return None


def _png_header(fields: bytes) -> ImageHeader | None:
    if len(fields) < 10:
        return None
    width, height, bits, kind = struct.unpack(">IIBB", fields)
    channels = _PNG_CHANNELS.get(kind)
    return None if channels is None else ImageHeader("png", width, height, channels, bits)


def has_end(data: bytes | memoryview) -> bool:
    """Whether a PNG or JPEG has its end marker; true for other formats."""
    tail = bytes(data[-_TAIL_BYTES:])
    if bytes(data[:4]) == PNG_START:
        return _PNG_END in tail
    return bytes(data[:2]) != _JPEG or _JPEG_END in tail or _ends_behind_scan(data)


def _ends_behind_scan(data: bytes | memoryview) -> bool:
    """Whether a JPEG has an end marker behind the beginning of its first scan, whatever follows.

    The end of a thumbnail in its header does not count. Coded pixels never hold the bytes of the marker.
    """
    scans = (at for marker, at in _jpeg_segments(data) if marker == _SCAN)
    at = next(scans, None)
    return at is not None and _JPEG_END in bytes(data[at:])


def _jpeg_header(data: bytes | memoryview) -> ImageHeader | None:
    for marker, at in _jpeg_segments(data):
        if 0xC0 <= marker <= 0xCF and marker not in _NO_FRAME:
            fields = bytes(data[at + 4 : at + 10])
            if len(fields) < 6:
                return None
            bits, height, width, channels = struct.unpack(">BHHB", fields)
            return ImageHeader("jpeg", width, height, channels, bits)
    return None


def _jpeg_segments(data: bytes | memoryview) -> Iterator[tuple[int, int]]:
    """Each marker with a length, up to the first scan, and its place in the file, byte."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
        elif marker in _STANDALONE:
            at += 2
        else:
            yield marker, at
            at += 2 + max(int.from_bytes(data[at + 2 : at + 4], "big"), 2)
