"""Table of the options of a command, read from its frozen dataclass: one row for each field.

A dataclass of options may have these class variables:

- `POSITIONALS`: fields given without a name, in this order;
- `BASIC`: options and groups of options that `--help` shows; without it `--help` shows all;
- `VALUES`: names of values in the help: `FILE`, `FOLDER` or `SOURCE` (the shell completes these),
  `a|b|c` for words, or any other word; by default the type gives the name;
- `ALIASES`: short names;
- `WORDS`: completions in the shell besides those of `VALUES` and the type.
"""

import ast
import dataclasses
import inspect
import re
import textwrap
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

_TYPE_WORDS = {int: "N", float: "X", str: "TEXT", Path: "FILE", bool: ""}


@dataclass(frozen=True)
class Option:
    """One option of a command."""

    name: str  # as in Python, groups with dots: slam.tracker.points
    kind: Any  # its type, without None
    can_be_none: bool
    default: Any
    described_in: type  # the dataclass that has its field
    value: str  # name of the value, "" for a switch
    is_positional: bool
    is_basic: bool
    alias: str  # such as -o, "" without one
    known_words: tuple[str, ...] = ()  # some of its values

    @property
    def flag(self) -> str:
        """The flag, as --slam.tracker.points."""
        return flag_of(self.name)

    @property
    def off_flag(self) -> str:
        """The flag that turns a switch off, as --no-evaluate, --slam.ba.no-enabled."""
        return off_flag_of(self.name)

    @property
    def help(self) -> str:
        """What it does, on one line; the first use parses the source of the dataclass."""
        return _attribute_docstrings(self.described_in).get(self.name.rpartition(".")[2], "")

    @property
    def group(self) -> str:
        """slam.tracker for slam.tracker.points; "" without a group."""
        return self.name.rpartition(".")[0]

    @property
    def is_switch(self) -> bool:
        """Whether it takes no value."""
        return self.kind is bool

    @property
    def is_list(self) -> bool:
        """Whether it takes several values."""
        return typing.get_origin(self.kind) is tuple

    @property
    def words(self) -> tuple[str, ...]:
        """The known values; a word that ends in : is the start of a value."""
        found = self.known_words or tuple(map(str, _literals(self.kind)))
        if found or "|" not in self.value:
            return found
        return tuple(re.sub("[A-Z]+$", "", word) for word in self.value.split("|"))

    def default_text(self) -> str:
        """The default as on the command line; "" if it is None, empty or off, or no path (`Path()`)."""
        value = self.default
        if value is None or value is False or value in ((), "", Path()):
            return ""
        if value is True:
            return "on"
        return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def flag_of(name: str) -> str:
    """The flag of the option of this name, as --slam.tracker.points."""
    return f"--{name.replace('_', '-')}"


def off_flag_of(name: str) -> str:
    """The flag that turns the switch of this name off, as --no-evaluate, --slam.ba.no-enabled."""
    group, dot, leaf = name.rpartition(".")
    return flag_of(f"{group}{dot}no-{leaf}")


def option_table(cls: type, default: Any = None) -> list[Option]:
    """All options of this dataclass and its groups; defaults are the values of `default` (None: `cls()`)."""
    shown = getattr(cls, "BASIC", None)
    start = cls() if default is None else default
    return [
        dataclasses.replace(option, is_basic=shown is None or _is_named(option.name, shown))
        for option in _options(cls, start, "", getattr(cls, "VALUES", {}))
    ]


def group_purposes(cls: type, prefix: str = "") -> dict[str, str]:
    """The first sentence of each group's docstring, by the name of the group."""
    found: dict[str, str] = {}
    for name, (kind, _) in _fields(cls).items():
        if _is_group(kind):
            text = " ".join(inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())
            found[prefix + name] = text.rstrip(".")
            found |= group_purposes(kind, f"{prefix}{name}.")
    return found


def purpose(cls: type) -> str:
    """The docstring of a dataclass of options for the help: without `Raises`, with its `EPILOGUE`."""
    text = inspect.cleandoc(cls.__doc__ or "").partition("\n\nRaises:")[0]
    return "\n\n".join(part for part in (text, getattr(cls, "EPILOGUE", "")) if part)


def _options(cls: type, start: Any, prefix: str, values: Mapping[str, str]) -> Iterator[Option]:
    positionals = getattr(cls, "POSITIONALS", ())
    for name, (kind, can_be_none) in _fields(cls).items():
        if _is_group(kind):
            yield from _options(kind, getattr(start, name), f"{prefix}{name}.", values)
            continue
        yield Option(
            name=prefix + name,
            kind=kind,
            can_be_none=can_be_none,
            default=getattr(start, name),
            described_in=cls,
            value=values.get(prefix + name) or _value_word(kind),
            is_positional=not prefix and name in positionals,
            is_basic=True,
            alias=getattr(cls, "ALIASES", {}).get(name, ""),
            known_words=getattr(cls, "WORDS", {}).get(name, ()),
        )


@cache
def _fields(cls: type) -> dict[str, tuple[Any, bool]]:
    """Type of each field without None, and whether it can be None."""
    hints = typing.get_type_hints(cls)
    return {field.name: _without_none(hints[field.name]) for field in dataclasses.fields(cls)}


def _without_none(kind: Any) -> tuple[Any, bool]:
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        (left,) = (part for part in typing.get_args(kind) if part is not type(None))
        return left, True
    return kind, False


def _is_group(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


def _is_named(name: str, names: typing.Iterable[str]) -> bool:
    """Whether the option, or a group that it is in, is among the names."""
    return any(name == one or name.startswith(f"{one}.") for one in names)


def _literals(kind: Any) -> tuple[Any, ...]:
    if typing.get_origin(kind) is tuple:
        kind = typing.get_args(kind)[0]
    return typing.get_args(kind) if typing.get_origin(kind) is Literal else ()


def _value_word(kind: Any) -> str:
    if typing.get_origin(kind) is tuple:
        one, *more = typing.get_args(kind)
        word = _value_word(one)
        return f"{word}..." if more == [Ellipsis] else " ".join([word] * (1 + len(more)))
    if literals := _literals(kind):
        return "|".join(map(str, literals))
    return _TYPE_WORDS[kind]


@cache
def _attribute_docstrings(cls: type) -> dict[str, str]:
    """The string below each field, on one line."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
    (definition,) = (node for node in tree.body if isinstance(node, ast.ClassDef))
    found = {}
    for field, text in zip(definition.body, definition.body[1:], strict=False):
        match field, text:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(help_text))),
            ):
                found[name] = " ".join(help_text.split())
    return found
