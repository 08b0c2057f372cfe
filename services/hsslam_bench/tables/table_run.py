"""One run of a table, in a process of its own: `python -m ... FOLDER/JOB.json [--score]`.

It tracks and maps every frame in turn, as lockstep does, and writes trajectories, mesh, map and `result.json`
to FOLDER. With `--score` it only scores the trajectories, mesh and map in FOLDER. Progress is a line on
stdout with the frames done and the number of all frames.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from hsslam_bench.tables.plan import Job
from hsslam_node.config import BoundConfig
from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_node.errors import UserError
from hsslam_node.evaluation.evaluate import Evaluator, Subject, Wanted
from hsslam_node.evaluation.evaluate_run import evaluate_run, run_trajectories
from hsslam_node.evaluation.ground_truth import GroundTruth, open_ground_truth
from hsslam_node.evaluation.scores import scores_as_json
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.map.epoch_poses import online_trajectory
from hsslam_node.map.pose_log import LOST
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import Source
from hsslam_node.warm_start import warm_start

RESULT = "result.json"
_MAP = "map.safetensors"
_REPORT_EVERY = 5  # frames
_CM = 100.0


def main() -> None:
    """Exit code 0: done; 2: failed, with one line on stderr."""
    path = Path(sys.argv[1])
    try:
        job = msgspec.json.decode(path.read_bytes(), type=Job)
        if sys.argv[2:] == ["--score"]:
            found = score(job, path.parent)
        else:
            found = table_run(job, path.parent, lambda done, all: print(done, all, flush=True))
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    (path.parent / RESULT).write_bytes(msgspec.json.encode(found))


def table_run(job: Job, folder: Path, report: Callable[[int, int], None]) -> dict[str, Any]:
    """Run a job, write its files to `folder`; returns {"values": by metric, "details": ...}.

    Raises:
        UserError: the source is not readable, or has no readable frame.
    """
    torch.set_num_threads(1)
    source = open_source(job.source, job.frames)  # first, as it may raise
    device = choose_device(job.device)
    truth = open_ground_truth(job.source, job.frames)
    config = replace(job.config, bound=bound_in_box(job, truth))
    warm_start(config, device)  # load compiled kernels first, for all rows
    slam = Slam(config, job.seed, device=device)
    seconds = _track(source, slam, report, device)
    rows = slam.pose_log.rows()
    if slam.store is None or slam.parameters is None:
        raise UserError(f"{job.source}: no readable frame: expected at least one")
    poses = slam.store.poses()
    write_tum(folder / "trajectory_online.txt", online_trajectory(rows))
    write_tum(folder / "trajectory.txt", slam.trajectory())
    stamps = slam.store.stamps_ns()[: len(poses)]
    write_tum(folder / "keyframes.txt", Trajectory(stamps, poses))
    params = slam.parameters
    # the literature meshes its whole box, and protocols cull: needs a box, and a true mesh to cull by
    everywhere = bool(job.box) and truth is not None and truth.load_mesh is not None
    mesh = slam.mesh(config.mesher.final_voxel_m, everywhere=everywhere)
    if len(mesh.faces):
        mesh.export(folder / "mesh.ply")
    slam.save(folder / _MAP)
    found = score(job, folder)
    sizes = params.layout.size_bytes_by_part()
    found["details"] |= {
        "model_bytes": sizes,
        "frames": len(rows),
        "keyframes": slam.store.count,
        "adam_steps": params.step,
        "seconds": seconds,
        "device": str(device),
    }
    found["values"] |= {
        "lost": float(np.count_nonzero(rows["status"] == LOST)),
        "model_mib": sum(sizes.values()) / 2**20,
        "fps": len(rows) / seconds,
    }
    return found


def bound_in_box(job: Job, truth: GroundTruth | None) -> BoundConfig:
    """The bound of the job's configuration, with its box and the first camera's pose in it.

    As in the originals, the true first pose is given, so that the box fits. It only places the world.
    """
    if not job.box or truth is None:
        return job.config.bound
    first = truth.T_world_cam[0][:3].ravel().tolist()
    return replace(job.config.bound, box=job.box, first_camera=tuple(first))


def score(job: Job, folder: Path) -> dict[str, Any]:
    """The accuracy of the trajectories, the mesh and the map in `folder`, as `table_run` returns it."""
    report = evaluate_run(folder, job.source, job.frames) or {}
    if (folder / _MAP).exists():
        trajectories = run_trajectories(folder)
        subject = Subject(job.source, job.frames, trajectories, map=folder / _MAP, slam=job.config)
        figures = Evaluator(subject, Wanted(consistency=False)).evaluate().figures
        report["rendering"] = scores_as_json(figures.get("rendering", {}))
    return {"values": _accuracy(report), "details": {"evaluation": report}}


def _track(source: Source, slam: Slam, report: Callable[[int, int], None], device: Device) -> float:
    """Track and map all frames; returns the seconds: process time on the CPU, so that other load does not
    matter, wall time on a GPU."""
    clock = time.perf_counter if device.uses_triton else time.process_time
    tracked, seconds = 0, 0.0
    for frame in source.frames():
        if not isinstance(frame, Frame):
            continue
        start = clock()
        slam.process(frame)
        seconds += clock() - start
        tracked += 1
        if tracked % _REPORT_EVERY == 0:
            report(tracked, source.frame_count or 0)
    start = clock()
    slam.finish()
    return seconds + clock() - start


def _accuracy(report: dict[str, Any]) -> dict[str, float | None]:
    """The metrics of the tables that the evaluation's report has."""
    ate, mesh = report.get("ate", {}), report.get("mesh", {})
    published = report.get("mesh_literature", {})
    final, online = ate.get("final", {}), ate.get("online", {})
    rendering = report.get("rendering") or {}
    found = {
        "ate_cm": _times(final.get("rmse_m"), _CM),
        "ate_mean_cm": _times(final.get("mean_m"), _CM),
        "ate_online_cm": _times(online.get("rmse_m"), _CM),
        "accuracy_cm": _times(mesh.get("accuracy_mean_m"), _CM),
        "completion_cm": _times(mesh.get("completion_mean_m"), _CM),
        "completion_pct": _times(mesh.get("completion_ratio_5cm"), 100.0),
        "accuracy_lit_cm": _times(published.get("accuracy_mean_m"), _CM),
        "completion_lit_cm": _times(published.get("completion_mean_m"), _CM),
        "completion_lit_pct": _times(published.get("completion_ratio_5cm"), 100.0),
        "depth_l1_cm": _times(mesh.get("depth_l1_m"), _CM),
        "psnr_db": rendering.get("psnr_db"),
        "ssim": rendering.get("ssim"),
    }
    return {name: value for name, value in found.items() if value is not None}


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


if __name__ == "__main__":
    main()
