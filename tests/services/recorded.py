"""What a log holds; apart as several tests of the recorder read it."""

from pathlib import Path

from mcap.reader import make_reader

from hsslam_proto import topics
from hsslam_proto.codec import decode, encoding_of


def read_log(path: Path) -> dict[str, list]:
    """The messages of each topic, in their order."""
    by_key = {topic.key("r"): topic for topic in topics.TOPICS}
    out: dict[str, list] = {}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            topic = by_key.get(channel.topic)
            if topic is not None:
                decoded = decode(topic, message.data, encoding_of(topic))
                out.setdefault(topic.name, []).append(decoded)
    return out
