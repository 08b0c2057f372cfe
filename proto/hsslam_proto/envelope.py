"""The 24-byte attachment of each message; alone, as clients read it without the codec."""

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
    def unpack(data: bytes) -> "Envelope":
        """The envelope in an attachment.

        Raises:
            ValueError: another length, or a time before 1970.
        """
        if len(data) != _LAYOUT.size:
            raise ValueError(f"attachment of {len(data)} bytes: expected {_LAYOUT.size}")
        envelope = Envelope(*_LAYOUT.unpack(data))
        if envelope.stamp_ns < 0 or envelope.publish_ns < 0:
            raise ValueError("attachment with a time before 1970: expected ns since then")
        return envelope
