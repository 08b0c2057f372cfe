"""A ROS 2 node in a zenoh session: it publishes and subscribes, and the ROS graph shows it."""

import time
from typing import Any

import zenoh
import zenoh.ext

from hsslam_services.bus.publisher import has_subscribers
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.ros2.messages import Kind, RosMessages
from hsslam_services.ros2.names import NodeName, Qos, TopicName, attachment, gid

_LARGEST_BYTES = 1 << 16  # of a message to the node, such as a pose
_HEARTBEAT_S = 0.5  # after a message that is kept for late subscribers
_NO_SHARED_MEMORY = {"transport/shared_memory/enabled": False}  # ROS nodes have none by default


class RosNode:
    """A client of the router of ROS nodes; a context manager whose end removes the node from the graph.

    Raises:
        UserError: no router at `endpoint` within `timeout_s`.
    """

    def __init__(
        self,
        endpoint: str,
        domain: int,
        namespace: str,
        name: str,
        messages: RosMessages,
        timeout_s: float = 10.0,
    ) -> None:
        self._messages = messages
        self._session = open_client(endpoint, timeout_s, settings=_NO_SHARED_MEMORY)
        zid = str(self._session.info.zid())
        self._node = NodeName(domain, zid, name, namespace)
        self._token = self._session.liveliness().declare_token(self._node.token())
        self._publishers: list[RosPublisher] = []
        self._subscriptions: list[RosSubscription] = []

    def publisher(self, topic: str, kind: Kind, qos: Qos) -> "RosPublisher":
        """A publisher of an absolute topic, as `/tf`, or of one in the node's namespace, as `odom`."""
        name, number = self._topic_name(topic, kind), self._next_number()
        made = RosPublisher(self._session, self._node, number, name, qos, self._messages)
        self._publishers.append(made)
        return made

    def subscription(self, topic: str, kind: Kind, qos: Qos) -> "RosSubscription":
        """A subscription to a topic, named as for `publisher`."""
        name, number = self._topic_name(topic, kind), self._next_number()
        made = RosSubscription(self._session, self._node, number, name, qos)
        self._subscriptions.append(made)
        return made

    def _topic_name(self, topic: str, kind: Kind) -> TopicName:
        absolute = topic if topic.startswith("/") else f"{self._node.namespace}/{topic}"
        return TopicName(absolute, kind, self._messages.type_hash(kind))

    def _next_number(self) -> int:
        return len(self._publishers) + len(self._subscriptions) + 1

    def close(self) -> None:
        """Withdraw tokens, publishers and subscriptions."""
        for each in (*self._publishers, *self._subscriptions):
            each.close()
        self._token.undeclare()
        self._session.close()

    def __enter__(self) -> "RosNode":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RosPublisher:
    """A publisher of one topic; `RosNode.publisher` makes it."""

    def __init__(
        self,
        session: zenoh.Session,
        node: NodeName,
        number: int,
        name: TopicName,
        qos: Qos,
        messages: RosMessages,
    ) -> None:
        self.name = name
        self.sent = 0
        self._messages = messages
        self._publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher
        token = node.publisher_token(number, name, qos)
        self._gid = gid(token)
        reliability = (
            zenoh.Reliability.RELIABLE if qos.is_reliable else zenoh.Reliability.BEST_EFFORT
        )
        key = name.key(node.domain)
        if qos.is_latched:
            self._publisher = zenoh.ext.declare_advanced_publisher(
                session,
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=reliability,
                cache=zenoh.ext.CacheConfig(qos.depth),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S
                ),
                publisher_detection=True,
            )
        else:
            self._publisher = session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP, reliability=reliability
            )
        self._token = session.liveliness().declare_token(token)

    def has_subscribers(self) -> bool:
        """Whether there is a subscriber; always true if messages are kept for late subscribers."""
        return has_subscribers(self._publisher)

    def put(self, message: Any) -> None:
        """Send a message of the topic's type."""
        self.sent += 1
        beside = attachment(self.sent, time.time_ns(), self._gid)
        self._publisher.put(self._messages.encoded(message), attachment=beside)

    def close(self) -> None:
        """Leave the graph."""
        self._token.undeclare()
        self._publisher.undeclare()


class RosSubscription:
    """A subscription to one topic; `RosNode.subscription` makes it. It keeps the last `depth` messages."""

    def __init__(
        self, session: zenoh.Session, node: NodeName, number: int, name: TopicName, qos: Qos
    ) -> None:
        # any type hash: releases before Jazzy send none
        key = f"{node.domain}/{name.topic.strip('/')}/{name.type_name}/*"
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(qos.depth))
        token = node.subscription_token(number, name, qos)
        self._token = session.liveliness().declare_token(token)

    def newest(self) -> bytes | None:
        """The payload of the newest unread message; drops older ones, and those of more than 64 KiB."""
        payload = None
        while (sample := self._subscriber.try_recv()) is not None:
            if len(sample.payload) <= _LARGEST_BYTES:
                payload = sample.payload.to_bytes()
        return payload

    def close(self) -> None:
        """Leave the graph."""
        self._token.undeclare()
        self._subscriber.undeclare()
