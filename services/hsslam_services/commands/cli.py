"""A command line into a frozen dataclass of options: every mistake is one line.

How every command ends: what went wrong is one line on stderr, and a code.

A progress bar that is seen on a terminal only.
"""

import contextlib
import dataclasses
import io
import os
import re
import sys
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import tyro
from rich.console import Console
from rich.progress import Progress, ProgressColumn

from hsslam_node import __version__
from hsslam_node.errors import UserError, did_you_mean

_Options = TypeVar("_Options")
_NO_NUMBER = {
    r"invalid literal for int\(\) with base 10: '(.*)'": "a whole number",
    r"could not convert string to float: '(.*)'": "a number",
    r"no type matching \{None\}\|INT could be instantiated from \['(.*)'\]\.": "a whole number",
    r"no type matching \{None\}\|FLOAT could be instantiated from \['(.*)'\]\.": "a number",
}


def parse_options(
    cls: type[_Options], prog: str, args: Sequence[str], default: _Options | None = None
) -> _Options:
    """The options of this command line, over the defaults; `--help`, `--version` print and exit with 0.

    Raises:
        UserError: an unknown option (the nearest is suggested), or a bad value.
    """
    if "--version" in args:
        print(f"{prog} {__version__}")
        raise SystemExit(0)
    start = cls() if default is None else default
    if "-h" in args or "--help" in args:
        tyro.cli(cls, prog=prog, args=["--help"], default=start)
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            options, unknown = tyro.cli(
                cls, prog=prog, args=args, default=start, return_unknown_args=True
            )
    except SystemExit:
        raise UserError(_condensed(errors.getvalue())) from None
    if unknown:
        raise UserError(_unknown(cls, prog, unknown[0]))
    return options


def _unknown(cls: type, prog: str, arg: str) -> str:
    name = arg.partition("=")[0]
    known = [f"--{option}" for option in _option_names(cls, "")]
    if not name.startswith("-"):
        example = f"as {known[0]} {known[0].lstrip('-').upper()}"
        return f"{arg}: expected an option, {example}; see {prog} --help"
    dashed = name.replace("_", "-")
    same_leaf = [option for option in known if option.endswith("." + dashed.lstrip("-"))]
    hint = did_you_mean(dashed, same_leaf or known, cutoff=0.0 if same_leaf else 0.5)
    hint = hint or f"; see {prog} --help"
    return f"{name}: unknown option{hint}"


def _option_names(cls: type, prefix: str) -> Iterator[str]:
    for name, kind in typing.get_type_hints(cls).items():
        dashed = prefix + name.replace("_", "-")
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            yield from _option_names(kind, dashed + ".")
        elif name in {f.name for f in dataclasses.fields(cls)}:
            yield dashed


def _condensed(text: str) -> str:
    """The message inside tyro's box, on one line."""
    lines = [line.strip(" │╭╮╰╯─-") for line in text.splitlines()]
    blocks: list[list[str]] = [[]]
    for line in lines[1:]:
        if line:
            blocks[-1].append(line)
        elif blocks[-1]:
            blocks.append([])
    return _plain(" ".join(blocks[0])) or "the options cannot be read: see --help"


def _plain(text: str) -> str:
    """A value that is no number, told without the names that Python has for numbers."""
    for pattern, expected in _NO_NUMBER.items():
        if found := re.fullmatch(rf"Error parsing (\S+): {pattern}", text):
            return f"{found[1]} {found[2]}: expected {expected}"
    return text


def exit_code(command: Callable[[], int | None]) -> int:
    """The command's own code, 0 where it has none; 1: interrupted, or nobody reads its output any more;
    2: bad input."""
    try:
        try:
            return command() or 0
        finally:
            sys.stdout.flush()
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 1
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # for what is flushed at the end
        return 1


def terminal_progress(*columns: ProgressColumn | str) -> Progress:
    """On stderr, and gone when the work is done; elsewhere nothing, as even an empty bar leaves a line."""
    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
