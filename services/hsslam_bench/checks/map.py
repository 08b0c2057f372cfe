"""Rows of the map: a bound that grows keeps the first room; memory and time over a long run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import trimesh

from hsslam_bench.checks.accuracy import MESH_VERSION
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.sequences import QUICK_FRAMES
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Session
from hsslam_bench.runs.usage import memory_at, peak_memory
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import (
    WITHIN_M,
    MeshMetrics,
    compare_meshes,
    distances,
)
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory, read_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions

_EVERY = 10  # frames between the views
_TOLERANCE_M = 0.03
_SAMPLES = 100_000
_SEQUENCE = "apartment-kinect"
_FIRST_FRAMES = 300  # in the first room
_NO_WORSE = 1.05  # ratio by which two runs of one room differ anyway
GROWTH_FRAMES = (300, 1000, 3000)
GROWTH_ROOMS_M = (4.0, 8.0, 16.0)
_MEMORY_FRAMES, _ROOM_FRAMES = 1000, 600
_LAST_FRAMES = 150  # the time of a frame is the mean over these
_TOTAL_BYTES, _MAPPER_BYTES = 3.0e9, 1.2e9
_MIB = 2**20
Reading = Callable[[ServeRun], Mapping[str, float]]  # the first item is the main figure


@dataclass(frozen=True)
class FirstRoom:
    """The views of the first frames of a source, and its true surface."""

    mesh: trimesh.Trimesh
    truth: Trajectory  # of those frames
    views: Views


def first_room(spec: str, frames: int) -> FirstRoom:
    """Ground truth and noise-free views of the first frames of a source with a true mesh."""
    options = SourceOptions(frames=frames)
    truth = open_ground_truth(spec, options)
    mesh = truth.mesh() if truth else None
    if truth is None or mesh is None:
        raise ValueError(f"{spec}: expected a source with a true mesh")
    source = open_source(spec, SourceOptions(frames=-(-frames // _EVERY), stride=_EVERY))
    seen = [frame for frame in source.frames() if isinstance(frame, Frame)]
    row_of = {int(stamp): row for row, stamp in enumerate(truth.stamps_ns)}
    poses = truth.T_world_cam[[row_of[frame.stamp_ns] for frame in seen]]
    depths_m = np.stack([frame.depth_m() for frame in seen])
    views = Views(source.camera, poses, depths_m, _TOLERANCE_M)
    return FirstRoom(mesh, Trajectory(truth.stamps_ns[:frames], truth.T_world_cam[:frames]), views)


def score_first_room(room: FirstRoom, run: Path, other: Path | None = None) -> MeshMetrics:
    """Distances of the mesh of a run folder, aligned to the truth by the poses of the room's frames alone.

    `other`: only what the mesh of this run folder has as well, within 5 cm.
    """
    mesh = _aligned_mesh(room, run)
    if other is not None:
        mesh = _near(mesh, _aligned_mesh(room, other))
    return compare_meshes(mesh, room.mesh, room.views, samples=_SAMPLES)


def _aligned_mesh(room: FirstRoom, run: Path) -> trimesh.Trimesh:
    mesh = trimesh.load(run / "mesh.ply", process=False, force="mesh")
    assert isinstance(mesh, trimesh.Trimesh)
    aligned = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    aligned.apply_transform(ate(read_tum(run / "trajectory.txt"), room.truth).T_truth_estimate)
    return aligned


def _near(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> trimesh.Trimesh:
    """The triangles of a mesh whose centroids are within 5 cm of another."""
    is_near = distances(mesh.triangles_center, other.vertices, other.faces) < WITHIN_M
    return trimesh.Trimesh(mesh.vertices, mesh.faces[is_near], process=False)


def map_checks() -> list[Check]:
    """The check of the first room; the apartment's ATE is a refinement row."""
    return [
        Check(
            "bound-growth:first-room",
            f"{_SEQUENCE}, no bound given: mesh of what the first {_FIRST_FRAMES} frames saw, after the "
            "whole run against after those frames: mean accuracy of what both meshes have; completion "
            "within 5 cm",
            "no worse (5%)",
            _first_room,
            version=MESH_VERSION,
        )
    ]


def _first_room(session: Session) -> Measured:
    frames = QUICK_FRAMES // 2 if session.quick else _FIRST_FRAMES
    whole = finished(session.lockstep(_SEQUENCE))
    start = finished(session.lockstep(_SEQUENCE, frames=frames))
    room = first_room(session.source("apartment"), frames)
    before, after = (score_first_room(room, run.folder) for run in (start, whole))
    same_before = score_first_room(room, start.folder, whole.folder).accuracy_mean_m
    same_after = score_first_room(room, whole.folder, start.folder).accuracy_mean_m
    mapper = whole.summary.get("processes", {}).get("mapper", {})
    growths = mapper.get("counters", {}).get("growths", 0)
    lost_before = 1.0 - before.completion_ratio_5cm
    lost_after = 1.0 - after.completion_ratio_5cm
    return Measured(
        f"{100 * same_after:.2f} against {100 * same_before:.2f} cm; "
        f"{after.completion_ratio_5cm:.1%} against {before.completion_ratio_5cm:.1%}; "
        f"{growths} growths",
        same_after <= _NO_WORSE * same_before and lost_after <= _NO_WORSE * lost_before,
        {
            "before": asdict(before),
            "after": asdict(after),
            "same_before_m": same_before,
            "same_after_m": same_after,
            "growths": growths,
        },
        same_after,
        "lower",
    )


def growth_checks() -> list[Check]:
    """Memory, with a bound; growth, without one: docs/performance.md lists what must not grow."""
    memory = Check(
        "memory",
        f"{_MEMORY_FRAMES} frames of room, 640x480, real time: memory of all processes, peak",
        "3 GB, mapper 1.2 GB",
        _memory,
    )
    frames = [_growth_check("frames", what, unit, reading) for what, unit, reading in _READINGS]
    rooms = [_growth_check("room", what, unit, reading) for what, unit, reading in _READINGS]
    return [memory, *frames, *rooms]


def _memory(session: Session) -> Measured:
    """Peak PSS: shared pages are divided among the processes that use them."""
    run = finished(session.growing(_MEMORY_FRAMES))
    peak = peak_memory(run.usage)
    if not peak:
        return Measured("the memory of the processes cannot be read", False)
    total = sum(peak.values())
    mapper = max((sample.pss_bytes.get("mapper", 0) for sample in run.usage), default=0)
    each = ", ".join(f"{name} {size / 1e9:.2f}" for name, size in peak.items())
    return Measured(
        f"{total / 1e9:.2f} GB, mapper at most {mapper / 1e9:.2f} GB ({each})",
        total <= _TOTAL_BYTES and mapper <= _MAPPER_BYTES,
        {"total_bytes": total, "mapper_bytes": mapper, "by_process": peak},
        total,
        "lower",
    )


def _growth_check(of: str, what: str, unit: str, reading: Reading) -> Check:
    def measure(session: Session) -> Measured:
        if of == "frames":
            runs = [finished(session.growing(n)) for n in GROWTH_FRAMES]
        else:
            runs = [finished(session.growing(_ROOM_FRAMES, m)) for m in GROWTH_ROOMS_M]
        found = [reading(run) for run in runs]
        values = {run.name: dict(read) for run, read in zip(runs, found, strict=True)}
        return Measured(_columns(found), None, values)

    sizes = GROWTH_FRAMES if of == "frames" else [f"{m:g} m" for m in GROWTH_ROOMS_M]
    against = " / ".join(str(size) for size in sizes)
    whose = "frames of room" if of == "frames" else f"room, {_ROOM_FRAMES} frames"
    return Check(
        f"growth:{of}:{what.split(',')[0]}", f"{against} {whose}: {what}, {unit}", "", measure
    )


def _columns(found: Sequence[Mapping[str, float]]) -> str:
    names = {name: None for read in found for name in read}
    texts = []
    for name in names:
        cells = [read.get(name) for read in found]
        texts.append(f"{name} {' / '.join('-' if c is None else f'{c:.1f}' for c in cells)}")
    return "; ".join(texts)


def _tracked(run: ServeRun) -> Mapping[str, float]:
    frames = run.summary["frames"]
    return {"all": 100 * (frames["tracked"] - 1) / max(frames["in"] - 1, 1)}


def _time(run: ServeRun) -> Mapping[str, float]:
    used = run.core_ms_of_last(_LAST_FRAMES)
    return {"all": sum(used.values()), **{name: ms for name, ms in used.items() if ms >= 0.05}}


def _stages(run: ServeRun) -> Mapping[str, float]:
    processes = run.summary["processes"].values()
    return {stage: ms for process in processes for stage, ms in process["stage_ms"].items()}


def _memory_of(run: ServeRun) -> Mapping[str, float]:
    window = run.log.tracking_ns
    seen = memory_at(run.usage, window[1]) if window else {}
    return {"all": sum(seen.values()) / _MIB, **{name: n / _MIB for name, n in seen.items()}}


def _shared(run: ServeRun) -> Mapping[str, float]:
    return {"all": max((sample.shared_bytes for sample in run.usage), default=0) / _MIB}


def _disk(run: ServeRun) -> Mapping[str, float]:
    files = {name: n / _MIB for name, n in run.disk_bytes.items()}
    shown = {name: mib for name, mib in files.items() if mib >= 0.1}
    frames = max(run.summary["frames"]["in"], 1)
    return {"all": sum(files.values()), "KiB a frame": 1024 * sum(files.values()) / frames, **shown}


def _end(run: ServeRun) -> Mapping[str, float]:
    last_ns = max((pose.publish_ns for pose in run.log.poses), default=run.started_ns)
    return {"all": run.seconds - (last_ns - run.started_ns) / 1e9}


_READINGS: tuple[tuple[str, str, Reading], ...] = (
    ("tracked, of the frames after the first", "%", _tracked),
    (f"time, of the last {_LAST_FRAMES} frames", "ms of core time a frame", _time),
    ("stages, at the end", "ms", _stages),
    ("memory, when the last frame comes", "MiB", _memory_of),
    ("shared, largest", "MiB of /dev/shm", _shared),
    ("disk, of the run folder", "MiB", _disk),
    ("end, from the last pose to the exit", "s", _end),
)
