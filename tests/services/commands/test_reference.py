import subprocess
import sys

from hsslam_services.commands.all_options import OPTIONS, options_of
from hsslam_services.commands.reference import reference
from tests.repository import ROOT


def test_every_command_and_option_is_in_the_document():
    text = reference()
    for command in list(OPTIONS)[1:]:
        assert f"# {command}\n" in text
        assert all(f"{o.value if o.is_positional else o.flag}" in text for o in options_of(command))


def test_the_command_checks_and_writes(tmp_path):
    page = tmp_path / "cli.md"
    assert _run("--check", page) == 2
    assert _run(page) == 0
    assert _run("--check", page) == 0
    page.write_text(page.read_text() + "more")
    assert _run("--check", page) == 1


def test_the_docs_are_current():
    assert (ROOT / "docs/cli.md").read_text() == reference()


def _run(*arguments) -> int:
    command = [sys.executable, "-m", "hsslam_services.commands.reference", *map(str, arguments)]
    return subprocess.run(command, capture_output=True).returncode
