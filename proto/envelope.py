"""The 24-byte attachment of each message: rate, loss and latency without decoding the payload."""

import struct
from dataclasses import dataclass

_LAYOUT = struct.Struct("<IIqq")


@dataclass(frozen=True)
class Envelope:
    """Publisher, number in its sequence, sensor stamp and publish time (wall clock, ns)."""

    publisher: int
    sequence: int
    stamp_ns: int
    publish_ns: int

    def pack(self) -> bytes:
        """24 bytes, little endian: uint32 publisher and sequence, int64 stamp and publish time."""
        return _LAYOUT.pack(self.publisher, self.sequence, self.stamp_ns, self.publish_ns)

    @staticmethod
    def unpack(data: bytes | None) -> "Envelope | None":
        """The envelope in an attachment; None where there is none (an outside publisher)."""
        if data is None or len(data) != _LAYOUT.size:
            return None
        return Envelope(*_LAYOUT.unpack(data))
