"""`hsslam-serve rescue DIR`: saves the results in the arena of an earlier run."""

import contextlib
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from hsslam_node import __version__
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import writable_kernel_cache
from hsslam_services.arena.arena_folder import (
    SHM_ROOT,
    disk_folder,
    remove_arena,
    run_dir_of,
    try_own,
)
from hsslam_services.arena.process_registry import living_processes
from hsslam_services.arena.unsaved_marker import read_unsaved
from hsslam_services.artefacts.lost_results import LOST_FOREVER, lost_results
from hsslam_services.launch.spawn import child_environment
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary, update_summary

_GIVEN_UP = "a second signal ended the run"
RESCUE_HELP = """usage: hsslam-serve rescue DIR

Saves the trajectories, map and mesh that a run could not write (exit code 4) and kept in shared memory.
DIR is the run folder, or the folder in /dev/shm. When all three are saved, the command frees the memory.
The memory does not hold the log: hsslam-log recover makes the log on disk readable. Fragments that
were not saved are lost. What a second signal gave up is saved if the memory was kept for another result.

Exit codes: 0 if everything is saved, 2 if the input is bad, 4 if something is still not saved or the rescue
is interrupted."""


def rescue_command(args: Sequence[str]) -> ExitCode:
    """Run the command; returns the exit code.

    Raises:
        UserError: an argument is wrong, the run is still active, there is nothing to save, or the kernel
            cache cannot be written.
    """
    if "-h" in args or "--help" in args:
        print(RESCUE_HELP)
        return ExitCode.SAVED
    if "--version" in args:
        print(f"hsslam-serve {__version__}")
        return ExitCode.SAVED
    if args and args[0].startswith("-"):
        raise UserError(f"rescue {args[0]}: unknown option: expected one run folder")
    if len(args) != 1:
        raise UserError(f"rescue {' '.join(args)}: expected one run folder")
    given = Path(args[0]).absolute()
    arena_dir, run_dir = _places(given)
    if not arena_dir.exists():
        not_saved = read_summary(run_dir).get("not_saved")
        if not_saved is not None and not_saved.keys() <= LOST_FOREVER:
            return _report_end(run_dir, not_saved)
        raise UserError(f"{given}: its shared memory {arena_dir} is gone: nothing to save from")
    try:
        with try_own(arena_dir) as is_free:
            if not is_free or living_processes(arena_dir):
                raise UserError(
                    f"{given}: in use by its run or another rescue: expected a run that has ended"
                )
            return _rescue(arena_dir, run_dir)
    except OSError as error:
        raise UserError(f"{arena_dir}: {error.strerror}: expected an arena of this user") from None


def _places(given: Path) -> tuple[Path, Path]:
    """The arena folder and the run folder."""
    if given.parent != SHM_ROOT:
        arena_dir = Path(RunInfo.read(given).arena_dir)
        _expect_own(arena_dir)
        return arena_dir, given
    if not given.exists():
        raise UserError(
            f"{given}: does not exist: expected the run folder, whose summary.json says what is saved"
        )
    _expect_own(given)
    unsaved = read_unsaved(given)
    try:
        run_dir = unsaved.run_dir if unsaved else run_dir_of(given)
    except OSError:
        raise UserError(f"{given}: not an arena: expected a run folder") from None
    return given, _not_of_another_run(run_dir, RunInfo.read(given).run_id)


def _expect_own(arena_dir: Path) -> None:
    """Raise UserError if the arena belongs to another user, who could not read what this one would save."""
    with contextlib.suppress(FileNotFoundError):
        owner = arena_dir.stat().st_uid
        if owner == os.geteuid():
            return
        with contextlib.suppress(KeyError):  # the user has no name
            owner = arena_dir.owner()
        raise UserError(
            f"{arena_dir}: belongs to user {owner}: expected the command to run as {owner}"
        )


def _not_of_another_run(run_dir: Path, run_id: str) -> Path:
    """The run folder, or a folder beside it if another run has its results there now."""
    with contextlib.suppress(UserError):
        if RunInfo.read(run_dir).run_id != run_id:
            beside = run_dir.with_name(f"{run_dir.name}-rescued-{run_id}")
            print(f"{run_dir}: holds another run now: saving to {beside}", file=sys.stderr)
            return beside
    return run_dir


def _rescue(arena_dir: Path, run_dir: Path) -> ExitCode:
    writable_kernel_cache()
    os.environ.update(child_environment())
    from hsslam_services.artefacts.rescue import (
        rescue,
    )  # after the environment, which PyTorch reads

    not_saved = rescue(arena_dir, run_dir, lambda text: print(text, file=sys.stderr, flush=True))
    known = read_summary(run_dir).get("not_saved")
    if known is None:  # neither the supervisor nor the watchdog got so far
        known = lost_results(run_dir)
    left = {name: line for name, line in known.items() if name in LOST_FOREVER} | not_saved
    try:
        update_summary(run_dir, {"not_saved": left}, replaced=("not_saved",))
    except OSError as error:
        raise UserError(f"{run_dir}: {error.strerror}: expected a writable folder") from None
    if not_saved:
        return ExitCode.NOT_SAVED
    remove_arena(arena_dir)
    # the arrays in a run folder that was moved
    shutil.rmtree(disk_folder(run_dir, arena_dir), ignore_errors=True)
    return _report_end(run_dir, left)


def _report_end(run_dir: Path, not_saved: Mapping[str, str]) -> ExitCode:
    """Report what no rescue saves: log, fragments, and what a second signal gave up; the rest is saved."""
    lost = dict.fromkeys(read_summary(run_dir).get("given_up", ()), _GIVEN_UP)
    lost |= {name: why for name, why in not_saved.items() if name in LOST_FOREVER}
    for name, why in lost.items():
        print(f"{run_dir}: {name} not saved: {why}", file=sys.stderr)
    if lost:
        return ExitCode.NOT_SAVED
    print(f"{run_dir}: everything is saved")
    return ExitCode.SAVED
