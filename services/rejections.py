"""How many messages could not be read, counted by those who listen to them."""

from collections.abc import Iterable, Mapping

from hsslam_node.services.child import Child
from hsslam_node.services.subscription import Subscription

_COUNTER = "rejected "  # followed by the topic's name in each heartbeat


def rejected_messages(own: Iterable[Subscription], children: Mapping[str, Child]) -> dict[str, int]:
    """Rejected messages of each topic that had some: as many as the receiver counts that saw most.

    All receivers of a topic reject the same; one that was restarted counts anew.
    """
    most = {subscription.topic.name: subscription.rejected for subscription in own}
    for child in children.values():
        for name, count in child.health.counters.items() if child.health else ():
            if name.startswith(_COUNTER):
                topic = name.removeprefix(_COUNTER)
                most[topic] = max(most.get(topic, 0), count)
    return {topic: count for topic, count in sorted(most.items()) if count}
