"""The commands `compare`, `plots` and `keep` on result files."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from rich.console import Console

from hsslam_bench.options import CompareOptions, KeepOptions, PlotsOptions
from hsslam_bench.results.compare import circumstances, comparison
from hsslam_bench.results.newest_rows import keep
from hsslam_bench.results.report import read_report
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import parse_options


def _compare(args: Sequence[str]) -> None:
    """Print B as ratios of A."""
    options = parse_options(CompareOptions, "hsslam-bench compare", args)
    if Path() in (options.before, options.after):
        raise UserError("compare: missing file: expected hsslam-bench compare A.json B.json")
    before, after = read_report(options.before), read_report(options.after)
    console = Console(emoji=False, highlight=False, markup=False)
    console.print(comparison(before, after))
    for line in circumstances(before, after):
        console.print(line, soft_wrap=True)


def _plots(args: Sequence[str]) -> None:
    """Draw the runs of the files; of a run in several files, the last."""
    options = parse_options(PlotsOptions, "hsslam-bench plots", args)
    _expect_files("plots", options.results)
    from hsslam_bench.results.plots import draw  # matplotlib takes a second to import

    for path in draw([read_report(result) for result in options.results], options.to):
        print(path)


def _keep(args: Sequence[str]) -> None:
    """Add the rows of the files to the figures of the documents."""
    options = parse_options(KeepOptions, "hsslam-bench keep", args)
    _expect_files("keep", options.results)
    for path in keep(options.to, list(options.results)):
        print(path)


def _expect_files(command: str, results: Sequence[Path]) -> None:
    if not results:
        raise UserError(f"{command}: missing file: expected hsslam-bench {command} FILE...")


RESULT_COMMANDS: Mapping[str, Callable[[Sequence[str]], None]] = MappingProxyType(
    {"compare": _compare, "plots": _plots, "keep": _keep}
)
