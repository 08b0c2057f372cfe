"""Images that claim more than they are."""

import struct
import zlib


def png_that_claims(width_px: int, height_px: int, bits: int = 1, color_type: int = 0) -> bytes:
    """A whole PNG of black pixels; of 16384 x 16384 of one bit it has 33 kB."""
    packer = zlib.compressobj(9)
    row = bytes(1 + -(-width_px * bits * (3 if color_type == 2 else 1) // 8))
    data = b"".join(packer.compress(row) for _ in range(height_px)) + packer.flush()
    head = struct.pack(">IIBBBBB", width_px, height_px, bits, color_type, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", data), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
