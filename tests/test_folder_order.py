"""The order of folders: imports go down, never up and never in a circle; folders stay small."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from tests.module_graph import MODULES, imports, tree
from tests.repository import ROOT

# A module may import its own folder and folders of lines above its own.
_FLOORS = (
    ("hsslam_node",),
    ("hsslam_proto",),
    (
        "hsslam_services.security",
        "hsslam_services.arena",
        "hsslam_services.governor",
        "hsslam_services.disk",
    ),
    ("hsslam_services.run",),
    ("hsslam_services.artefacts",),
    ("hsslam_services.bus",),
    ("hsslam_services.log", "hsslam_services.launch", "hsslam_services.ros2"),
    ("hsslam_services.viewer", "hsslam_services.camera", "hsslam_services.health"),
    ("hsslam_services.tracked",),
    ("hsslam_services.processes", "hsslam_services.requests"),
    ("hsslam_services.supervisor",),
    ("hsslam_services.commands",),
    ("hsslam_batch",),
    ("hsslam_bench",),
)
_LEVEL = {folder: level for level, floor in enumerate(_FLOORS) for folder in floor}
_MOSTMODULES = 15
_SHORT_LINES = 40


def _folder(module: str) -> str | None:
    parts = module.split(".")
    return next((f for k in (1, 2) if (f := ".".join(parts[:k])) in _LEVEL), None)


@cache
def _arrows() -> list[tuple[str, str]]:
    """Each module of ours with each other one that it imports."""
    return [
        (module, target)
        for module in MODULES
        for target in imports(module)
        if target in MODULES and target != module
    ]


# The lists of all commands name the bench's by strings, which are imported only if one is asked for.
_LISTS_OF_COMMANDS = ("hsslam_services.commands.hsslam", "hsslam_services.commands.all_options")


def test_every_folder_has_its_place_in_the_order():
    beside = {"hsslam_services"}  # the package itself
    assert not [module for module in MODULES if _folder(module) is None and module not in beside]


def test_the_product_does_not_name_the_bench():
    product = [m for m in MODULES if not m.startswith("hsslam_bench")]
    named = [m for m in product if re.search(r"hsslam_bench[.:]", MODULES[m].read_text())]
    assert sorted(named) == sorted(_LISTS_OF_COMMANDS)


def test_no_import_goes_up_or_sideways():
    wrong = []
    for module, target in _arrows():
        above, below = _folder(module), _folder(target)
        if above is None or below is None or above == below:
            continue
        if _LEVEL[below] >= _LEVEL[above]:
            wrong.append(f"{module} -> {target}")
    assert not wrong


@pytest.mark.parametrize(
    "package",
    ["hsslam_node", "hsslam_proto", "hsslam_services", "hsslam_batch", "hsslam_bench"],
)
def test_folders_import_each_other_without_circles(package: str):
    arrows: dict[str, set[str]] = defaultdict(set)
    for module, target in _arrows():
        pair = [_folder_path(name) for name in (module, target)]
        if all(name.startswith(package) for name in pair) and pair[0] != pair[1]:
            arrows[pair[0]].add(pair[1])
    assert not _circle(arrows)


def test_modules_import_each_other_without_circles():
    arrows: dict[str, set[str]] = defaultdict(set)
    for module, target in _arrows():
        arrows[module].add(target)
    assert not _circle(arrows)


def test_a_folder_has_at_most_15_modules():
    counts: dict[Path, int] = defaultdict(int)
    for path in MODULES.values():
        counts[path.parent] += path.name != "__init__.py"
    assert not {str(f.relative_to(ROOT)): n for f, n in counts.items() if n > _MOSTMODULES}


def test_every_folder_and_module_says_what_it_is():
    silent = [m for m in MODULES if len(_first_line(m)) < 10]
    assert not silent


def test_a_short_file_says_why_it_stands_alone():
    short = [m for m, p in MODULES.items() if len(p.read_text().splitlines()) < _SHORT_LINES]
    modules = [m for m in short if MODULES[m].name != "__init__.py"]
    reasons = ("of its own", "apart", "alone")
    assert not [m for m in modules if not any(r in _first_line(m) for r in reasons)]


@cache
def _folder_path(module: str) -> str:
    """The folder of a module; a module that lies beside other folders counts as one itself."""
    path = MODULES[module]
    is_alone = path.name == "__init__.py" or any(path.parent.glob("*/__init__.py"))
    return module if is_alone else module.rpartition(".")[0]


def _first_line(module: str) -> str:
    return (ast.get_docstring(tree(module)) or "").partition("\n")[0]


def _circle(arrows: dict[str, set[str]]) -> list[str]:
    """Names along one circle; empty if there is none."""
    done: set[str] = set()
    for start in list(arrows):
        path, stack = [start], [iter(sorted(arrows[start]))]
        while stack:
            step = next(stack[-1], None)
            if step is None:
                done.add(path.pop())
                stack.pop()
            elif step in path:
                return path[path.index(step) :]
            elif step not in done:
                path.append(step)
                stack.append(iter(sorted(arrows.get(step, ()))))
    return []
