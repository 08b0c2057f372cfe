"""The command line of `hsslam-serve`: the preset gives the defaults, every mistake is one line."""

import contextlib
import dataclasses
import difflib
import io
import itertools
import typing
from collections.abc import Iterator, Sequence

import tyro

from hsslam_node import __version__
from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS, PresetName
from hsslam_node.services.options import ServeOptions

_PROG = "hsslam-serve"


def parse_command_line(args: Sequence[str]) -> ServeOptions:
    """The options of this command line; `--help` and `--version` print and exit with code 0.

    Raises:
        UserError: an unknown option or preset (the nearest is suggested), or a bad value.
    """
    if "--version" in args:
        print(f"{_PROG} {__version__}")
        raise SystemExit(0)
    preset = _preset(args)
    default = ServeOptions(preset=preset, slam=PRESETS[preset])
    if "-h" in args or "--help" in args:
        tyro.cli(ServeOptions, prog=_PROG, args=["--help"], default=default)
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            options, unknown = tyro.cli(
                ServeOptions, prog=_PROG, args=args, default=default, return_unknown_args=True
            )
    except SystemExit:
        raise UserError(_condensed(errors.getvalue())) from None
    if unknown:
        raise UserError(_unknown(unknown[0]))
    return options


def _preset(args: Sequence[str]) -> PresetName:
    """The preset named on the command line, read before everything else; the last one counts."""
    name = "realtime"
    for arg, following in itertools.zip_longest(args, args[1:], fillvalue=""):
        if arg == "--preset":
            name = following
        elif arg.startswith("--preset="):
            name = arg.partition("=")[2]
    for known in PRESETS:
        if name == known:
            return known
    expected = f"expected {' or '.join(PRESETS)}"
    raise UserError(f"--preset {name}: {expected}{_nearest(name, list(PRESETS))}")


def _unknown(arg: str) -> str:
    name = arg.partition("=")[0]
    if not name.startswith("-"):
        return f"{arg}: expected an option, as --source SOURCE; see {_PROG} --help"
    known = [f"--{option}" for option in _option_names(ServeOptions, "")]
    near = _nearest(name.replace("_", "-"), known)
    return f"{name}: unknown option{near}; see {_PROG} --help"


def _nearest(name: str, known: Sequence[str]) -> str:
    same_leaf = [option for option in known if option.endswith("." + name.lstrip("-"))]
    near = same_leaf or difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""


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
    return " ".join(blocks[0]) or "the options cannot be read: see --help"
