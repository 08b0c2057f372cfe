"""Generates docs/wire.md from the tables of topics and requests; `make docs-update` (cog) calls it."""

import msgspec

from hsslam_proto.codec import MEDIA_TYPE
from hsslam_proto.message import Message
from hsslam_proto.requests import REFUSAL, REQUESTS, Request
from hsslam_proto.schema.field_types import field_type
from hsslam_proto.topics import TOPICS, Topic

_EXAMPLE = "examples/wire_client.py"
_TOPIC_HEAD = (
    *("key `hsslam/<robot>/`", "message", "from", "rate", "QoS", "kept", "limit", "log", "view"),
)
_HEAD = f"""\
A run is a [zenoh](https://zenoh.io) router with all its processes as clients. They and `hsslam-ctl` meet on a
socket that only this user can reach (`endpoint` in `run.json`). Other programs need a TCP port:
`--zenoh-port 7447` opens `tcp/127.0.0.1:7447`; `--bind`, `--security`, `--ros2-out`, `--source zenoh:` and
`--source ros2:` open it as well. These programs are clients: session mode `client`, the router as the
endpoint to connect to, scouting off. Through the port a client may publish `in/**`, subscribe to all topics
and send all requests; with [certificates](security.md) its role limits it. Frames and their end are taken
only by runs with `--source zenoh:`. A run with another source has a camera process of its own: its router
drops `in/frame` and `in/end` of clients without an error, and their publishers have no subscriber. A client
subscribes by keys within `in/**`, `out/**` or `sys/*`: for a wider key, such as `hsslam/robot/**`, the router
sends nothing and reports no error. With `--ros2-out` and `ros2:` it may also be a ROS node
([what it may do](security.md#ros-nodes-at-the-port)). A client that reads too
slowly misses messages; topics with history send them again on request. All keys begin with
`hsslam/<robot>/` (`--robot`, default `robot`).

- **Payload**: one [MessagePack](https://msgpack.org) map, field names as keys. Readers ignore fields that
  they do not know and take the default of one that is missing; a field without a default must be there.
- **Encoding** of the zenoh message: `{MEDIA_TYPE};hsslam.<Message>.v<major>`. If the message type, the major
  version or the encoding is another, the receiver rejects the message, counts it and publishes an event.
- **Attachment** of messages on topics (may be missing): 24 bytes, little endian: uint32 publisher, uint32
  number in its sequence, int64 stamp of the sensor, int64 time of publication (ns since 1970). A message
  with any other attachment is not read.
- **Kept**: the number of messages that the publisher caches for later subscribers of zenoh's `ext`. `all`:
  the answers to a `get` on the key, without consolidation, hold the whole current state.
- **Units**: metres, seconds, nanoseconds (`_ns`), pixels (`_px`); poses are camera to world, OpenCV axes (x
  right, y down, z forward), quaternions x y z w. Arrays in `bin` fields are little endian.
- **Integers** fit into 64 bits with a sign: one above `2**63 - 1` is refused.
- **Limits**: the receiver does not read a payload above the limit of its topic or request. It unpickles
  nothing.
- **Shared memory**: on the same machine large messages may come through zenoh's shared memory, which zenoh
  locks. A message beyond the receiver's limit (`ulimit -l`) never arrives, and zenoh reports no error: if the
  limit is below 512 MiB, set `transport/shared_memory/enabled` to `false`. The processes of the run then use
  shared memory only for frames of their own camera.

A client that uses `eclipse-zenoh` and `msgpack` alone: [`{_EXAMPLE}`](../{_EXAMPLE}).
"""
_REQUESTS = """## Requests

A request is a zenoh query (`get`) on `hsslam/<robot>/rpc/<name>`; its payload is the message under "asked".
The payload may be missing if the message has no required fields. The service refuses a request with an
unknown field, so it never does only a part of it. There is one answer:

- a reply: done, the payload is the message under "answered";
- an error reply with encoding `{refusal}`: refused, the payload holds the reason;
- an error reply of any other encoding: zenoh's own, no answer within the query's timeout;
- no reply: the router knows no service of this robot. The router does not pass on from the port an unknown
  request, a key with a wildcard, or a request that the client's role does not allow: these get no reply
  either.

| `rpc/` | asked | answered | limit | wait at least | |
| --- | --- | --- | --- | --- | --- |
{rows}
"""


def wire_doc() -> str:
    """The whole document."""
    rows = [_TOPIC_HEAD, ("---",) * len(_TOPIC_HEAD), *map(_topic_row, TOPICS)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    refusal = f"{MEDIA_TYPE};{REFUSAL.schema}"
    rows = "\n".join(map(_request_row, REQUESTS))
    parts = [_HEAD, f"## Topics\n\n{table}\n", _REQUESTS.format(refusal=refusal, rows=rows)]
    parts.append("## Messages\n")
    parts += [_message(message) for message in _all_messages()]
    return "\n".join(parts)


def _all_messages() -> list[type[Message]]:
    """Every message once, in the order of the tables."""
    found = [topic.message for topic in TOPICS]
    for request in REQUESTS:
        found += [request.asked.message, request.answered.message]
    return list(dict.fromkeys([*found, REFUSAL.message]))


def _topic_row(topic: Topic) -> tuple[str, ...]:
    return (
        f"`{topic.name}`",
        f"`{topic.message.__name__}`",
        topic.publisher,
        topic.rate,
        topic.qos.upper(),
        "all" if topic.keeps_state else str(topic.history or "-"),
        _size_text(topic.size_limit_bytes),
        "yes" if topic.logged else "-",
        "yes" if topic.drawn else "-",
    )


def _size_text(nbytes: int) -> str:
    """A limit in KiB or MiB."""
    return f"{nbytes // 2**20} MiB" if nbytes >= 2**20 else f"{nbytes // 2**10} KiB"


def _request_row(request: Request) -> str:
    asked, answered = request.asked.message.__name__, request.answered.message.__name__
    limit = _size_text(request.asked.size_limit_bytes)
    wait = f"{request.takes_s:g} s"
    return f"| `{request.name}` | `{asked}` | `{answered}` | {limit} | {wait} | {request.purpose} |"


def _message(message: type[Message]) -> str:
    text = " ".join((message.__doc__ or "").split())
    lines = [f"### {message.__name__} v{message.MAJOR}", "", text, ""]
    fields = msgspec.structs.fields(message)
    if fields:
        lines += ["| field | type | default |", "| --- | --- | --- |"]
    for field in fields:
        lines.append(f"| `{field.name}` | {field_type(field.type)} | {_default(field)} |")
    return "\n".join([*lines, ""]) if fields else "\n".join(lines)


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.default is not msgspec.NODEFAULT:
        return f"`{field.default!r}`"
    if field.default_factory is not msgspec.NODEFAULT:
        return f"`{field.default_factory()!r}`"
    return "-"
