"""The command line of `hsslam-serve`: a preset gives the defaults, files of options override them."""

from collections.abc import Mapping, Sequence
from typing import Any

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.presets import PRESETS
from hsslam_services.commands.cli import QUESTIONS, answer_questions
from hsslam_services.commands.options.layers import Layer, merged
from hsslam_services.commands.options.parser import parsed
from hsslam_services.run.options import ServeOptions

_PROG = "hsslam-serve"
_SUBCOMMANDS = ("warm-up", "rescue")  # `serve` runs them


def parse_command_line(args: Sequence[str]) -> ServeOptions:
    """The options of this command line; `--help` and `--version` print and exit with code 0.

    The command line wins over files (`--config`, the last one first), files win over the preset.

    Raises:
        UserError: an unknown option or preset (the nearest is suggested), or a bad value.
    """
    word = next(iter(args), "-")
    if not word.startswith("-") and (hint := did_you_mean(word, _SUBCOMMANDS)):
        raise UserError(f"{word}: expected options{hint}")
    given = parsed(ServeOptions, _PROG, [arg for arg in args if arg not in QUESTIONS])
    layers = _layers(given.get("config", ()))
    preset = _preset(given, layers)
    default = ServeOptions(preset=preset, slam=PRESETS[preset])
    answer_questions(ServeOptions, _PROG, args, default)
    return merged(default, layers, given)


def _layers(places: Sequence[str]) -> list[Layer]:
    if not places:
        return []
    from hsslam_services.commands.options.config_file import read_layer  # most runs need none
    from hsslam_services.commands.options.option_table import option_table

    table = option_table(ServeOptions)
    return [read_layer(place, table) for place in places]


def _preset(given: Mapping[str, Any], layers: Sequence[Layer]) -> Any:
    """The preset that gives the defaults.

    If a file names its preset, as config.toml of a run does, its values are for that preset: another preset
    on the command line would change only the name.
    """
    named = [layer for layer in layers if "preset" in layer.values]
    of_files = named[-1].values["preset"] if named else "realtime"
    preset = given.get("preset", of_files)
    if named and preset != of_files:
        raise UserError(
            f"--preset {preset}: {named[-1].place} is for preset {of_files}: expected --preset {of_files}, "
            "or a file without a preset"
        )
    return preset
