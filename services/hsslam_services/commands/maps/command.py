"""`hsslam-map query|grid|esdf|export|merge`: queries, exports and merges saved maps."""

import sys
from collections.abc import Sequence

from hsslam_services.commands.cli import Subcommand, exit_code, parse_options, run_subcommand

_PROG = "hsslam-map"
_PURPOSE = "Queries, exports and merges saved maps, without the service."


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; exit code 0, 1 on interruption, 2 on bad input, reported in one line."""
    given = sys.argv[1:] if args is None else args
    return exit_code(lambda: run_subcommand(_PROG, _PURPOSE, _COMMANDS, given))


def _query(args: Sequence[str]) -> None:
    from hsslam_services.commands.maps.query import QueryOptions, query_map

    query_map(parse_options(QueryOptions, f"{_PROG} query", args))


def _grid(args: Sequence[str]) -> None:
    from hsslam_services.commands.maps.grid import GridOptions, write_grid

    write_grid(parse_options(GridOptions, f"{_PROG} grid", args))


def _esdf(args: Sequence[str]) -> None:
    from hsslam_services.commands.maps.esdf import EsdfOptions, write_distances

    write_distances(parse_options(EsdfOptions, f"{_PROG} esdf", args))


def _export(args: Sequence[str]) -> None:
    from hsslam_services.commands.maps.export import ExportOptions, export_map

    export_map(parse_options(ExportOptions, f"{_PROG} export", args))


def _merge(args: Sequence[str]) -> None:
    from hsslam_services.commands.maps.merge import MergeOptions, merge_runs

    merge_runs(parse_options(MergeOptions, f"{_PROG} merge", args))


_COMMANDS: dict[str, tuple[Subcommand, str]] = {
    "query": (_query, "prints distance, gradient and certainty at points"),
    "grid": (_grid, "writes the floor for Nav2: map.yaml, map.pgm"),
    "esdf": (_esdf, "writes the distances of all voxels: esdf.npz"),
    "export": (_export, "writes mesh or points for other tools"),
    "merge": (_merge, "makes one map of two runs in the same place"),
}


if __name__ == "__main__":
    sys.exit(main())
