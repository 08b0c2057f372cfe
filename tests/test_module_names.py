"""Modules that the code names in strings, to start them as processes, are there."""

import ast
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

from tests.repository import ROOT

_DOTTED = re.compile(r"hsslam_(node|proto|services|batch|bench)(\.[a-z_0-9]+)+")


def test_every_module_that_a_string_names_exists():
    named = {(name, path) for path in _sources() for name in _names(path)}
    assert {name for name, _ in named} >= {
        "hsslam_bench.tables.table_run",
        "hsslam_batch.attempt.fetch",
        "hsslam_bench.scripts.preset_speed",
    }
    lost = [(name, str(path)) for name, path in named if not _is_module(name)]
    assert lost == []


def _sources() -> Iterator[Path]:
    for folder in ("hsslam_node", "proto", "services"):
        yield from (ROOT / folder).rglob("*.py")


def _names(path: Path) -> Iterator[str]:
    """Dotted names that are whole strings; `f"{__package__}.x"` breaks when its file moves."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.JoinedStr):
            assert "__package__" not in ast.unparse(node), path
        elif isinstance(node, ast.Constant) and _DOTTED.fullmatch(str(node.value)):
            yield str(node.value)


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
