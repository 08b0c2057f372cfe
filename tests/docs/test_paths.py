"""Every file of the project that a document names exists."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.repository import ROOT

_DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
_PATH = re.compile(r"`([\w./-]+/[\w.-]+\.(?:py|toml|yaml|yml|cuda|lock|sh))`")
_MODULE = re.compile(r"`(\w+\.py)`")  # in the folder that the same cell or sentence names
_FOLDER = re.compile(r"`((?:docs|hsslam_node|proto|services|tests)/[\w/]*/)`")


@pytest.fixture(scope="module")
def files() -> set[str]:
    """All files of the working tree below the folders of the project."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    try:
        return set(subprocess.check_output(command, cwd=ROOT, text=True).split())
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a checkout")


@pytest.mark.parametrize("page", _DOCUMENTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_named_by_a_document_exist(page: Path, files: set[str]):
    named = set(_PATH.findall(page.read_text()))
    ends = {"/".join(f.split("/")[k:]) for f in files for k in range(f.count("/") + 1)}
    assert not {path for path in named if path.removeprefix("../") not in ends}


@pytest.mark.parametrize("page", _DOCUMENTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_folders_and_modules_named_by_a_document_exist(page: Path, files: set[str]):
    text = page.read_text()
    modules = {file.rpartition("/")[2] for file in files}
    assert not {name for name in _MODULE.findall(text) if name not in modules}
    folders = {f"{parent}/" for file in files for parent in Path(file).parents}
    assert not {name for name in _FOLDER.findall(text) if name not in folders}
