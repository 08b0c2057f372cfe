"""JSON Schemas of the messages, for the log; alone, as message types generate them."""

import json
from functools import cache

import msgspec

from hsslam_proto.topics import Topic


@cache
def json_schema(topic: Topic) -> bytes:
    """JSON Schema of the topic's message; byte fields are msgpack `bin` on the wire."""
    schema = msgspec.json.schema(topic.message)
    definitions = schema.pop("$defs")
    root = definitions.pop(topic.message.__name__)
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": topic.schema}
    schema |= {key: value for key, value in root.items() if key != "title"}
    if definitions:
        schema["$defs"] = definitions
    return json.dumps(schema, indent=1).encode()
