"""What `ps` and /proc show of a forked process: the command line that it stands for."""

import ctypes
import os
import sys
from collections.abc import Sequence
from pathlib import Path

_PR_SET_NAME = 15
_ARG_START, _ARG_END = 45, 46  # fields of /proc/self/stat after the name


def set_process_title(name: str, command: Sequence[str]) -> None:
    """Show `name` (15 characters) and `command`; one longer than the process's own is left out."""
    ctypes.CDLL(None).prctl(_PR_SET_NAME, name.encode()[:15], 0, 0, 0)
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    start, end = int(fields[_ARG_START]), int(fields[_ARG_END])
    text = b"\0".join(os.fsencode(word) for word in command) + b"\0"
    if 0 < len(text) <= end - start:
        ctypes.memmove(start, text.ljust(end - start, b"\0"), end - start)


def module_command(module: str, run_dir: str) -> list[str]:
    """The command line of a process of a run."""
    return [sys.executable, "-m", module, "--run", run_dir]
