"""Saves the results in the arena of a dead run: each artefact in a process of its own, without a bus."""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from hsslam_node.device.device import CPU
from hsslam_node.errors import UserError
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import disk_folder, pose_count
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.arena.unsaved_marker import ARENA_ARTEFACTS, mark_unsaved, read_unsaved
from hsslam_services.artefacts.map_file import save_map
from hsslam_services.artefacts.mesh_file import mesh_of_arena, mesh_section, save_mesh
from hsslam_services.artefacts.replaced_results import ReplacedResults
from hsslam_services.artefacts.trajectory_files import TrajectoryFiles
from hsslam_services.run.process_result import (
    ProcessResult,
    clear_result,
    read_result,
    write_result,
)
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary, update_summary

_LONGEST_S = 3600.0  # limit for one artefact, such as the mesh of a large map
_POLL_S = 0.02
Report = Callable[[str], None]


def rescue(arena_dir: Path, run_dir: Path, report: Report) -> dict[str, str]:
    """Save the artefacts that are missing in the run folder; returns an error for each that failed.

    The arena stays marked meanwhile: an arena that waits for the user goes on to do so if this process dies.
    No other process of the run may live.

    Raises:
        UserError: the arena has no run.json, or the run folder is not writable.
    """
    run = RunInfo.read(arena_dir)
    unsaved = read_unsaved(arena_dir)
    wanted = unsaved.artefacts if unsaved else ARENA_ARTEFACTS
    not_saved: dict[str, str] = {}
    saved: list[str] = []
    try:
        run_dir.mkdir(parents=True, exist_ok=True)
        if run_dir == run.path:
            run.restore()
        with contextlib.suppress(OSError):  # the memory is full
            is_being_saved = unsaved is None or unsaved.is_being_saved
            mark_unsaved(arena_dir, run_dir, wanted, is_being_saved=is_being_saved)
        _link_moved_arrays(arena_dir, run_dir)
        for artefact in wanted:
            error = _in_own_process(artefact, run, arena_dir, run_dir, report)
            section = read_result(run_dir, _result_name(artefact)).summary
            if error:
                not_saved[artefact] = error
            elif section:
                saved.append(artefact)
            update_summary(run_dir, section)
            done = "saved" if section else "nothing to save"
            report(f"{artefact} not saved: {error}" if error else f"{artefact}: {done}")
        with contextlib.suppress(OSError):
            mark_unsaved(arena_dir, run_dir, not_saved)
        update_summary(run_dir, {"run_id": run.run_id, "source": run.options.source})
        update_summary(run_dir, {"rescued": saved})
        if given_up := read_summary(run_dir).get("given_up"):
            left = [name for name in given_up if name not in saved]
            update_summary(run_dir, {"given_up": left}, replaced=("given_up",))
        if earlier := ReplacedResults(run_dir).keep():
            report(f"{run_dir}: the results of the previous run are in {earlier}")
    except OSError as error:
        raise UserError(f"{run_dir}: {error.strerror}: expected a writable folder") from None
    return not_saved


def _link_moved_arrays(arena_dir: Path, run_dir: Path) -> None:
    """Let links of the arena to arrays in the run folder follow a run folder that was moved."""
    folder = disk_folder(run_dir, arena_dir).absolute()
    for link in arena_dir.iterdir():
        moved = folder / link.name
        if link.is_symlink() and not link.exists() and moved.is_file():
            link.unlink()
            link.symlink_to(moved)


def _in_own_process(
    artefact: str, run: RunInfo, arena_dir: Path, run_dir: Path, report: Report
) -> str:
    """Save in a forked process, which may crash; returns "" or the error."""
    name = _result_name(artefact)
    clear_result(run_dir, name)
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        os._exit(_save(artefact, run, arena_dir, run_dir, report))
    deadline_s = time.monotonic() + _LONGEST_S
    try:
        while (ended := os.waitpid(pid, os.WNOHANG))[0] == 0:
            if time.monotonic() > deadline_s:
                os.kill(pid, signal.SIGKILL)
            time.sleep(_POLL_S)
    except BaseException:
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)
        raise
    code = os.waitstatus_to_exitcode(ended[1])
    if code == 0:
        return ""
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return read_result(run_dir, name).error or how


def _save(artefact: str, run: RunInfo, arena_dir: Path, run_dir: Path, report: Report) -> int:
    """Save one artefact; write its section of the summary or its error; returns the exit code."""
    sections: dict[str, Any] = {}
    error = ""
    try:
        _SAVERS[artefact](run, arena_dir, run_dir, sections, report)
    except UserError as failure:
        error = str(failure)
    except BaseException as failure:  # the parent reports it
        error = f"{type(failure).__name__}: {failure}"
    with contextlib.suppress(OSError):
        write_result(run_dir, _result_name(artefact), ProcessResult(error, sections))
    return 1 if error else 0


def _save_trajectories(
    run: RunInfo, arena_dir: Path, run_dir: Path, sections: dict[str, Any], _: Report
) -> None:
    if not pose_count(arena_dir):
        return
    arena = Arena(arena_dir)
    store = SharedMap(arena, run.options.slam).store()
    files = TrajectoryFiles(arena, store, MapState(arena_dir).map_epoch)
    sections |= files.section(run_dir)
    files.save(run_dir)
    if files.lost:
        sections |= {"not_saved": {"poses": files.lost}}


def _save_map(
    run: RunInfo, arena_dir: Path, run_dir: Path, sections: dict[str, Any], _: Report
) -> None:
    options = run.options
    if (published := SharedMap(Arena(arena_dir), options.slam).published()) is not None:
        sections |= save_map(run_dir, *published, options)


def _save_mesh(
    run: RunInfo, arena_dir: Path, run_dir: Path, sections: dict[str, Any], report: Report
) -> None:
    slam = run.options.slam
    published = SharedMap(Arena(arena_dir), slam).published()
    if published is None:
        return
    mesh = mesh_of_arena(*published, slam, CPU, report)
    if len(mesh.faces):
        save_mesh(run_dir, mesh)
        sections |= mesh_section(mesh)


def _result_name(artefact: str) -> str:
    return f"rescue_{artefact}"


_SAVERS: Mapping[str, Callable[..., None]] = MappingProxyType(
    {"trajectories": _save_trajectories, "map": _save_map, "mesh": _save_mesh}
)
