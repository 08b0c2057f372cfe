"""Everything a run needs before its processes start; whatever is missing is one line, at once."""

import contextlib
import os
import re
import secrets
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import ArenaFolder, remove_dead_arenas
from hsslam_services.arena.map_state import MapState
from hsslam_services.health.http_server import MetricsServer
from hsslam_services.run.maps_folder import find_map
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.source_table import log_place
from hsslam_services.supervisor.router import RunRouter, open_run_router

_OLD_RESULTS = (
    "run*.mcap*",
    "run*.rrd",
    "trajectory*.txt",
    "keyframes*.txt",
    "mesh.ply",
    "map.safetensors",
    "summary.json",
    "*.png",
    "logs/*",
)


@dataclass(frozen=True)
class Prepared:
    """The open resources of a run; `close` frees them."""

    info: RunInfo
    router: RunRouter
    arena: ArenaFolder
    metrics: MetricsServer

    def close(self) -> None:
        self.metrics.close()
        self.router.session.close()
        self.arena.remove()


def prepare(options: ServeOptions) -> Prepared:
    """Make the run folder, listen, make the arena, write run.json.

    Raises:
        UserError: no permission for the folder, port taken, no shared memory.
    """
    if options.map:
        find_map(options.maps, options.map)
    run_id = f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}"
    run_dir = _run_folder(options)
    with contextlib.ExitStack() as undo:
        undo.callback(_remove_if_empty, run_dir)
        remove_dead_arenas()
        arena = ArenaFolder(run_id, run_dir)
        undo.callback(arena.remove)
        MapState.create(arena.path, localise_only=options.localise_only)
        router = open_run_router(options, arena.path)
        undo.callback(router.session.close)
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
            _clear(run_dir)
            info.write()
        except OSError as error:
            raise _no_folder(run_dir, error) from None
        undo.pop_all()
    return Prepared(info, router, arena, metrics)


def _run_folder(options: ServeOptions) -> Path:
    """The run folder, made; one that exists must be that of an earlier run."""
    name = re.sub(r"[^A-Za-z0-9]+", "-", options.source).strip("-")
    run_dir = Path(options.out or f"runs/{name}-{time.strftime('%Y%m%d-%H%M%S')}").absolute()
    _expect_source_elsewhere(options.source, run_dir)
    try:
        run_dir.mkdir(parents=True, exist_ok=True)
        if any(run_dir.iterdir()):
            _expect_finished_run(run_dir)
    except OSError as error:
        raise _no_folder(run_dir, error) from None
    return run_dir


def _expect_source_elsewhere(source: str, run_dir: Path) -> None:
    """The results of an earlier run are removed: a log that is replayed must not be among them."""
    place = log_place(source)
    log = Path(place).expanduser().resolve()
    if place and run_dir.resolve() in (log, log.parent):
        raise UserError(
            f"--out {run_dir}: holds the log that is the source: expected another folder"
        )


def _expect_finished_run(run_dir: Path) -> None:
    if not (run_dir / "run.json").exists():
        raise UserError(f"--out {run_dir}: holds other files: expected a new folder or an old run")
    try:
        arena_dir = Path(RunInfo.read(run_dir).arena_dir)
    except UserError:
        return  # of another version: none of ours writes there
    remove_dead_arenas()
    if arena_dir.exists():
        raise UserError(f"--out {run_dir}: a run is going on there: expected another folder")


def _clear(run_dir: Path) -> None:
    """Remove the results of an earlier run, and nothing else."""
    for pattern in _OLD_RESULTS:
        for path in run_dir.glob(pattern):
            path.unlink()


def _remove_if_empty(run_dir: Path) -> None:
    with contextlib.suppress(OSError):
        run_dir.rmdir()


def _no_folder(run_dir: Path, error: OSError) -> UserError:
    return UserError(f"--out {run_dir}: {error.strerror}: expected a folder that can be written")
