"""The commands of docs/logs.md, run as printed on one small log."""

import re
import shlex
import shutil
from pathlib import Path

import msgspec
import pytest

from hsslam_services.commands.log.command import main
from hsslam_services.commands.serve_command_line import parse_command_line
from tests.repository import ROOT
from tests.services.log.sample_log import write_log

_BLOCKS = re.findall(r"^```\n(.*?)^```", (ROOT / "docs/logs.md").read_text(), re.M | re.S)
_PRINTED = [block.splitlines() for block in _BLOCKS if block.startswith("$ hsslam-log ")]
_RUN = re.compile(r"run (\S+) of hsslam-node (\S+): (.*) \.\.\.")


@pytest.fixture
def in_a_folder_with_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All logs that the page names: two whole ones of 27 s, one without its end, a damaged one."""
    (told,) = (found for _, *lines in _PRINTED for line in lines if (found := _RUN.match(line)))
    options = msgspec.json.encode(parse_command_line(shlex.split(told[3]))).decode()
    metadata = {"run_id": told[1], "version": told[2], "options": options}
    monkeypatch.chdir(tmp_path)
    Path("runs/room").mkdir(parents=True)
    whole = write_log(Path("runs/room"), count=270, metadata=metadata).read_bytes()
    shutil.copytree("runs/room", "runs/livingroom")
    Path("torn.mcap").write_bytes(whole[: len(whole) // 2])
    damaged = bytearray(whole)
    third = len(whole) // 3
    damaged[third : third + 50] = bytes(50)
    Path("run.mcap").write_bytes(damaged)


def _words(line: str) -> str:
    """The line without its numbers."""
    return re.sub(r"\d[\d.:-]*", "N", line.removesuffix(" ..."))


@pytest.mark.usefixtures("in_a_folder_with_logs")
def test_the_commands_of_the_page(capsys):
    for command, *printed in _PRINTED:
        assert main(shlex.split(command)[2:]) == 0, command
        told = capsys.readouterr()
        assert not told.err, command
        lines = told.out.splitlines()
        if " info " in command:
            del lines[len(printed) :]  # a table, which the page does not show
        assert [_words(line) for line in lines] == [_words(line) for line in printed]
    assert len(_PRINTED) == 5 and Path("run.damaged.mcap").exists()
