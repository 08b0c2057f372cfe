"""`hsslam-map query`: asks a saved map; alone, as each subcommand is a module beside it."""

import sys
from collections.abc import Sequence

from hsslam_services.commands.cli import Subcommand, exit_code, parse_options, run_subcommand

_PROG = "hsslam-map"
_PURPOSE = "Asks a saved map, without the service."


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; exit code 0, 1 on interruption, 2 on bad input, reported in one line."""
    given = sys.argv[1:] if args is None else args
    return exit_code(lambda: run_subcommand(_PROG, _PURPOSE, _COMMANDS, given))


def _query(args: Sequence[str]) -> None:
    from hsslam_services.commands.maps.query import QueryOptions, query_map

    query_map(parse_options(QueryOptions, f"{_PROG} query", args))


_COMMANDS: dict[str, tuple[Subcommand, str]] = {
    "query": (_query, "distance, gradient and certainty of places"),
}


if __name__ == "__main__":
    sys.exit(main())
