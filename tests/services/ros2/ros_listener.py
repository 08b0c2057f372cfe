"""A node of ROS as rmw_zenoh makes it: a peer that hears all topics and tokens of a domain."""

import json
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import zenoh
import zenoh.ext
from pycdr2 import IdlStruct
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zenoh.ext import Int64, z_deserialize

from hsslam_services.bus.zenoh_session import NO_SETTINGS
from hsslam_services.camera.ros2_messages import topic_of, type_of
from hsslam_services.ros2.names import TopicName, all_tokens, gid
from tests.services.ros2.ros_types import KINDS

_SLICE = """\
std_msgs/Header header
float32 resolution
uint32 width
uint32 height
geometry_msgs/Point origin
float32 unknown_value
float32[] data
"""
_STORE = get_typestore(Stores.ROS2_KILTED)
_STORE.register(get_types_from_msg(_SLICE, "nvblox_msgs/msg/DistanceMapSlice"))


class Heard(NamedTuple):
    """A message, read twice: by rosbags with the definitions of another release, and by pycdr2."""

    topic: str
    kind: str
    by_rosbags: Any
    by_pycdr2: IdlStruct
    sequence: int
    stamp_ns: int
    gid: bytes


def read(sample: zenoh.Sample) -> Heard:
    """What a sample says; its key has the right hash of the type."""
    key = str(sample.key_expr)
    kind, payload = type_of(key), sample.payload.to_bytes()
    assert key.rpartition("/")[2] == _STORE.hash_rihs01(kind)
    assert sample.attachment is not None  # rmw_zenoh drops messages without one
    sequence, stamp_ns, publisher = z_deserialize(tuple[Int64, Int64, bytes], sample.attachment)
    by_rosbags = _STORE.deserialize_cdr(payload, kind)
    assert bytes(_STORE.serialize_cdr(by_rosbags, kind)) == payload
    by_pycdr2 = KINDS[kind].deserialize(payload)
    return Heard(
        topic_of(key), kind, by_rosbags, by_pycdr2, int(sequence), int(stamp_ns), publisher
    )


def ros_peer(endpoint: str, settings: Mapping[str, object] = NO_SETTINGS) -> zenoh.Session:
    """A session as the default configuration of rmw_zenoh has it."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("listen/endpoints", '["tcp/localhost:0"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/target", '{"peer": ["router"]}')
    config.insert_json5("timestamping/enabled", "true")
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class RosListener:
    """Keeps every message and token from now on; `settings`: of zenoh, as those for a certificate."""

    def __init__(
        self, endpoint: str, domain: int = 0, settings: Mapping[str, object] = NO_SETTINGS
    ) -> None:
        self._session = ros_peer(endpoint, settings)
        self._domain = domain
        self._lock = threading.Condition()
        self._samples: list[zenoh.Sample] = []
        self._tokens: set[str] = set()
        self._subscribers: list[Any] = [
            self._session.liveliness().declare_subscriber(
                all_tokens(domain), self._take_token, history=True
            )
        ]

    def hear(self, topic: str) -> None:
        """Subscribe to a topic, as with durability volatile."""
        key = f"{self._domain}/{topic.strip('/')}/*/*"
        self._subscribers.append(self._session.declare_subscriber(key, self._take))

    def hear_latched(self, topic: str) -> None:
        """Subscribe to a topic with durability transient local."""
        self._subscribers.append(
            zenoh.ext.declare_advanced_subscriber(
                self._session,
                f"{self._domain}/{topic.strip('/')}/*/*",
                self._take,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                subscriber_detection=True,
            )
        )

    def heard(self, topic: str = "") -> list[Heard]:
        """What has come so far, in order; of one topic."""
        with self._lock:
            samples = list(self._samples)
        return [one for one in map(read, samples) if topic in ("", one.topic)]

    def tokens(self) -> set[str]:
        """Those that are alive."""
        with self._lock:
            return set(self._tokens)

    def wait_until(self, is_met: Callable[[], bool], timeout_s: float = 60.0) -> None:
        """Until something that comes meets it."""
        deadline_s = time.monotonic() + timeout_s
        with self._lock:
            while not is_met():
                left_s = deadline_s - time.monotonic()
                assert left_s > 0, f"heard {len(self._samples)}, tokens {self._tokens}"
                self._lock.wait(left_s)

    def count(self, topic: str) -> int:
        """Messages of a topic so far; may be called in `wait_until`."""
        return sum(topic_of(str(sample.key_expr)) == topic for sample in self._samples)

    def alive(self) -> int:
        """Tokens; may be called in `wait_until`."""
        return len(self._tokens)

    def send(self, topic: TopicName, payload: bytes) -> None:
        """Publish a message, to those who subscribe now."""
        self._session.put(topic.key(self._domain), payload)

    def close(self) -> None:
        self._session.close()

    def _take(self, sample: zenoh.Sample) -> None:
        with self._lock:
            self._samples.append(sample)
            self._lock.notify_all()

    def _take_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._tokens.add(key)
            else:
                self._tokens.discard(key)
            self._lock.notify_all()


def gid_of(topic: str, tokens: set[str]) -> bytes:
    """Of the publisher that the graph shows for a topic."""
    flat = topic.replace("/", "%")
    (token,) = (token for token in tokens if f"/{flat}/" in token)
    return gid(token)
