"""What a log and its file for rerun hold; apart as several tests of the recorder read them."""

import re
import subprocess
from pathlib import Path

import rerun_cli
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from hsslam_proto import topics
from hsslam_proto.codec import decode, encoding_of

RERUN = str(Path(rerun_cli.__file__).parent / "rerun")


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


def read_viz(path: Path) -> dict[str, list]:
    """The Foxglove messages of each topic, in their order."""
    out: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        topics_of_layer = [c.topic for c in reader.get_summary().channels.values()]
        chosen = [topic for topic in topics_of_layer if topic.startswith("/viz/")]
        for _, channel, _, message in reader.iter_decoded_messages(chosen):
            out.setdefault(channel.topic, []).append(message)
    return out


def rrd(*command: str | Path) -> str:
    """What `rerun rrd ...` prints."""
    whole = [RERUN, "rrd", *command]
    return subprocess.run(whole, check=True, capture_output=True, text=True).stdout


def rrd_rows(path: Path, entity: str) -> int:
    """How often something was drawn there."""
    chunks = re.findall(rf"with (\d+) rows .* {entity} ", rrd("print", path))
    return sum(int(rows) for rows in chunks)
