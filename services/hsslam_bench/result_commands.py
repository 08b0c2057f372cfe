"""`compare`, `plots` and `keep`: what can be done with result files."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from rich.console import Console

from hsslam_bench.results.compare import circumstances, comparison
from hsslam_bench.results.newest_rows import keep
from hsslam_bench.results.report import read_report


def _compare(args: Sequence[str]) -> None:
    """Print B as ratios of A."""
    parser = argparse.ArgumentParser(
        prog="bench compare", description="Two results side by side: ratios of B over A."
    )
    parser.add_argument("before", type=Path, metavar="A.json")
    parser.add_argument("after", type=Path, metavar="B.json")
    arguments = parser.parse_args(args)
    before, after = read_report(arguments.before), read_report(arguments.after)
    console = Console(emoji=False, highlight=False, markup=False)
    console.print(comparison(before, after))
    for line in circumstances(before, after):
        console.print(line, soft_wrap=True)


def _plots(args: Sequence[str]) -> None:
    """Draw the runs of the files; of a run that several have, the last."""
    parser = argparse.ArgumentParser(
        prog="bench plots", description="Pictures of core time, latency and growth."
    )
    parser.add_argument("results", type=Path, nargs="+", metavar="FILE.json")
    parser.add_argument("--to", type=Path, default=Path("docs/plots"), help="(%(default)s)")
    arguments = parser.parse_args(args)
    from hsslam_bench.results.plots import draw  # matplotlib takes its time

    for path in draw([read_report(result) for result in arguments.results], arguments.to):
        print(path)


def _keep(args: Sequence[str]) -> None:
    """Take the files' rows in among the figures that the documents show."""
    parser = argparse.ArgumentParser(
        prog="bench keep",
        description="Keep the newest of every row, without the runs, for the tables of the documents.",
    )
    parser.add_argument("results", type=Path, nargs="+", metavar="FILE.json")
    parser.add_argument("--to", type=Path, default=Path("docs/figures"), help="(%(default)s)")
    arguments = parser.parse_args(args)
    for path in keep(arguments.to, arguments.results):
        print(path)


RESULT_COMMANDS: Mapping[str, Callable[[Sequence[str]], None]] = MappingProxyType(
    {"compare": _compare, "plots": _plots, "keep": _keep}
)
