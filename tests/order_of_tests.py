"""The order of tests that run in parallel; a file of its own, as it has a test."""

from itertools import groupby

import pytest

_SPREAD = 0.8  # the last whole run begins before this part of the files, as it takes long


def in_order(items: list[pytest.Item]) -> list[pytest.Item]:
    """One worker takes all tests of a file; any worker takes a test that starts a whole run.

    These are spread over the files: while a run waits for its processes, other workers compute.
    """
    runs = [item for item in items if item.get_closest_marker("e2e")]
    others = [item for item in items if not item.get_closest_marker("e2e")]
    for item in others:
        item.add_marker(pytest.mark.xdist_group(str(item.path.relative_to(item.config.rootpath))))
    files = [list(of_file) for _, of_file in groupby(others, lambda item: item.path)]
    ordered: list[pytest.Item] = []
    begun = 0
    for number, of_file in enumerate(files, 1):
        due = round(len(runs) * min(1.0, number / (_SPREAD * len(files))))
        ordered += runs[begun:due] + of_file
        begun = due
    return ordered + runs[begun:]


def without_group(node_id: str) -> str:
    """The name of a test by which pytest selects it: pytest-xdist adds `@` and the group."""
    name, _, group = node_id.rpartition("@")
    return name if name and "]" not in group else node_id
