"""Encodes and decodes messages. An unreadable payload becomes a `Rejected`, never an exception."""

import re
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, Literal, TypeVar

import msgspec

from hsslam_proto.message import Message
from hsslam_proto.topics import Topic, schema_of

M = TypeVar("M", bound=Message)
MEDIA_TYPE = "application/msgpack"

_ENCODING = re.compile(rf"{MEDIA_TYPE};hsslam\.(\w+)\.v([0-9]+)")
_ENCODER = msgspec.msgpack.Encoder()


@dataclass(frozen=True)
class Payload(Generic[M]):
    """A message type that is no topic, as of requests; error texts have its `name`."""

    name: str
    message: type[M]
    size_limit_bytes: int

    @property
    def schema(self) -> str:
        """Schema name with its major version, as in the encoding: `hsslam.Status.v1`."""
        return schema_of(self.message)


@dataclass(frozen=True)
class Rejected:
    """Why a payload was rejected, in one line for the operator."""

    topic: str
    reason: Literal["encoding", "schema", "version", "size", "attachment", "malformed", "sequence"]
    text: str


def encoding_of(topic: Topic | Payload) -> str:
    """The encoding string that travels with each message of the topic."""
    return f"{MEDIA_TYPE};{topic.schema}"


def encode(topic: Topic[M] | Payload[M], message: M) -> bytes:
    """Payload of a message.

    Raises:
        ValueError: the message has another type than the topic, or exceeds its size limit.
    """
    if type(message) is not topic.message:
        raise ValueError(
            f"{topic.name}: {type(message).__name__}: expected {topic.message.__name__}"
        )
    payload = _ENCODER.encode(message)
    if len(payload) > topic.size_limit_bytes:
        raise ValueError(
            f"{topic.name}: {len(payload)} bytes: expected at most {topic.size_limit_bytes}"
        )
    return payload


def decode(topic: Topic[M] | Payload[M], payload: bytes, encoding: str) -> M | Rejected:
    """The message in a payload, its byte fields as views of the payload; or the reason for rejection."""
    rejected = check(topic, len(payload), encoding)
    if rejected is not None:
        return rejected
    try:
        return _decoder(topic.message).decode(payload)
    except (msgspec.MsgspecError, RecursionError, ValueError, OverflowError) as error:
        return Rejected(topic.name, "malformed", f"{topic.name}: malformed message: {error}")


def check(topic: Topic | Payload, nbytes: int, encoding: str) -> Rejected | None:
    """Check size, encoding, schema and major version without decoding the payload; None: all are right."""

    def no(reason: Any, found: object, expected: object) -> Rejected:
        return Rejected(
            topic.name, reason, f"{topic.name}: {reason} {found!s:.120}: expected {expected}"
        )

    if nbytes > topic.size_limit_bytes:
        return no("size", f"{nbytes} bytes", f"at most {topic.size_limit_bytes}")
    match = _ENCODING.fullmatch(encoding)
    if match is None:
        return no("encoding", repr(encoding), encoding_of(topic))
    name, major = match.groups()
    if name != topic.message.__name__:
        return no("schema", name, topic.message.__name__)
    if major != str(topic.message.MAJOR):
        return no("version", major, topic.message.MAJOR)
    return None


@cache
def _decoder(message: type[M]) -> msgspec.msgpack.Decoder[M]:
    return msgspec.msgpack.Decoder(message)
