"""Completions at each place of a command line, for all shells."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from hsslam_node.sources.source_row import source_examples
from hsslam_services.commands.all_options import options_of, subcommands
from hsslam_services.commands.options.config_file import camera_names
from hsslam_services.commands.options.help_text import own_options
from hsslam_services.commands.options.option_table import Option
from hsslam_services.run.source_table import ALL_SOURCES

_FOLDERS = ("FOLDER", "DIR")
_FILES = ("FILE", "MAP", "IN", "OUT", "[RUN]", "JSON")
_PLACES = ("FOLDER", "FILE", "FILE.sens", "RUN")  # in an example, for a path
_EXAMPLES = source_examples(ALL_SOURCES)
PATH_KINDS = tuple(  # sources that a path follows
    dict.fromkeys(
        kind for kind, _, place in (e.partition(":") for e in _EXAMPLES) if place in _PLACES
    )
)


@dataclass(frozen=True)
class Values:
    """The values of an option or a positional."""

    paths: Literal["none", "file", "folder"]
    words: tuple[str, ...]  # a word that ends in : is the start of a value
    is_list: bool


@dataclass(frozen=True)
class CompletedOption:
    """One option and its values; None for a switch."""

    flags: tuple[str, ...]
    help: str
    values: Values | None


@dataclass(frozen=True)
class Completed:
    """One command: its options, its subcommands, the values of its first positional."""

    command: str  # as hsslam-log info
    options: tuple[CompletedOption, ...]
    subcommands: tuple[str, ...]
    positional: Values | None


def completed(command: str) -> Completed:
    """All completions after this command."""
    table = options_of(command)
    positionals = [option for option in table if option.is_positional]
    options = [
        CompletedOption(_flags(option), _first_words(option.help), _values(option))
        for option in table
        if not option.is_positional
    ]
    own = [
        CompletedOption(tuple(names.split(", ")), text, None) for names, text in own_options(table)
    ]
    return Completed(
        command=command,
        options=(*own, *options),
        subcommands=tuple(subcommands(command)),
        positional=_values(positionals[0]) if positionals else None,
    )


def _flags(option: Option) -> tuple[str, ...]:
    alias = (option.alias,) if option.alias else ()
    return (*alias, option.flag, *([option.off_flag] if option.is_switch else []))


def _values(option: Option) -> Values | None:
    if option.is_switch:
        return None
    word = option.value.removesuffix("...")
    paths = "folder" if word in _FOLDERS else "file" if word in _FILES else "none"
    words: Sequence[str] = option.words
    if word == "SOURCE":
        named = [example for example in _EXAMPLES if example.partition(":")[2] not in _PLACES]
        words = [*named, *(f"{kind}:" for kind in PATH_KINDS)]
    if option.name == "config":
        words = [f"camera:{name}" for name in camera_names()]
    return Values(paths, tuple(words), option.is_list)


def _first_words(text: str) -> str:
    """The help, shortened to a line of a menu."""
    return text if len(text) <= 80 else f"{text[:77].rsplit(' ', 1)[0]}..."
