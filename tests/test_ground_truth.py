"""Tracker, mapper, bundle adjustment and camera cannot know the truth: nothing they import reads it."""

import ast
from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points

import pytest

from hsslam_services.run import source_plugins
from hsslam_services.run.source_table import ALL_SOURCES
from tests.module_graph import MODULES, imports, tree

_PROCESSES = tuple(
    f"hsslam_services.processes.{name}" for name in ("camera", "tracker", "mapper", "global_ba")
)
_TRUTH = "ground_truth"  # the field of a row of sources that names a reader
_READERS = {row.ground_truth.partition(":")[2] for row in ALL_SOURCES if row.ground_truth}


def _reached(module: str) -> dict[str, str]:
    """Every module of ours that can be loaded with this one, and which one loads it."""
    found, new = {module: ""}, [module]
    while new:
        loader = new.pop()
        for target in _targets(loader):
            for name in set(_with_packages(target)) - set(found):
                found[name] = loader
                new.append(name)
    return found


@cache
def _targets(module: str) -> tuple[str, ...]:
    return tuple(_named(module))


def _named(module: str) -> Iterator[str]:
    """What it imports by statement, or by an import path such as `hsslam_node.sources.tum:TumSource`, or as
    the plugins that are installed."""
    yield from imports(module)
    if module == source_plugins.__name__:
        yield from (point.module for point in entry_points(group=source_plugins.GROUP))
    nodes = list(ast.walk(tree(module)))
    calls = [node for node in nodes if isinstance(node, ast.Call)]
    of_truth = {id(word.value) for call in calls for word in call.keywords if word.arg == _TRUTH}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            name, colon, _ = node.value.partition(":")
            if colon and id(node) not in of_truth:
                yield name


def _with_packages(module: str) -> Iterator[str]:
    """The module, if it is ours, and the packages that are loaded before it."""
    if module in MODULES:
        parts = module.split(".")
        yield from (".".join(parts[:k]) for k in range(1, len(parts) + 1))


def _uses_of_truth(module: str) -> Iterator[str]:
    """Readers of the truth that a module calls, passes on or imports, or finds in a row of sources."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Attribute) and node.attr in {_TRUTH, *_READERS}:
            yield node.attr
        elif isinstance(node, ast.Name) and node.id in _READERS:
            yield node.id
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names if alias.name in _READERS)


@pytest.mark.parametrize("process", _PROCESSES)
def test_a_process_reaches_nothing_of_the_evaluation(process: str):
    reached = _reached(process)
    assert not {m: by for m, by in reached.items() if m.startswith("hsslam_node.evaluation")}


@pytest.mark.parametrize("process", _PROCESSES)
def test_a_process_reaches_no_use_of_a_reader_of_the_truth(process: str):
    used = {module: list(_uses_of_truth(module)) for module in _reached(process)}
    assert not {module: names for module, names in used.items() if names}


def test_the_search_follows_calls_and_import_paths():
    """Control: what is known to be read is found, and the evaluator is seen to read the truth."""
    assert {row.opener.partition(":")[0] for row in ALL_SOURCES if row.opener} <= set(
        _reached("hsslam_services.processes.camera")
    )
    evaluator = _reached("hsslam_services.processes.evaluator")
    assert "hsslam_node.evaluation.ground_truth" in evaluator
    assert list(_uses_of_truth("hsslam_node.evaluation.ground_truth"))
