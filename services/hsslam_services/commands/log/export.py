"""`hsslam-log export`: writes a log as files for other programs; poses in several formats."""

import csv
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from hsslam_node.durable_file import durable_file, write_durably
from hsslam_node.errors import UserError
from hsslam_node.export.trajectory_formats import (
    KITTI_TIMES,
    TRAJECTORY_FORMATS,
    TrajectoryFormat,
    stamps_text,
)
from hsslam_node.geometry.trajectory import Trajectory, format_stamp
from hsslam_proto import messages
from hsslam_services.commands.log.options import Part
from hsslam_services.commands.output_files import is_run_folder
from hsslam_services.log.reading.files import Say
from hsslam_services.log.reading.poses import LoggedPoses, logged_epochs

_ONLINE_CSV = "trajectory_online.csv"
_STEM = re.compile(r"(trajectory|keyframes|trajectory_online|trajectory_fragment_\d+)(\.epoch\d+)?")
_COLUMNS = (
    *("index", "timestamp_s", "tx_m", "ty_m", "tz_m", "qx", "qy", "qz", "qw", "status"),
    *(
        "quality",
        "inlier_ratio",
        "residual_mm",
        "latency_ms",
        "map_version",
        "keyframe",
        "map_epoch",
        "fragment",
    ),
)


def export(
    files: list[Path],
    folder: Path,
    only: Collection[Part],
    say: Say,
    form: TrajectoryFormat = "tum",
) -> Iterator[str]:
    """Write the parts `only` of the log into the folder; yields a line for each file written.

    `say` gets a line for each part that the log lacks. If the folder is a run's, already has frames, or a
    folder run.rrd, this writes nothing. Each file but the images of frames is written whole or not at all.

    Raises:
        UserError: the folder cannot be written, is a run's, or already has frames or a folder run.rrd.
    """
    _expect_room(folder, only)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if "trajectory" in only:
            yield from export_trajectory(files, folder, say, form)
        if "mesh" in only:
            from hsslam_services.commands.log.export_mesh import export_mesh

            yield from export_mesh(files, folder, say)
        if "frames" in only:
            from hsslam_services.commands.log.export_frames import export_frames

            yield from export_frames(files, folder / "frames", say)
        if "rrd" in only:
            from hsslam_services.commands.log.export_rrd import export_rrd

            yield from export_rrd(files, folder / "run.rrd")
    except OSError as error:
        place = error.filename or folder
        raise UserError(f"{place}: {error.strerror}: expected a folder to write to") from None


def _expect_room(folder: Path, only: Collection[Part]) -> None:
    if is_run_folder(folder):
        raise UserError(f"{folder}: is a run folder, whose results stay: expected another folder")
    for frames in (folder / "frames", *folder.glob("frames-[0-9]*")):
        if "frames" in only and (frames / "rgb.txt").exists():
            raise UserError(f"{frames}: already holds frames: expected a new folder")
    if "rrd" in only and (folder / "run.rrd").is_dir():
        raise UserError(f"{folder / 'run.rrd'}: is a folder: expected a file, or nothing there")


def export_trajectory(
    files: list[Path], folder: Path, say: Say, form: TrajectoryFormat
) -> Iterator[str]:
    """Write trajectories in this format; yields a line for each file.

    trajectory_online: poses as published, without lost frames; trajectory: the same poses, refined;
    keyframes: refined poses of keyframes; trajectory_fragment_1: poses of a fragment that has not joined the
    map. trajectory_online.csv has all fields of all published poses; in the format csv it replaces
    trajectory_online. After a reset of the map, these belong to the last map epoch; files of earlier epochs
    have the epoch in their name, as trajectory.epoch0.txt. Trajectories in this format that an earlier export
    wrote, and that the log lacks, are removed.
    """
    epochs = logged_epochs(files)
    poses = [pose for found in epochs.values() for pose in found.poses]
    suffixes = {epoch: "" if epoch == max(epochs) else f".epoch{epoch}" for epoch in epochs}
    online, refined = dict[str, Trajectory](), dict[str, Trajectory]()  # by stem
    if poses:
        for epoch, found in epochs.items():
            online[f"trajectory_online{suffixes[epoch]}"] = found.online
            refined |= _refined(found, suffixes[epoch])
    if not poses:
        _remove_others(folder, form, ())
        (folder / _ONLINE_CSV).unlink(missing_ok=True)
        say("no trajectory: the log holds no poses")
        return
    for stem, trajectory in online.items():
        if form != "csv":
            yield _write(folder / stem, trajectory, form)
    yield _write_csv(folder / _ONLINE_CSV, poses)
    for stem, trajectory in refined.items():
        yield _write(folder / stem, trajectory, form)
    _remove_others(folder, form, online.keys() | refined.keys())


def _refined(found: LoggedPoses, suffix: str) -> dict[str, Trajectory]:
    """Trajectories of a map epoch but the published one, by stem of their files; none is empty."""
    named = {"trajectory": found.final, "keyframes": found.keyframes}
    named |= {f"trajectory_fragment_{k}": poses for k, poses in found.fragments.items()}
    return {f"{name}{suffix}": poses for name, poses in named.items() if len(poses)}


def _remove_others(folder: Path, form: TrajectoryFormat, stems: Collection[str]) -> None:
    """Remove the trajectories in this format that an earlier export, of another log, has left."""
    endings = [TRAJECTORY_FORMATS[form][0], *([KITTI_TIMES] if form == "kitti" else [])]
    for path in folder.iterdir():
        for ending in endings:
            stem = path.name.removesuffix(ending)
            if stem != path.name and stem not in stems and _STEM.fullmatch(stem):
                path.unlink()


def _write(stem: Path, trajectory: Trajectory, form: TrajectoryFormat) -> str:
    ending, text = TRAJECTORY_FORMATS[form]
    path = stem.with_name(stem.name + ending)
    write_durably(path, text(trajectory).encode())
    if form == "kitti":
        write_durably(stem.with_name(stem.name + KITTI_TIMES), stamps_text(trajectory).encode())
    return f"{path}: {len(trajectory)} poses"


def _write_csv(path: Path, poses: list[messages.Pose]) -> str:
    with durable_file(path, suffix="") as partial, partial.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(_COLUMNS)
        for p in poses:
            latency_ms = f"{(p.publish_ns - p.stamp_ns) / 1e6:.3f}"
            quality = (p.quality, p.inlier_ratio, p.residual_mm, latency_ms)
            stamp = format_stamp(p.source_stamp_ns)
            of_map = (p.map_version, p.keyframe, p.map_epoch, p.fragment)
            writer.writerow((p.index, stamp, *p.t, *p.q, p.status, *quality, *of_map))
    return f"{path}: {len(poses)} poses"
