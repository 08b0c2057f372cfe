"""A run folder as something to judge."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from hsslam_node.evaluation.evaluate import Subject
from hsslam_node.evaluation.evaluate_run import run_trajectories
from hsslam_node.services.run_info import RunInfo
from hsslam_node.services.summary import read_summary


def run_subject(folder: Path) -> tuple[Subject, dict[str, Any]]:
    """What the run left, and what is said of it beside its figures.

    Raises:
        UserError: not a run folder, or a file in it is malformed.
    """
    run = RunInfo.read(folder).options
    counts = read_summary(folder).get("frames", {})
    read = counts.get("in", 0) + counts.get("bad", 0)  # an interrupted run is judged so far
    mesh, saved = folder / "mesh.ply", folder / "map.safetensors"
    subject = Subject(
        source=run.source,
        options=replace(run.source_options, frames=read or run.frames),
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
