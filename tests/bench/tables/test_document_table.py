"""Tables in documents."""

import pytest

from hsslam_bench.results.document import fill_table
from hsslam_node.errors import UserError


def test_only_the_table_of_this_name_changes(tmp_path):
    document = tmp_path / "results.md"
    document.write_text(
        "a\n<!-- table:tum -->\nold\n<!-- table:end -->\nb\n<!-- table:ablation -->\n<!-- table:end -->\n"
    )
    fill_table(document, "ablation", "| \\1 new |\n\n")
    fill_table(document, "ablation", "| \\1 newer |\n")
    assert document.read_text() == (
        "a\n<!-- table:tum -->\nold\n<!-- table:end -->\nb\n"
        "<!-- table:ablation -->\n| \\1 newer |\n<!-- table:end -->\n"
    )


def test_a_document_without_the_lines_is_told(tmp_path):
    (tmp_path / "a.md").write_text("text\n")
    with pytest.raises(UserError, match="expected the lines <!-- table:tum -->"):
        fill_table(tmp_path / "a.md", "tum", "x")
    with pytest.raises(UserError, match="expected a document"):
        fill_table(tmp_path / "none.md", "tum", "x")
