"""Prints `--help` and `--help-all` of a command from its table of options."""

import shutil
import textwrap
from collections.abc import Iterable, Sequence

from hsslam_services.commands.options.option_table import (
    Option,
    group_purposes,
    option_table,
    purpose,
)

_PAGE_WIDTH = 120  # characters, if the output is no terminal
_NAMES_WIDTH = 38
_NARROW_NAMES_WIDTH = 24  # below 100 characters


def print_help(cls: type, prog: str, default: object, everything: bool) -> None:
    """Print the purpose of the command and its options: the basic ones, or all."""
    table = option_table(cls, default)
    shown = [option for option in table if option.is_basic or everything]
    print(f"{usage(prog, table)}\n\n{purpose(cls)}")
    named = [option for option in shown if not option.is_positional]
    positionals = [(option.value, help_of(option)) for option in shown if option.is_positional]
    if positionals:
        _print_rows("", positionals)
    groups = {option.group: [] for option in named}
    for option in named:
        groups[option.group].append((names_of(option), help_of(option)))
    _print_rows("Options", [*own_options(table), *groups.pop("", [])])
    purposes = group_purposes(cls)
    for group, rows in groups.items():
        _print_rows(f"--{group}: {purposes[group]}", rows)
    if left_out := len(table) - len(shown):
        print(f"\n{prog} --help-all shows {left_out} more options.")


def usage(prog: str, table: Iterable[Option]) -> str:
    """`usage: hsslam-mesh MAP [options]`."""
    names = [option.value for option in table if option.is_positional]
    return " ".join(["usage:", prog, *names, "[options]"])


def own_options(table: Sequence[Option]) -> tuple[tuple[str, str], ...]:
    """The options that every command has: names, help."""
    rows = [("-h, --help", "show this help and exit")]
    if not all(option.is_basic for option in table):
        rows = [
            ("-h, --help", "show the options that most users need and exit"),
            ("--help-all", "show all options and exit"),
        ]
    return (*rows, ("--version", "show the version and exit"))


def names_of(option: Option) -> str:
    """`-o, --out FILE`, `--evaluate, --no-evaluate`, `MAP`."""
    if option.is_positional:
        return option.value
    if option.is_switch:
        return f"{option.flag}, {option.off_flag}" if option.default else option.flag
    alias = f"{option.alias}, " if option.alias else ""
    return f"{alias}{option.flag} {option.value}"


def help_of(option: Option) -> str:
    """The help text with the default."""
    default = option.default_text()
    return f"{option.help} [{default}]" if default else option.help


def _print_rows(title: str, rows: Sequence[tuple[str, str]]) -> None:
    print(f"\n{title}:" if title else "")
    width = max(shutil.get_terminal_size((_PAGE_WIDTH, 0)).columns, 60)
    left = _NAMES_WIDTH if width >= 100 else _NARROW_NAMES_WIDTH
    inner = " " * (left + 4)
    for names, text in rows:
        lines = textwrap.wrap(
            text, width, break_on_hyphens=False, initial_indent=inner, subsequent_indent=inner
        )
        if lines and len(names) <= left:
            lines[0] = f"  {names:<{left}}  {lines[0].lstrip()}"
        else:
            lines.insert(0, f"  {names}")
        print("\n".join(lines))
