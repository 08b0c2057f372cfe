"""Draws malformed payloads from a seed."""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from hsslam_bench.fuzz.samples import SAMPLES
from hsslam_proto.codec import MEDIA_TYPE, Payload, Rejected, decode, encoding_of
from hsslam_proto.envelope import Envelope
from hsslam_proto.topics import Topic

_DEEPEST, _LONGEST_NOISE = 2000, 400
_CHEAP_LIMIT_BYTES = 2**17  # above this limit, too large payloads come only from `too_large`


@dataclass(frozen=True)
class Malformed:
    """A payload with its kind, encoding and attachment."""

    kind: str
    payload: bytes
    encoding: str
    attachment: bytes | None = None


def malformed(target: Topic | Payload, rng: random.Random) -> Malformed:
    """A payload of a random kind that every receiver of `target` rejects."""
    kinds = list(_KINDS)
    if isinstance(target, Topic):
        kinds.append("wrong attachment")
    while True:
        kind = rng.choice(kinds)
        if kind == "wrong attachment":
            payload = msgspec.msgpack.encode(SAMPLES[target.message])
            return Malformed(kind, payload, encoding_of(target), _wrong_attachment(rng))
        drawn = _KINDS[kind](target, rng)
        if drawn is None:
            continue
        payload, encoding = drawn
        # draw again if the payload is valid: a flipped bit may fall into a pixel or a coordinate,
        # and a request without payload stands for its defaults
        nothing_asked = not payload and not isinstance(target, Topic)
        if not nothing_asked and isinstance(decode(target, payload, encoding), Rejected):
            return Malformed(kind, payload, encoding)


def too_large(target: Topic | Payload) -> Malformed:
    """A payload one byte above the size limit."""
    return Malformed("too large", bytes(target.size_limit_bytes + 1), encoding_of(target))


def _truncated(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    payload = _sample(target)
    return payload[: rng.randrange(len(payload))], encoding_of(target)


def _flipped(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    payload = bytearray(_sample(target))
    for _ in range(rng.randint(1, 8)):
        payload[rng.randrange(len(payload))] ^= 1 << rng.randrange(8)
    return bytes(payload), encoding_of(target)


def _wrong_schema(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    name = target.message.__name__
    schemas = (
        "Nothing.v1",
        f"{name}.v0",
        f"{name}.v2",
        f"{name}.v10",
        f"{name}.v99999999999999999",
    )
    others = (*(f"{MEDIA_TYPE};hsslam.{schema}" for schema in schemas), "zenoh/bytes", "text/plain")
    return _sample(target), rng.choice((*others, MEDIA_TYPE, f"{MEDIA_TYPE};{'x' * 200}"))


def _wrong_type(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str] | None:
    fields = _fields(target)
    if not fields:
        return None
    wrong = (None, "text", b"bytes", -1, 2**64 - 1, 1.5, True, [], [[]], {}, {"a": 1}, "x" * 5000)
    fields[rng.choice(list(fields))] = rng.choice(wrong)
    return msgspec.msgpack.encode(fields), encoding_of(target)


def _missing(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str] | None:
    fields = _fields(target)
    if not fields:
        return None
    del fields[rng.choice(list(fields))]
    return msgspec.msgpack.encode(fields), encoding_of(target)


def _not_finite(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str] | None:
    fields = _fields(target)
    places = [
        (holder, key)
        for holder, key in _places(fields)
        if isinstance(holder[key], float)  # in vectors, too
    ]
    if not places:
        return None
    holder, key = rng.choice(places)
    holder[key] = rng.choice((math.nan, math.inf, -math.inf))
    return msgspec.msgpack.encode(fields), encoding_of(target)


def _nested(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    depth = rng.randint(2, _DEEPEST)
    nest = rng.choice((b"\x91", b"\x81\xa1a")) * depth + b"\xc0"
    name = rng.choice(list(_fields(target)) or ["a"])
    inside = b"\x81" + msgspec.msgpack.encode(name) + nest
    return rng.choice((nest, inside)), encoding_of(target)


def _claimed(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    """A msgpack header that announces gigabytes."""
    head = rng.choice((b"\xdf", b"\xdd", b"\xc6", b"\xdb", b"\xc9"))  # map, array, bin, str, ext
    name = rng.choice(list(_fields(target)) or ["a"])
    claim = head + b"\xff\xff\xff\xff"
    inside = b"\x81" + msgspec.msgpack.encode(name) + claim
    return rng.choice((claim, inside)), encoding_of(target)


def _too_large(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str] | None:
    if target.size_limit_bytes > _CHEAP_LIMIT_BYTES:
        return None
    return bytes(target.size_limit_bytes + rng.randint(1, 1000)), encoding_of(target)


def _empty(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    return b"", rng.choice((encoding_of(target), "zenoh/bytes"))


def _another(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    """A valid message of another kind, with this one's encoding."""
    other = rng.choice([kind for kind in SAMPLES if kind is not target.message])
    return msgspec.msgpack.encode(SAMPLES[other]), encoding_of(target)


def _noise(target: Topic | Payload, rng: random.Random) -> tuple[bytes, str]:
    return rng.randbytes(rng.randint(1, _LONGEST_NOISE)), encoding_of(target)


_Draw = Callable[[Topic | Payload, random.Random], tuple[bytes, str] | None]
_KINDS: dict[str, _Draw] = {
    "truncated": _truncated,
    "flipped bits": _flipped,
    "wrong schema": _wrong_schema,
    "wrong type": _wrong_type,
    "missing field": _missing,
    "not finite": _not_finite,
    "deep nesting": _nested,
    "claimed size": _claimed,
    "too large": _too_large,
    "empty": _empty,
    "another message": _another,
    "noise": _noise,
}
KINDS = (*_KINDS, "wrong attachment")


def _wrong_attachment(rng: random.Random) -> bytes:
    backwards = Envelope(rng.randrange(2**32), 2**32 - 1, -1, rng.randrange(-(2**63), 0))
    return rng.choice(
        (b"", b"x", rng.randbytes(23), rng.randbytes(25), bytes(9999), backwards.pack())
    )


def _sample(target: Topic | Payload) -> bytes:
    return msgspec.msgpack.encode(SAMPLES[target.message])


def _fields(target: Topic | Payload) -> dict[str, Any]:
    """The sample's fields as plain lists and maps."""
    return msgspec.msgpack.decode(_sample(target))


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every item of nested maps and arrays: its container, and its key or index."""
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    found = []
    for key, inner in items:
        found += [(value, key), *_places(inner)]
    return found
