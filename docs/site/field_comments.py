"""Griffe extension: the comment behind a field, such as its shape and unit, becomes its docstring."""

import ast
import re
from typing import Any

import griffe

_COMMENT = re.compile(r"  # (.+)$")


class FieldComments(griffe.Extension):
    """Fields that have a docstring keep it."""

    def on_attribute_instance(
        self, *, node: ast.AST | griffe.ObjectNode, attr: griffe.Attribute, **_: Any
    ) -> None:
        """Take the comment on the last line of the field's definition."""
        if attr.docstring is None and isinstance(node, ast.AnnAssign) and node.end_lineno:
            line = attr.lines_collection[attr.filepath][node.end_lineno - 1]
            if comment := _COMMENT.search(line):
                attr.docstring = griffe.Docstring(comment[1], lineno=node.end_lineno, parent=attr)
