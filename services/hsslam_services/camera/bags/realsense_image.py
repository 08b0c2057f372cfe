"""Images in a `.bag` of the RealSense viewer; apart from its other messages, as each `BagFile` needs it."""

import struct


def image_without_unit(payload: bytes) -> bytes:
    """An `Image` of ROS 1 without the unit of depth that the SDK writes behind it."""
    try:
        at = 12  # sequence number and stamp
        at += 4 + _length(payload, at)  # frame_id
        at += 8  # size
        at += 4 + _length(payload, at)  # encoding
        at += 5  # byte order, step
        at += 4 + _length(payload, at)  # pixels
    except struct.error:
        return payload
    return payload[:at] if len(payload) == at + 4 else payload


def _length(payload: bytes, at: int) -> int:
    return int(struct.unpack_from("<I", payload, at)[0])
