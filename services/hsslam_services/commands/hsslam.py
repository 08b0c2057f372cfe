"""`hsslam`: lists the commands and completes them; `hsslam NAME ...` is `hsslam-NAME ...`."""

import importlib
import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from hsslam_node import __version__
from hsslam_node.errors import UserError, did_you_mean
from hsslam_services.commands.cli import exit_code

_PROG = "hsslam"
_COMPLETION = "completion"
COMMANDS = {  # name: module, description; pyproject.toml registers the same names
    "serve": ("hsslam_services.commands.serve", "tracks a camera, builds a mesh, logs the run"),
    "ctl": (
        "hsslam_services.commands.ctl",
        "controls a running service: status, mesh, save, pause, stop, ...",
    ),
    "doctor": ("hsslam_services.commands.doctor", "checks a camera or a recording before a run"),
    "log": ("hsslam_services.commands.log.command", "shows, recovers, trims and exports logs"),
    "replay": ("hsslam_services.commands.log.replay", "publishes a log again"),
    "map": (
        "hsslam_services.commands.maps.command",
        "queries, exports and merges saved maps",
    ),
    "mesh": ("hsslam_services.commands.maps.mesh", "makes a mesh of a saved map"),
    "render": ("hsslam_services.commands.maps.render", "renders images of a saved map"),
    "eval": (
        "hsslam_services.commands.evaluate.command",
        "scores a run, or a trajectory and a mesh",
    ),
    "certs": ("hsslam_services.commands.certs", "makes certificates for other machines"),
    "batch": ("hsslam_batch.__main__", "processes thousands of logs, on one machine or a cluster"),
    "bench": ("hsslam_bench.__main__", "measures the figures of the README"),
}


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; the exit code is that of the command, 2 if there is no such command."""
    return exit_code(lambda: _hsslam(sys.argv[1:] if args is None else args), hears_signals=False)


def _hsslam(args: Sequence[str]) -> int | None:
    name = args[0] if args else "--help"
    if name == "--version":
        print(f"{_PROG} {__version__}")
    elif name in ("-h", "--help"):
        _show_commands()
    elif name == _COMPLETION:
        from hsslam_services.commands.completion.command import completion_command

        completion_command(args[1:])
    elif name.removeprefix("hsslam-") in COMMANDS:
        return _run(name.removeprefix("hsslam-"), args[1:])
    else:
        known = [*COMMANDS, _COMPLETION]
        raise UserError(f"{name}: expected one of {', '.join(known)}{did_you_mean(name, known)}")
    return None


def _run(name: str, args: Sequence[str]) -> int | None:
    module = importlib.import_module(COMMANDS[name][0])
    sys.argv = [f"hsslam-{name}", *args]
    return module.main()


def _show_commands() -> None:
    print(f"usage: {_PROG} COMMAND ...; each command has its own --help\n")
    table = Table.grid(padding=(0, 2))
    for name, (_, purpose) in COMMANDS.items():
        table.add_row(f"hsslam-{name}", purpose)
    table.add_row(
        f"{_PROG} {_COMPLETION}", "prints a script that completes the commands in your shell"
    )
    Console(highlight=False).print(table)


if __name__ == "__main__":
    sys.exit(main())
