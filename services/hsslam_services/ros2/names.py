"""Names of ROS frames; keys of topics, QoS, liveliness tokens and message attachments of rmw_zenoh.

Follows `docs/design.md` of https://github.com/ros2/rmw_zenoh and the messages of its publishers.
"""

import struct
from dataclasses import dataclass

# sequence, ns since 1970, length of the gid, gid; since rmw_zenoh 0.2.4 of Jazzy
_ATTACHMENT = struct.Struct("<qqB16s")
_BEST_EFFORT, _TRANSIENT_LOCAL = 2, 1  # enums of rmw
_DEFAULT_DEPTH = 42  # of rmw_zenoh
_NO_ENCLAVE = "%"


@dataclass(frozen=True)
class FrameNames:
    """The frames of a robot as in REP 105."""

    map: str
    odom: str
    base: str
    camera: str

    @classmethod
    def of(cls, prefix: str) -> "FrameNames":
        """The frame names of a robot, each with its prefix."""
        names = ("map", "odom", "base_link", "camera_optical_frame")
        return cls(*(f"{prefix}{name}" for name in names))


@dataclass(frozen=True)
class Qos:
    """History keeps the last `depth` messages; `is_latched`: late subscribers get them (transient local)."""

    depth: int
    is_reliable: bool = True
    is_latched: bool = False

    def text(self) -> str:
        """As in a token: defaults stay empty (reliable, volatile, keep last, no deadlines)."""
        reliability = "" if self.is_reliable else f"{_BEST_EFFORT}"
        durability = f"{_TRANSIENT_LOCAL}" if self.is_latched else ""
        depth = "" if self.depth == _DEFAULT_DEPTH else f"{self.depth}"
        return f"{reliability}:{durability}:,{depth}:,:,:,,"


@dataclass(frozen=True)
class TopicName:
    """One topic, as `/hsslam/odom`; its message type, as `nav_msgs/msg/Odometry`, and the type's hash."""

    topic: str
    message: str
    type_hash: str

    @property
    def type_name(self) -> str:
        """The type name in DDS, as `nav_msgs::msg::dds_::Odometry_`."""
        package, kind, name = self.message.split("/")
        return f"{package}::{kind}::dds_::{name}_"

    def key(self, domain: int) -> str:
        """The zenoh key of its messages."""
        return f"{domain}/{self.topic.strip('/')}/{self.type_name}/{self.type_hash}"


@dataclass(frozen=True)
class NodeName:
    """A node in a session of zenoh, `zid` in hexadecimal digits."""

    domain: int
    zid: str
    name: str
    namespace: str = ""

    def token(self) -> str:
        """The liveliness token that the node holds."""
        return self._token("NN", 0)

    def publisher_token(self, number: int, topic: TopicName, qos: Qos) -> str:
        """The liveliness token of its publisher `number`, 1 or more: 0 is the node itself."""
        return self._topic_token("MP", number, topic, qos)

    def subscription_token(self, number: int, topic: TopicName, qos: Qos) -> str:
        """The liveliness token of its subscription; publishers and subscriptions are numbered together."""
        return self._topic_token("MS", number, topic, qos)

    def _topic_token(self, kind: str, number: int, topic: TopicName, qos: Qos) -> str:
        message = f"{topic.type_name}/{topic.type_hash}"
        return f"{self._token(kind, number)}/{_flat(topic.topic)}/{message}/{qos.text()}"

    def _token(self, kind: str, number: int) -> str:
        place = f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/{kind}"
        return f"{place}/{_NO_ENCLAVE}/{_flat(self.namespace or '/')}/{self.name}"


def all_tokens(domain: int) -> str:
    """The key expression of the tokens of all nodes and publishers of a domain."""
    return f"@ros2_lv/{domain}/**"


def gid(token: str) -> bytes:
    """The 16 bytes that identify the publisher with this token."""
    import xxhash

    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def attachment(sequence: int, stamp_ns: int, publisher: bytes) -> bytes:
    """The attachment of a message: its number, from 1, its time, the publisher's gid."""
    return _ATTACHMENT.pack(sequence, stamp_ns, len(publisher), publisher)


def _flat(name: str) -> str:
    return name.replace("/", "%")
