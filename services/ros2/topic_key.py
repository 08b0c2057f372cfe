"""Keys of rmw_zenoh: `<domain>/<topic>/<package>::msg::dds_::<Type>_/<hash>`."""

import re


def topic_keys(domain: int, topic: str) -> str:
    """The key expression of whatever is published on a topic, `/camera/color/image_raw`."""
    return f"{domain}/{topic.strip('/')}/*/*"


def all_topics(domain: int) -> str:
    """The key expression of all messages of sensor_msgs in a domain."""
    return f"{domain}/**/sensor_msgs$*/*"


def type_of(key: str) -> str:
    """The message type of a key, `sensor_msgs/msg/Image`; empty of a key of something else."""
    match = re.fullmatch(r".+/(\w+)::msg::dds_::(\w+)_/[^/]+", key)
    return f"{match[1]}/msg/{match[2]}" if match else ""


def topic_of(key: str) -> str:
    """The topic of a key, `/camera/color/image_raw`."""
    return "/" + "/".join(key.split("/")[1:-2])
