"""A command or an example run in this process: a process of its own would import everything once more."""

import io
import runpy
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch


def run_script(script: Path, *arguments: str) -> "CompletedProcess[str]":
    """What the script prints, and its exit code."""
    return _run(lambda: runpy.run_path(str(script), run_name="__main__"), str(script), *arguments)


def run_main(main: Callable[[], int], *arguments: str) -> "CompletedProcess[str]":
    """What the command prints, and its exit code."""
    return _run(lambda: sys.exit(main()), "command", *arguments)


def _run(run: Callable[[], object], *argv: str) -> "CompletedProcess[str]":
    out, err, code = io.StringIO(), io.StringIO(), 0
    with patch.object(sys, "argv", list(argv)), redirect_stdout(out), redirect_stderr(err):
        try:
            run()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
            if isinstance(end.code, str):
                print(end.code, file=err)
    return CompletedProcess(list(argv), code, out.getvalue(), err.getvalue())
