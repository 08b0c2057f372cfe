import subprocess
import sys

import msgspec
import pytest

from hsslam_node.errors import UserError
from hsslam_proto.json_schemas import json_schema
from hsslam_proto.topic_table import BEGIN, END, topic_table, with_topic_table
from hsslam_proto.topics import TOPICS
from tests.repository import ROOT


def test_every_topic_and_field_is_in_the_table():
    table = topic_table()
    for topic in TOPICS:
        assert f"| `{topic.name}` | `{topic.message.__name__}` |" in table
    assert "`depth_units_per_m`" in table


def test_the_table_replaces_what_is_between_the_markers():
    old = f"before\n{BEGIN}\nstale\n{END}\nafter\n"
    new = with_topic_table(old, "x.md")
    assert new.startswith("before\n") and new.endswith("\nafter\n")
    assert "stale" not in new
    assert with_topic_table(new, "x.md") == new


def test_a_document_without_markers_is_told():
    with pytest.raises(UserError, match=r"x\.md: expected the lines"):
        with_topic_table("nothing", "x.md")


def test_the_command_checks_and_writes(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"{BEGIN}\n{END}\n")
    assert _run("--check", page) == 1
    assert _run(page) == 0
    assert _run("--check", page) == 0
    assert _run(tmp_path / "missing.md") == 2


def test_the_docs_are_current():
    page = ROOT / "docs/architecture.md"
    if not page.exists():
        pytest.skip("docs/architecture.md is not written yet")
    text = page.read_text()
    assert with_topic_table(text, page.name) == text


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_json_schemas_describe_all_fields(topic):
    schema = msgspec.json.decode(json_schema(topic))
    assert schema["title"] == topic.schema
    assert set(schema["properties"]) == set(topic.message.__struct_fields__)


def _run(*arguments) -> int:
    command = [sys.executable, "-m", "hsslam_proto.topic_table", *map(str, arguments)]
    return subprocess.run(command, capture_output=True).returncode
