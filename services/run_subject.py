"""A run as something to judge: its folder, or its log alone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from hsslam_node.evaluation.evaluate import Subject
from hsslam_node.evaluation.evaluate_run import run_trajectories
from hsslam_node.services.log.log_file import Say, is_log
from hsslam_node.services.log.log_subject import log_subject
from hsslam_node.services.log.recorded_source import RecordedSource, recorded_source
from hsslam_node.services.mcap_recovery import parts
from hsslam_node.services.run_info import RunInfo
from hsslam_node.services.summary import read_summary


def run_subject(
    place: str, given: RecordedSource | None, say: Say
) -> tuple[Subject, dict[str, Any]]:
    """What the run left, and what is said of it beside its figures; of a log, or where a killed run has
    left no trajectory, what the log has.

    `given`: the source whose truth is meant, for a log that does not tell.

    Raises:
        UserError: neither run folder nor log, or a file in it is malformed.
    """
    folder = Path(place)
    if is_log(place):
        return log_subject(place.removeprefix("mcap:"), given, say)
    if folder.is_dir() and parts(folder) and not (folder / "trajectory.txt").exists():
        say(f"{place}: no trajectory.txt: what its log has is scored")
        return log_subject(place, given, say)
    return _folder_subject(folder, say)


def _folder_subject(folder: Path, say: Say) -> tuple[Subject, dict[str, Any]]:
    run = RunInfo.read(folder).options
    counts = read_summary(folder).get("frames", {})
    read = counts.get("in", 0) + counts.get("bad", 0)  # an interrupted run is judged so far
    mesh, saved = folder / "mesh.ply", folder / "map.safetensors"
    used = replace(run.source_options, frames=read or run.frames)
    source = recorded_source(run.source, used, say)
    subject = Subject(
        source=source.spec,
        options=source.options,
        trajectories=run_trajectories(folder),
        mesh=mesh if mesh.exists() else None,
        map=saved if saved.exists() else None,
        slam=run.slam,
    )
    about = {
        "run": str(folder),
        "source": run.source,
        "noise": run.noise,
        "preset": run.preset,
        "seed": run.seed,
        "pace": run.pace,
        "frames": counts,
    }
    return subject, about
