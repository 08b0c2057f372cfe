"""Prepares a run before its processes start; an error is one line, at once."""

import contextlib
import os
import re
import secrets
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import psutil

from hsslam_node.durable_file import durable_folder, sync_folder
from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.arena.arena_folder import (
    ArenaFolder,
    foreign_arenas,
    kept_arenas,
    remove_dead_arenas,
    run_dir_of,
)
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.unsaved_marker import leave_to_user, read_unsaved
from hsslam_services.artefacts.replaced_results import ReplacedResults
from hsslam_services.bus.dead_pools import remove_own_pools, remove_unused_pools
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.health.http_server import MetricsServer
from hsslam_services.launch.one_shot import start_watchdog
from hsslam_services.ros2.type_store import expect_packages
from hsslam_services.run.maps_folder import find_map
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.source_table import log_place
from hsslam_services.supervisor.earlier_run import wait_for_earlier_run
from hsslam_services.supervisor.folder_claim import FolderClaim
from hsslam_services.supervisor.router import RunRouter, open_run_router


@dataclass(frozen=True)
class Prepared:
    """The open resources of a run, and notices for the user: text, level."""

    info: RunInfo
    claim: FolderClaim
    replaced: ReplacedResults
    router: RunRouter
    arena: ArenaFolder
    metrics: MetricsServer
    notices: tuple[tuple[str, str], ...]

    def give_back(self) -> None:
        """Restore the run folder as it was before this run, which is refused."""
        _give_back(self.replaced)

    def close(self) -> None:
        """Free everything but the arena."""
        self.metrics.close()
        self.router.session.close()
        remove_own_pools()
        self.claim.close()


def prepare(options: ServeOptions, is_cancelled: Callable[[], bool]) -> Prepared:
    """Make the run folder, make the arena, open the router, write run.json.

    Starts a watchdog for each arena whose run and watchdog are dead; it saves and removes the arena.

    Raises:
        UserError: no permission for the folder, port taken, no shared memory, a package is missing.
        KeyboardInterrupt: cancelled while an earlier run in this folder is being saved.
    """
    if options.ros2_out:
        expect_packages(f"--ros2-out {options.ros2_out}")
    run_id = f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}"
    _expect_inputs_elsewhere(options)
    _save_dead_arenas()
    remove_unused_pools()
    with contextlib.ExitStack() as undo:
        run_dir, claim = _run_folder(options)
        undo.callback(claim.close)
        _expect_room_for_run(run_dir, is_cancelled)
        undo.callback(_remove_if_empty, run_dir)
        arena = ArenaFolder(run_id, run_dir)
        undo.callback(arena.remove)
        MapState.create(arena.path, localise_only=options.localise_only)
        SharedLevel.create(arena.path)
        router = open_run_router(options, arena.path)
        undo.callback(router.session.close)
        skipped = [
            (f"{path}: ignored: it belongs to another user, or is a link", "info")
            for path in foreign_arenas()
        ]
        repeated = [(text, "warning") for text in _repeated_effects(options)]
        router = router._replace(notices=(*router.notices, *skipped, *repeated))
        metrics = MetricsServer(options.metrics_port)
        undo.callback(metrics.close)
        info = RunInfo(
            run_id=run_id,
            run_dir=str(run_dir),
            arena_dir=str(arena.path),
            endpoint=router.endpoint,
            robot=options.robot,
            supervisor_pid=os.getpid(),
            started_ns=int(1e9 * psutil.Process().create_time()),
            options=options,
        )
        try:
            replaced = ReplacedResults(run_dir)
            replaced.set_aside()
            undo.callback(_give_back, replaced)
            info.write()
            info.write_into_arena()
        except OSError as error:
            raise _no_folder(run_dir, error) from None
        undo.pop_all()
    return Prepared(
        info, claim, replaced, router, arena, metrics, (*router.notices, *_kept_arenas())
    )


def _repeated_effects(options: ServeOptions) -> list[str]:
    if not log_place(options.source):
        return []
    # imports MCAP, which few runs need
    from hsslam_services.log.reading.source import repeated_effects

    return repeated_effects(options)


def _save_dead_arenas() -> None:
    """Start a watchdog for each dead arena; it saves the results. If the run folder is not writable, keep the
    arena for `hsslam-serve rescue`."""
    for arena_dir in remove_dead_arenas():
        with contextlib.suppress(OSError):  # another run saves it, or its memory is full
            unsaved = read_unsaved(arena_dir)
            run_dir = unsaved.run_dir if unsaved else run_dir_of(arena_dir)
            try:
                RunInfo.read(arena_dir).restore()
                start_watchdog(run_dir, arena_dir)
            except (OSError, UserError):
                leave_to_user(arena_dir, run_dir)


def _kept_arenas() -> Iterator[tuple[str, str]]:
    """One notice for each arena that holds unsaved results."""
    for arena_dir in kept_arenas():
        text = f"{arena_dir} holds results that are not saved: hsslam-serve rescue {arena_dir}"
        yield text, "warning"


def _run_folder(options: ServeOptions) -> tuple[Path, FolderClaim]:
    """Make the run folder and lock it for this run; without --out, a new folder."""
    source = re.sub(r"[^A-Za-z0-9]+", "-", options.source).strip("-")
    name = options.out or f"runs/{source}-{time.strftime('%Y%m%d-%H%M%S')}"
    run_dir = user_path(name).absolute()
    _expect_utf8(options, run_dir)
    try:
        if options.out:
            durable_folder(run_dir)
        else:
            run_dir = _new_folder(run_dir)
        return run_dir, FolderClaim(run_dir)
    except OSError as error:
        raise _no_folder(run_dir, error) from None


def _expect_utf8(options: ServeOptions, run_dir: Path) -> None:
    """Raise UserError if a value is not UTF-8: all go into run.json."""
    try:
        msgspec.json.encode((str(run_dir), options))
    except UnicodeEncodeError as error:
        what = f"--out {str(run_dir)!r}" if error.object == str(run_dir) else f"{error.object!r}"
        raise UserError(f"{what}: is not UTF-8: expected a name in UTF-8") from None


def _new_folder(wanted: Path) -> Path:
    """Make a folder of this name; append a number if another run has taken the name."""
    durable_folder(wanted.parent)
    path, number = wanted, 1
    while True:
        try:
            path.mkdir()
        except FileExistsError:
            number += 1
            path = Path(f"{wanted}-{number}")
        else:
            sync_folder(path.parent)
            return path


def _expect_room_for_run(run_dir: Path, is_cancelled: Callable[[], bool]) -> None:
    """Wait until an earlier run in the folder is saved; UserError if the folder holds other files."""
    try:
        wait_for_earlier_run(run_dir, is_cancelled)
        ReplacedResults(run_dir).recover()
        if any(run_dir.iterdir()):
            _expect_run_folder(run_dir)
    except OSError as error:
        raise _no_folder(run_dir, error) from None


def _expect_inputs_elsewhere(options: ServeOptions) -> None:
    """Raise UserError if an input of this run lies in its run folder, whose old results are removed."""
    log = log_place(options.source)
    saved = find_map(options.maps, options.map) if options.map else None
    if not options.out:
        return
    run_dir = user_path(options.out).resolve()
    given = {
        "the log that is the source": user_path(log) if log else None,
        "the map of --map": saved,
        "the image of --mask": user_path(options.mask) if options.mask else None,
    }
    for what, path in given.items():
        if path is not None and run_dir in (path.resolve(), path.resolve().parent):
            raise UserError(f"--out {options.out}: holds {what}: expected another folder")


def _expect_run_folder(run_dir: Path) -> None:
    if not (run_dir / "run.json").exists():
        raise UserError(
            f"--out {run_dir}: holds other files: expected a new folder or a run folder"
        )


def _remove_if_empty(run_dir: Path) -> None:
    with contextlib.suppress(OSError):
        run_dir.rmdir()


def _give_back(replaced: ReplacedResults) -> None:
    with contextlib.suppress(OSError):  # else the next run in this folder gives them back
        replaced.give_back()


def _no_folder(run_dir: Path, error: OSError) -> UserError:
    return UserError(f"--out {run_dir}: {error.strerror}: expected a folder that can be written")
