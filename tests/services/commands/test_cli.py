"""How commands end."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.cli import exit_code

_TELLS = """
import os, subprocess, sys
from hsslam_services.commands.cli import exit_code
sys.exit(exit_code(lambda: {}))
"""


def _raises(error: BaseException):
    raise error


@pytest.mark.parametrize(
    ("command", "code", "told"),
    [
        (lambda: None, 0, ""),
        (lambda: 3, 3, ""),
        (lambda: _raises(UserError("--a 1: expected 2")), 2, "error: --a 1: expected 2\n"),
        (lambda: _raises(MemoryError("9 GiB")), 2, "error: out of memory: 9 GiB\n"),
        (lambda: _raises(MemoryError()), 2, "error: out of memory\n"),
        (lambda: _raises(KeyboardInterrupt()), 1, "interrupted\n"),
        (
            lambda: _raises(PermissionError(errno.EACCES, "Permission denied", "a/run.mcap")),
            2,
            "error: a/run.mcap: Permission denied: expected a file or folder that this user may open\n",
        ),
    ],
)
def test_the_code_and_one_line(command, code, told, capsys):
    assert exit_code(command) == code
    assert capsys.readouterr().err == told


def test_a_path_that_is_not_utf8_is_printed_as_it_is():
    program = _TELLS.format("print(os.fsdecode(b'desk\\xff'))")
    environment = os.environ | {"PYTHONIOENCODING": "utf-8:strict"}
    run = [sys.executable, "-c", program]
    done = subprocess.run(run, capture_output=True, env=environment, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"desk\xff\n", b"")


@pytest.mark.parametrize("numbers", [["SIGTERM"], ["SIGHUP"], ["SIGHUP", "SIGTERM"], ["SIGINT"]])
def test_a_stop_signal_leaves_no_temporary_file(tmp_path, numbers):
    sends = "".join(f"        signal.raise_signal(signal.{number})\n" for number in numbers)
    program = f"""
import signal, sys
from hsslam_node.durable_file import durable_file
from hsslam_services.commands.cli import exit_code
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)  # a shell may have them ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
def command():
    with durable_file("whole"):
{sends}
sys.exit(exit_code(command))
"""
    run = [sys.executable, "-c", program]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (1, "interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["print('few')", "print('many' * 10**6)", "[print(), exit()]"])
def test_nobody_who_reads_is_no_traceback(command):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-c", _TELLS.format(command)],
        stdout=writer, stderr=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize("command", ["print('few')", "print('many' * 10**6)", "[print(), exit()]"])
def test_a_full_disk_is_one_line(command):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", _TELLS.format(command)],
            stdout=full, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    told = "error: output: No space left on device: expected room to write\n"
    assert (done.returncode, done.stderr) == (1, told)


def test_a_message_that_cannot_be_written_does_not_change_the_code():
    program = _TELLS.format("open('x' * 300)")
    with Path("/dev/full").open("w") as full:
        assert subprocess.call([sys.executable, "-c", program], stderr=full) == 2


def test_streams_that_are_closed_go_nowhere_also_those_of_child_processes():
    tells = "[print(1), print(2, file=sys.stderr), sys.stdin.read()]"
    child = (
        "subprocess.call([sys.executable, '-c', 'import os; print([*map(os.fstat, range(3))])'])"
    )
    program = _TELLS.format(f"{tells} and {child}")
    closed = 'exec "$@" <&- >&- 2>&-'
    assert subprocess.call(["sh", "-c", closed, "sh", sys.executable, "-c", program]) == 0
