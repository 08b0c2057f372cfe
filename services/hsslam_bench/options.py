"""The options of `hsslam-bench` and its commands on result files: one frozen dataclass each."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class BenchOptions:
    """Measures the figures of the documents and stores them as JSON.

    Subcommands, each with its own --help:
      ablation, replica, tum, scannet   measure a table of the paper
      peers                             run other systems on the same sequences
      compare A.json B.json             compare two results
      plots FILE...                     draw core time, latency and growth of runs
      keep FILE...                      keep the newest result of each row, for the documents

    Examples:
      hsslam-bench --quick --only first-pose memory
      hsslam-bench --docs docs/results.md --from docs/figures/*.json
      hsslam-bench -- --slam.mapper.rays 500

    Every hsslam-serve gets the options after --; the figures then do not follow the protocol. With --docs the
    command writes tables into documents and measures nothing.

    Exit codes: 0 if all bounds of the measured rows are met, 1 if a bound is not met, no row could be
    measured or the command is interrupted, 2 if the input is bad.

    Raises:
        UserError: options that exclude or need each other.
    """

    VALUES: ClassVar = {
        "only": "NAME...",
        "data": "FOLDER",
        "results": "JSON...",
        "address": "local|auto|HOST:PORT|ray://HOST:PORT",
    }
    ALIASES: ClassVar = {"results": "--from"}

    only: tuple[str, ...] = ()
    """Measure only these rows or groups (none: all)."""
    quick: bool = False
    """Use one seed and few frames, to test the benchmark."""
    list: bool = False
    """Print the names of the rows and exit."""
    address: str = ""
    """Ray cluster for the lockstep runs, which come first, several at once (none: one after the other)."""
    data: Path | None = None
    """Folder of the sequences (none: $HSSLAM_TEST_DATA, else ../shared/data)."""
    out: Path | None = None
    """Result file, JSON (none: runs/bench/TIME.json)."""
    docs: tuple[Path, ...] = ()
    """Documents into which to write the tables of the files of --from."""
    results: tuple[Path, ...] = ()
    """Result files for --docs, JSON."""

    def __post_init__(self) -> None:
        if bool(self.docs) != bool(self.results):
            raise UserError("--docs: expected with --from, and --from with --docs")
        expect_json(self.out)
        expect_folder("--data", self.data)


def expect_json(out: Path | None) -> None:
    """Raise UserError if --out has another suffix: its name without it is a folder of results."""
    if out is not None and out.suffix != ".json":
        raise UserError(f"--out {out}: expected a name that ends in .json")


def expect_folder(option: str, folder: Path | None) -> None:
    """Raise UserError if the folder of an option is given and missing."""
    if folder is not None and not folder.is_dir():
        raise UserError(f"{option} {folder}: no such folder")


@dataclass(frozen=True)
class CompareOptions:
    """Compares two results, as ratios of B over A."""

    POSITIONALS: ClassVar = ("before", "after")
    VALUES: ClassVar = {"before": "A.json", "after": "B.json"}

    before: Path = Path()
    """Result file to compare with, JSON."""
    after: Path = Path()
    """Result file to compare, JSON."""


@dataclass(frozen=True)
class PlotsOptions:
    """Draws core time, latency and growth of the runs in result files; of a run in several, the last."""

    POSITIONALS: ClassVar = ("results",)
    VALUES: ClassVar = {"results": "FILE...", "to": "FOLDER"}

    results: tuple[Path, ...] = ()
    """Result files, JSON."""
    to: Path = Path("docs/plots")
    """Output folder of the plots."""


@dataclass(frozen=True)
class KeepOptions:
    """Keeps the newest result of each row, without the runs, for the tables of the documents."""

    POSITIONALS: ClassVar = ("results",)
    VALUES: ClassVar = {"results": "FILE...", "to": "FOLDER"}

    results: tuple[Path, ...] = ()
    """Result files, JSON."""
    to: Path = Path("docs/figures")
    """Output folder of the rows."""
