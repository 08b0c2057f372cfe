"""The results of the previous run in a folder: kept until the new run has poses."""

import contextlib
import itertools
import shutil
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.arena.unsaved_marker import mark_unsaved, read_unsaved
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import SUMMARY_FILE, read_summary

_MAPS = ("map.safetensors", "map_fragment_*.safetensors")
_WORTH_KEEPING = ("run*.mcap*", "trajectory*.txt", "mesh.ply", *_MAPS)
_FILES = (
    *_WORTH_KEEPING,
    "run*.rrd",
    "keyframes*.txt",
    SUMMARY_FILE,
    "picture.png",
    ".run*.mcap*",
    "run.json",
    "config.toml",
)
EARLIER = "earlier"  # folder of results that are kept; further ones have names that begin so
_FOLDERS = ("logs", "evaluation")
_PARTIAL = ".*.partial*"  # incomplete files
_FOLDER = ".replaced"
_REMOVED = ".replaced-removed"  # what is being removed; further ones have names that begin so
_IN_ORDER = (ExitCode.SAVED, ExitCode.CUT_SHORT, ExitCode.BAD_INPUT)


class ReplacedResults:
    """The previous results of a run folder; `.replaced` holds them from `set_aside` to another method.

    Moves and removes only files of a run. Every method but `set_aside` changes no results if none are set
    aside. All raise OSError if the folder is not writable.
    """

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        self._aside = run_dir / _FOLDER

    @property
    def exists(self) -> bool:
        """Whether anything is set aside."""
        return self._aside.is_dir()

    def set_aside(self) -> None:
        """Move the results of the previous run to `.replaced`."""
        for path in self._run_dir.glob(_PARTIAL):
            path.unlink()
        if _has(self._run_dir, _FILES):
            self._aside.mkdir()
            _move(self._run_dir, self._aside)

    def give_back(self) -> None:
        """Remove the files of the new run, which was refused, and put the previous results back."""
        if not self.exists:
            return
        for path in [p for pattern in (*_FILES, _PARTIAL) for p in self._run_dir.glob(pattern)]:
            path.unlink()
        for name in _FOLDERS:
            shutil.rmtree(self._run_dir / name, ignore_errors=True)
        _move(self._aside, self._run_dir)
        self._aside.rmdir()

    def keep(self) -> str:
        """Keep the previous results in a subfolder; returns its name, "" if there are none."""
        if not _has(self._aside, _WORTH_KEEPING):
            self._remove()
            return ""
        arena_dir: Path | None = None
        name = EARLIER
        with contextlib.suppress(UserError):  # run.json of another version
            run = RunInfo.read(self._aside)
            name, arena_dir = f"{EARLIER}-{run.run_id}", Path(run.arena_dir)
        kept = self._aside.rename(self._free_folder(name))
        if arena_dir is not None and (unsaved := read_unsaved(arena_dir)) is not None:
            # `hsslam-serve rescue` saves there; if the memory is full, beside the run folder
            with contextlib.suppress(OSError):
                is_being_saved = unsaved.is_being_saved
                mark_unsaved(arena_dir, kept, unsaved.artefacts, is_being_saved=is_being_saved)
        return kept.name

    def _free_folder(self, name: str) -> Path:
        """A folder of this name, or of it with a number, that does not exist."""
        names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
        return next(path for each in names if not (path := self._run_dir / each).exists())

    def replace(self) -> str:
        """The new run has poses: remove the previous results, or keep them if their run did not end in order;
        returns the name of the folder that keeps them, or "". Also removes what a killed process left."""
        if self.exists and read_summary(self._aside).get("exit_code") not in _IN_ORDER:
            return self.keep()
        self._remove()
        return ""

    def _remove(self) -> None:
        """Remove the previous results, in one step for all that look for them."""
        with contextlib.suppress(OSError):  # there are none
            self._aside.rename(self._free_folder(_REMOVED))
        for path in self._run_dir.glob(f"{_REMOVED}*"):
            shutil.rmtree(path, ignore_errors=True)

    def recover(self) -> None:
        """After a killed run: keep the previous results beside its own, or put them back if it has none."""
        if _has(self._run_dir, _WORTH_KEEPING):
            self.keep()
        else:
            self.give_back()


def _has(folder: Path, patterns: tuple[str, ...]) -> bool:
    return any(path for pattern in patterns for path in folder.glob(pattern))


def _move(source: Path, target: Path) -> None:
    for path in [path for pattern in _FILES for path in source.glob(pattern)]:
        path.rename(target / path.name)
    for name in _FOLDERS:
        with contextlib.suppress(OSError):  # there is none
            (source / name).rename(target / name)
