"""The completion scripts, asked by the shells themselves."""

import os
import pty
import select
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from hsslam_services.commands.all_options import OPTIONS, options_of
from hsslam_services.commands.hsslam import COMMANDS, main

_ASK = {
    "bash": """
source {script}
COMP_LINE='{line}' COMP_POINT={point} COMP_WORDBREAKS=$' \\t\\n"><=;|&(:'
words=({words})
_hsslam hsslam-serve
printf '%s\\n' "${{COMPREPLY[@]}}"
""",
    "fish": "source {script}; complete -C '{line}'",
}
_LINES = [
    ("hsslam-serve --pa", {"--pace"}),
    ("hsslam-serve --pace ", {"realtime", "lockstep"}),
    ("hsslam-serve --seed 1 --preset co", {"co-slam"}),
    ("hsslam-serve --slam.tracker.method ", {"alignment", "rendering"}),
    ("hsslam-serve --viewer connect", {"connect:"}),
    ("hsslam-serve --no-eval", {"--no-evaluate"}),
    ("hsslam-serve wa", {"warm-up"}),
    ("hsslam-log tr", {"trim"}),
    ("hsslam-log export run.mcap --only trajectory fr", {"frames"}),
    ("hsslam-log trim a b --st", {"--start"}),
    ("hsslam-ctl st", {"status", "stop"}),
    ("hsslam-bench ablation --pres", {"--preset"}),
    ("hsslam comp", {"completion"}),
    ("hsslam completion z", {"zsh"}),
    ("hsslam serve --pace lo", {"lockstep"}),
    ("hsslam log exp", {"export"}),
]


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("completion")
    for shell in ("bash", "zsh", "fish"):
        with pytest.MonkeyPatch.context() as patch, (folder / shell).open("w") as file:
            patch.setattr("sys.stdout", file)
            assert main(["completion", shell]) == 0
    return folder


def _proposed(scripts: Path, shell: str, line: str, folder: Path | None = None) -> set[str]:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    if shell == "zsh":
        return _of_zsh(scripts / shell, line, folder)
    text = _ASK[shell].format(script=scripts / shell, line=line, point=len(line), words=line)
    quiet = [shell, "--norc"] if shell == "bash" else [shell, "--no-config"]
    done = subprocess.run(
        [*quiet, "-c", text], capture_output=True, text=True, cwd=folder or scripts
    )
    assert done.returncode in (0, 1) and not done.stderr, done.stderr
    return {line.partition("\t")[0].strip() for line in done.stdout.splitlines()} - {""}


def _of_zsh(script: Path, line: str, folder: Path | None) -> set[str]:
    """What a zsh in a pseudo terminal lists; it completes in an interactive shell only."""
    start = (
        "LISTMAX=0; unset zle_bracketed_paste; unsetopt PROMPT_SP; autoload -U compinit; compinit -u -D; "
        f"zstyle ':completion:*' verbose no; source {script}; stty cols 300; PROMPT=REA'DY '"
    )
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder or script.parent)
        os.environ["TERM"] = "dumb"
        os.execlp("zsh", "zsh", "-f", "-i")
    try:
        os.write(terminal, f"{start}\n".encode())
        _read_until(terminal, "READY")
        os.write(terminal, line.encode() + b"\x04")  # ctrl-D at the end of a line lists
        os.write(terminal, b"\x15print -n 'EN'; print D\n")
        listed = _read_until(terminal, "END").rpartition("print -n")[0].split()
        return {*listed} - {*line.split(), "READY"}
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(terminal)


def _read_until(terminal: int, word: str) -> str:
    text, deadline_s = "", time.monotonic() + 20
    while word not in text and time.monotonic() < deadline_s:
        if select.select([terminal], [], [], 1.0)[0]:
            text += os.read(terminal, 65536).decode(errors="replace")
    assert word in text, text
    return text


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize(("line", "expected"), _LINES)
def test_a_shell_proposes_options_and_values(scripts: Path, shell: str, line: str, expected):
    assert _proposed(scripts, shell, line) == expected


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_sources_and_paths(scripts: Path, shell: str, tmp_path: Path):
    (tmp_path / "desk").mkdir()
    (tmp_path / "note.txt").touch()
    prefix = "" if shell == "bash" else "synth:"  # bash takes : for the end of a word
    rooms = _proposed(scripts, shell, "hsslam-serve --source synth:ro", tmp_path)
    assert rooms == {f"{prefix}room"}
    places = _proposed(scripts, shell, "hsslam-serve --source tum:d", tmp_path)
    assert any(place.endswith(("desk", "desk/")) for place in places), places
    folders = _proposed(scripts, shell, "hsslam-serve --out ", tmp_path)
    assert {folder.rstrip("/") for folder in folders} == {"desk"}
    given = _proposed(scripts, shell, "hsslam-serve --config no", tmp_path)
    assert given == {"note.txt"}


def test_every_command_and_every_option_is_known(scripts: Path):
    programs = {name for name in OPTIONS if " " not in name}
    assert programs == {"hsslam", *(f"hsslam-{name}" for name in COMMANDS)}
    for shell in ("bash", "zsh", "fish"):
        text = (scripts / shell).read_text()
        for command in OPTIONS:
            for option in options_of(command):
                name = option.flag if shell != "fish" else f"-l {option.flag[2:]}"
                assert option.is_positional or name in text


def test_an_unknown_shell_is_one_line(capsys: pytest.CaptureFixture[str]):
    assert main(["completion", "fsh"]) == 2
    expected = "error: SHELL fsh: expected bash or zsh or fish; did you mean fish?\n"
    assert capsys.readouterr().err == expected
