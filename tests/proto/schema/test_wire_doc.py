import pytest

from hsslam_proto.requests import REFUSAL, REQUESTS
from hsslam_proto.schema.field_types import field_type
from hsslam_proto.schema.wire_doc import wire_doc
from hsslam_proto.topics import TOPICS
from tests.repository import ROOT


def test_every_topic_request_message_and_field_is_in_the_document():
    text = wire_doc()
    messages = {REFUSAL.message, *(topic.message for topic in TOPICS)}
    for request in REQUESTS:
        assert f"| `{request.name}` |" in text
        messages |= {request.asked.message, request.answered.message}
    for topic in TOPICS:
        assert f"| `{topic.name}` |" in text
    for message in messages:
        section = text.partition(f"\n### {message.__name__} v{message.MAJOR}\n")[2].split("\n### ")[
            0
        ]
        assert all(f"| `{field}` |" in section for field in message.__struct_fields__), message


@pytest.mark.parametrize(
    ("annotation", "words"),
    [
        (int, "int"),
        (tuple[float, float], "array of 2 float"),
        (dict[str, int], "map of (str) to (int)"),
        (list[bool], "array of (bool)"),
        (memoryview, "bin"),
    ],
)
def test_types_have_words(annotation, words):
    assert field_type(annotation) == words


def test_a_type_without_words_is_told():
    with pytest.raises(TypeError, match="no words"):
        field_type(set[int])


def test_the_document_is_current():
    text = (ROOT / "docs/wire.md").read_text()
    assert wire_doc() in text
