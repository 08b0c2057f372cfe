"""Which module of ours imports which, read from the sources; a module of its own because two tests ask it."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.repository import ROOT

_ROOTS = {"hsslam_node": ROOT, "hsslam_proto": ROOT / "proto"}
_ROOTS |= dict.fromkeys(("hsslam_services", "hsslam_batch", "hsslam_bench"), ROOT / "services")


def _modules() -> dict[str, Path]:
    found = {}
    for package, root in _ROOTS.items():
        for path in (root / package).rglob("*.py"):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()
"""Every module of ours with its file."""


@cache
def tree(module: str) -> ast.Module:
    """The syntax tree of a module of ours."""
    return ast.parse(MODULES[module].read_text())


def imports(module: str) -> Iterator[str]:
    """What a module of ours imports, also inside functions."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in MODULES else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
