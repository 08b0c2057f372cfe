"""The command line of `hsslam-serve`: the preset gives the defaults, every mistake is one line."""

import itertools
from collections.abc import Sequence

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.presets import PRESETS, PresetName
from hsslam_services.commands.cli import parse_options
from hsslam_services.run.options import ServeOptions

_PROG = "hsslam-serve"


def parse_command_line(args: Sequence[str]) -> ServeOptions:
    """The options of this command line; `--help` and `--version` print and exit with code 0.

    Raises:
        UserError: an unknown option or preset (the nearest is suggested), or a bad value.
    """
    preset = _preset(args)
    default = ServeOptions(preset=preset, slam=PRESETS[preset])
    return parse_options(ServeOptions, _PROG, args, default)


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
    raise UserError(f"--preset {name}: {expected}{did_you_mean(name, list(PRESETS))}")
