"""Shared parts of the commands: options from the command line, exit codes, a progress bar."""

import contextlib
import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NoReturn, TextIO, TypeVar

from rich.console import Console
from rich.progress import Progress, ProgressColumn

from hsslam_node import __version__
from hsslam_node.device.gpu_memory import gpu_memory_errors
from hsslam_node.errors import OUT_OF_MEMORY, STORAGE_FAILS, UserError, did_you_mean
from hsslam_services.commands.options.help_text import print_help
from hsslam_services.commands.options.layers import merged
from hsslam_services.commands.options.parser import parsed
from hsslam_services.run.stop_signals import hear_stop_signals

_Options = TypeVar("_Options")
Subcommand = Callable[[Sequence[str]], int | None]
"""Takes the arguments after its name; returns its exit code, None for 0."""
_EXIT_CODES = "Exit codes: 0 if it is done, 1 if the command is interrupted, 2 if the input is bad."

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_NO_PATH = {  # faults of paths that a user names; what is expected instead
    errno.EACCES: "a file or folder that this user may open",
    errno.EPERM: "a file or folder that this user may open",
    errno.EROFS: "a folder that can be written",
    errno.ENAMETOOLONG: "a shorter path",
    errno.ELOOP: "a path without a loop of links",
}
_PIPE_COLUMNS = 400  # of a table that goes to a file or another program
_STREAMS = {"stdin": "r", "stdout": "w", "stderr": "w"}

QUESTIONS = ("-h", "--help", "--help-all", "--version")


def parse_options(
    cls: type[_Options], prog: str, args: Sequence[str], default: _Options | None = None
) -> _Options:
    """The options of this command line over the defaults; `--help`, `--version` print and exit with 0.

    Raises:
        UserError: an unknown option (the nearest is suggested), or a bad value.
    """
    start = cls() if default is None else default
    answer_questions(cls, prog, args, start)
    return merged(start, (), parsed(cls, prog, args))


def answer_questions(cls: type, prog: str, args: Sequence[str], default: object) -> None:
    """Print help or version and exit with code 0, if the command line asks for it."""
    if "--version" in args:
        print(f"{prog} {__version__}")
    elif {"-h", "--help", "--help-all"} & {*args}:
        print_help(cls, prog, default, everything="--help-all" in args)
    else:
        return
    raise SystemExit(0)


def run_subcommand(
    prog: str,
    purpose: str,
    commands: Mapping[str, tuple[Subcommand, str]],
    args: Sequence[str],
    exit_codes: str = _EXIT_CODES,
) -> int | None:
    """Run the subcommand that the first argument names; `commands`: function and description, by name.

    `exit_codes`: their line in the help (empty: each command has its own).

    Raises:
        UserError: there is no such subcommand.
    """
    name, rest = (args[0] if args else "--help"), args[1:]
    if name in ("-h", "--help"):
        print(f"usage: {prog} {'|'.join(commands)} ...\n\n{purpose}")
        for command, (_, what) in commands.items():
            print(f"  {prog} {command:<10}{what}")
        print("", *filter(None, [exit_codes]), "Each command has its own --help.", sep="\n")
    elif name == "--version":
        print(f"{prog} {__version__}")
    elif name in commands:
        return commands[name][0](rest)
    else:
        known = list(commands)
        raise UserError(f"{name}: expected {', '.join(known)}{did_you_mean(name, known)}")
    return None


def exit_code(command: Callable[[], int | None], *, hears_signals: bool = True) -> int:
    """Run the command and return its exit code (0 for None), 1 if it is interrupted, its output is closed or
    the disk is full, 2 on bad input, too little memory or a path that cannot be opened. All of these but a
    closed output are reported in one line on stderr.

    hears_signals: SIGTERM and SIGHUP interrupt the command, as SIGINT does, so that it removes its temporary
        files; False if it has handlers of its own.
    """
    with _stop_signals_interrupt() if hears_signals else contextlib.nullcontext():
        return _exit_code(command)


@contextlib.contextmanager
def _stop_signals_interrupt() -> Iterator[None]:
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL  # of a command that runs this one
    ):
        yield
        return
    before = hear_stop_signals(_interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(_: int) -> NoReturn:
    raise KeyboardInterrupt


def _exit_code(command: Callable[[], int | None]) -> int:
    _open_closed_streams()
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="surrogateescape")  # paths need not be UTF-8
    try:
        try:
            with gpu_memory_errors():
                return command() or 0
        finally:
            sys.stdout.flush()
    except UserError as error:
        _tell(f"error: {error}")
        return 2
    except MemoryError as error:
        _tell(f"error: {OUT_OF_MEMORY}: {error}".rstrip(": "))
        return 2
    except KeyboardInterrupt:
        _tell("interrupted")
        return 1
    except OSError as error:
        if error.errno in _NO_ROOM:
            where = error.filename or "output"
            _tell(f"error: {where}: {error.strerror}: expected room to write")
        elif error.errno in STORAGE_FAILS:
            where = error.filename or "a file"
            _tell(f"error: {where}: {error.strerror}: expected a disk and a network that work")
            return 2
        elif error.filename and error.errno in _NO_PATH:
            _tell(f"error: {error.filename}: {error.strerror}: expected {_NO_PATH[error.errno]}")
            return 2
        elif not isinstance(error, BrokenPipeError):
            raise
        _discard(sys.stdout)
        return 1


def print_at_end(text: str) -> None:
    """Print a line on stdout; a full disk or a closed pipe does not change the exit code."""
    try:
        print(text, flush=True)
    except OSError:
        _discard(sys.stdout)


def _tell(text: str) -> None:
    """Print a line on stderr; a full disk or a closed pipe does not change the exit code."""
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def _discard(stream: TextIO) -> None:
    """Send all output of a stream to /dev/null, also that in its buffer, which Python flushes at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _open_closed_streams() -> None:
    """Open /dev/null for each of stdin, stdout and stderr that is closed; child processes inherit it."""
    for name, mode in _STREAMS.items():
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)  # gets the free number
            os.set_inheritable(nowhere, True)
            setattr(sys, name, os.fdopen(nowhere, mode, errors="backslashreplace"))


def table_console() -> Console:
    """A console for tables on stdout; 400 columns wide if that is no terminal, so that no name is cut."""
    console = Console(emoji=False, highlight=False, markup=False)
    if not console.is_terminal:
        console.width = _PIPE_COLUMNS
    return console


def terminal_progress(*columns: ProgressColumn | str, file: TextIO | None = None) -> Progress:
    """A progress bar on `file` (None: stderr), removed when the work is done. Shows nothing if that is no
    terminal."""
    console = Console(file=file, stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
