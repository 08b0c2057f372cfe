"""Generates docs/cli.md, all commands and options, from the dataclasses of options, like `--help-all`.

`make docs-update` (cog) calls it.
"""

from collections.abc import Iterator, Sequence

from hsslam_node.environment import environment_table
from hsslam_services.commands.all_options import OPTIONS, options_class, options_of, subcommands
from hsslam_services.commands.hsslam import COMMANDS
from hsslam_services.commands.options.config_file import camera_names
from hsslam_services.commands.options.help_text import names_of, own_options, usage
from hsslam_services.commands.options.option_table import Option, group_purposes, purpose
from hsslam_services.commands.rescue import RESCUE_HELP
from hsslam_services.commands.warm_up import WARM_UP_HELP

_HEAD = """\
Every command has `--help` and `--version`. `hsslam NAME` is the same as `hsslam-NAME`. A command reports a
wrong option or value in one line and exits with code 2. `hsslam completion bash|zsh|fish` prints a script
that completes commands, options and values.

## Files of options

`hsslam-serve --config FILE.toml` reads options from a file. The names are those of the command line, with `_`
for `-` and a table for each group:

```toml
source = "record:desk"
pace = "lockstep"

[camera]
fx = 525.0
depth_scale = 1000.0

[slam.tracker]
points = 1500
```

Every run writes its effective options to `config.toml` in the run folder. `--config runs/desk` (or
`--config runs/desk/config.toml`) repeats the run. The file does not contain `out`, so a repeated run gets a
new folder and never overwrites the old one. It does not contain `config` or options without a value either.
Relative paths in a file start at the working folder.

Options on the command line win over files, a later file wins over an earlier one, files win over the preset.
A file that names its preset cannot be combined with another `--preset`.

The defaults of the `--slam` options below are those of preset `realtime`. `hsslam-serve --preset paper
--help-all` shows those of another preset.

`--config camera:NAME` reads the published calibration of a camera for `record:FOLDER`: {cameras}.
`--config camera:kinect-v1 --camera.depth-scale 5000` changes one value of it.

"""


_OWN_HELP = {"hsslam-serve warm-up": WARM_UP_HELP, "hsslam-serve rescue": RESCUE_HELP}


def reference() -> str:
    """The whole document."""
    cameras = ", ".join(f"`camera:{name}`" for name in camera_names())
    parts = [
        _HEAD.format(cameras=cameras),
        f"## Environment variables\n\n{environment_table()}\n\n",
        "## hsslam\n\n| command | what it does |\n| --- | --- |\n",
    ]
    parts += [
        f"| [`hsslam-{name}`](#hsslam-{name}) | {text} |\n" for name, (_, text) in COMMANDS.items()
    ]
    for command in list(OPTIONS)[1:]:
        parts.append("\n".join(_section(command)) + "\n")
    return "".join(parts).rstrip("\n") + "\n"


def _section(command: str) -> Iterator[str]:
    yield from ("", f"{'###' if ' ' in command else '##'} {command}", "")
    cls = options_class(command)
    if cls is None:
        below = " | ".join(subcommands(command))
        yield from (
            "```text",
            _OWN_HELP.get(command, f"usage: {command} {below} ..."),
            "```",
        )
        return
    table = options_of(command)
    yield from ("```text", usage(command, table), "", purpose(cls), "```", "")
    purposes = group_purposes(cls)
    groups: dict[str, list[Option]] = {"": []}
    for option in table:
        groups.setdefault(option.group, []).append(option)
    for group, options in groups.items():
        if group:
            yield from ("", f"**`--{group}`**: {_cell(purposes[group])}", "")
        own = () if group else own_options(table)
        yield from _rows(options, own)


def _rows(options: Sequence[Option], own: Sequence[tuple[str, str]]) -> Iterator[str]:
    yield from ("| option | | default |", "| --- | --- | --- |")
    for option in options:
        default = option.default_text()
        yield f"| `{_cell(names_of(option))}` | {_cell(option.help)} | {f'`{default}`' if default else ''} |"
    for names, text in own:
        yield f"| `{names}` | {text} | |"


def _cell(text: str) -> str:
    """The text, escaped for a cell of a table."""
    return text.replace("|", "\\|").replace("<", "&lt;")
