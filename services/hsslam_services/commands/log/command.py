"""`hsslam-log info|recover|trim|export`: shows, repairs, copies and exports logs."""

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.commands.cli import (
    Subcommand,
    exit_code,
    parse_options,
    run_subcommand,
    table_console,
)
from hsslam_services.commands.log.options import (
    ExportOptions,
    InfoOptions,
    RecoverOptions,
    TrimOptions,
)
from hsslam_services.commands.output_files import print_written
from hsslam_services.log.reading.files import expect_closed, log_files, log_parts
from hsslam_services.log.recovery import recover

_PROG = "hsslam-log"
_PURPOSE = "Shows, repairs, copies and exports logs."


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; exit code 0, 1 on interruption, 2 on bad input, reported in one line."""
    given = sys.argv[1:] if args is None else args
    return exit_code(lambda: run_subcommand(_PROG, _PURPOSE, _COMMANDS, given))


def _info(args: Sequence[str]) -> None:
    from hsslam_services.commands.log.info import log_info

    options = parse_options(InfoOptions, f"{_PROG} info", args)
    if not options.files:
        raise UserError("info: no log: expected FILE...")
    console = table_console()
    for place in options.files:
        for shown in log_info(log_parts(place, _echo)):
            console.print(shown, soft_wrap=isinstance(shown, Text))


def _recover(args: Sequence[str]) -> None:
    options = parse_options(RecoverOptions, f"{_PROG} recover", args)
    refused: list[str] = []
    for path in log_files(_given("recover", "FILE", options.file)):
        try:
            expect_closed(path)
            with Console(stderr=True, markup=False).status(f"checking {path}"):
                recovered = recover(path)
            print(f"{path}: {recovered.line()}")
        except UserError as error:
            refused.append(str(error))
        except OSError as error:
            refused.append(f"{path}: {error.strerror}: expected a log such as run.mcap")
    if refused:
        raise UserError("; ".join(refused))


def _trim(args: Sequence[str]) -> None:
    from hsslam_services.commands.log.trim import trim

    options = parse_options(TrimOptions, f"{_PROG} trim", args)
    files = log_parts(_given("trim", "IN", options.log), _echo)
    out = user_path(_given("trim", "OUT", options.out))
    count = trim(files, out, options.start, options.end)
    print_written(out, f"{count} messages")


def _export(args: Sequence[str]) -> None:
    from hsslam_services.commands.log.export import export

    options = parse_options(ExportOptions, f"{_PROG} export", args)
    place = user_path(_given("export", "FILE", options.file))
    files = log_parts(place, _echo)
    is_empty = True
    for line in export(files, options.out or _beside(place), options.only, _echo, options.format):
        print(line)
        is_empty = False
    if is_empty:
        raise UserError(f"--only {' '.join(options.only)}: expected something that {place} has")


def _beside(place: Path) -> Path:
    """The folder of the export, beside the log or run folder; links are resolved for its name."""
    whole = place.resolve()
    parent = whole.parent if place.name in ("", "..") else place.parent
    return parent / f"{whole.name if whole.is_dir() else whole.stem}-export"


def _given(command: str, what: str, value: str) -> str:
    if not value:
        raise UserError(f"{command}: {what} is missing: see {_PROG} {command} --help")
    return value


def _echo(text: str) -> None:
    print(text, file=sys.stderr)


_COMMANDS: dict[str, tuple[Subcommand, str]] = {
    "info": (_info, "shows what logs contain"),
    "recover": (_recover, "makes an unfinished or damaged log readable"),
    "trim": (_trim, "copies a part of a log"),
    "export": (_export, "writes trajectory, mesh, frames and a rerun recording"),
}


if __name__ == "__main__":
    sys.exit(main())
