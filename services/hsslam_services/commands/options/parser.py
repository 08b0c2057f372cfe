"""Parses a command line with argparse; every error is one line."""

import argparse
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.user_path import user_path
from hsslam_services.commands.options.option_table import Option, option_table

_EXPECTED = {int: "a whole number", float: "a number"}


def parsed(cls: type, prog: str, args: Sequence[str]) -> dict[str, Any]:
    """The options that the command line sets, by name (`slam.tracker.points`).

    Raises:
        UserError: an unknown option (the nearest is suggested), or a value of the wrong kind.
    """
    table = option_table(cls)
    parser = _Parser(
        prog=prog,
        add_help=False,
        allow_abbrev=False,
        argument_default=argparse.SUPPRESS,
        exit_on_error=False,
    )
    for option in table:
        if not option.is_positional:
            _add(parser, option)
    try:
        found, rest = parser.parse_known_args([_dashed(arg) for arg in args])
    except argparse.ArgumentError as error:
        raise UserError(_one_line(error, table)) from None
    given = vars(found) | _positionals(prog, [arg for arg in rest if arg != "--"], table)
    return {option.name: given[option.name] for option in table if option.name in given}


class _Numbers:
    """Matches numbers that begin with a dash, also -1e-3 and -inf, which argparse takes for options."""

    @staticmethod
    def match(text: str) -> bool:
        return _is_number(text)


class _Parser(argparse.ArgumentParser):
    def __init__(self, **how: Any) -> None:
        super().__init__(**how)
        self._negative_number_matcher = _Numbers  # type: ignore[assignment]

    def error(self, message: str) -> NoReturn:
        raise UserError(message)


def _add(parser: argparse.ArgumentParser, option: Option) -> None:
    if option.is_switch:
        parser.add_argument(option.flag, dest=option.name, action="store_const", const=True)
        parser.add_argument(option.off_flag, dest=option.name, action="store_const", const=False)
        return
    how: dict[str, Any] = {"type": _reader(option)}
    if option.is_list:
        kinds = typing.get_args(option.kind)
        endless = kinds[-1] is Ellipsis
        how |= (
            {"nargs": "+", "action": _Tuples}
            if endless
            else {"nargs": len(kinds), "action": _Tuple}
        )
    names = [option.alias] if option.alias else []
    parser.add_argument(*names, option.flag, dest=option.name, **how)


class _Tuple(argparse.Action):
    """Keeps the values as a tuple."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        setattr(namespace, self.dest, tuple(values))


class _Tuples(argparse.Action):
    """Keeps the values as a tuple; an option that is given again adds to it."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        before = getattr(namespace, self.dest, ())
        setattr(namespace, self.dest, (*before, *values))


def _positionals(prog: str, rest: list[str], table: Sequence[Option]) -> dict[str, Any]:
    """The values of the positionals, in their order, anywhere on the command line."""
    for arg in rest:
        if arg.startswith("-") and len(arg) > 1 and not _is_number(arg):
            raise UserError(_unknown(prog, arg, table))
    found: dict[str, Any] = {}
    for option in (option for option in table if option.is_positional):
        if rest and option.is_list:
            found[option.name], rest = tuple(_positional(option, text) for text in rest), []
        elif rest:
            found[option.name] = _positional(option, rest.pop(0))
    if rest:
        raise UserError(_unknown(prog, rest[0], table))
    return found


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _positional(option: Option, text: str) -> Any:
    try:
        return _reader(option)(text)
    except argparse.ArgumentTypeError as error:
        raise UserError(f"{option.name.upper()} {error}") from None


def _reader(option: Option) -> Callable[[str], Any]:
    """The function that converts a word to a value of the option; argparse reports its error."""
    kind = typing.get_args(option.kind)[0] if option.is_list else option.kind
    literals = {str(value): value for value in typing.get_args(kind)}

    def read(text: str) -> Any:
        if option.can_be_none and text.lower() == "none":
            return None
        if literals and text not in literals:
            hint = "" if text.isdigit() else did_you_mean(text, literals)
            raise argparse.ArgumentTypeError(f"{text}: expected {' or '.join(literals)}{hint}")
        if literals:
            return literals[text]
        try:
            return user_path(text) if kind is Path else kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text}: expected {_EXPECTED[kind]}") from None

    return read


def _dashed(arg: str) -> str:
    """Accept --log_part_mb for --log-part-mb."""
    name, equals, value = arg.partition("=")
    return f"{name.replace('_', '-')}{equals}{value}" if arg.startswith("--") else arg


def _one_line(error: argparse.ArgumentError, table: Sequence[Option]) -> str:
    name = (error.argument_name or "").rpartition("/")[2]
    if ": expected" in error.message:  # by a reader above
        return f"{name} {error.message}"
    option = next((option for option in table if option.flag == name), None)
    if option is None:
        return f"{name}: {error.message}"
    wanted = f"{name} {option.value}" if option.value else f"{name} alone"
    return f"{name}: {'missing value' if option.value else 'value'}: expected {wanted}"


def _unknown(prog: str, arg: str, table: Sequence[Option]) -> str:
    name = arg.partition("=")[0]
    known = [option.flag for option in table if not option.is_positional]
    if not name.startswith("-"):
        valued = (option for option in table if not option.is_positional and option.value)
        if (example := next(valued, None)) is None:
            return f"{arg}: one argument too many; see {prog} --help"
        return f"{arg}: expected an option, as {example.flag} {example.value}; see {prog} --help"
    if name in known:  # after --
        return f"{name}: is taken for a value, as it stands after --: expected it before --"
    same_leaf = [flag for flag in known if flag.endswith("." + name.lstrip("-"))]
    hint = did_you_mean(name, same_leaf or known, cutoff=0.0 if same_leaf else 0.5)
    return f"{name}: unknown option{hint or f'; see {prog} --help'}"
