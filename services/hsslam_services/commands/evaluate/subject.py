"""Reads the subject of an evaluation: a run folder, or the log of a killed run."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from hsslam_node.errors import UserError
from hsslam_node.evaluation.evaluate import Subject
from hsslam_node.evaluation.evaluate_run import run_trajectories
from hsslam_node.sources.options.source import SourceOptions
from hsslam_proto import messages
from hsslam_proto.topics import FRAME
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.commands.log.newest_mesh import newest_mesh
from hsslam_services.log.parts import parts
from hsslam_services.log.reading.files import Say, is_log, log_parts
from hsslam_services.log.reading.poses import LoggedPoses, logged_poses
from hsslam_services.log.reading.reader import bus_messages
from hsslam_services.log.reading.source import (
    RecordedSource,
    frames_of_run,
    logged_options,
    recorded_source,
)
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.source_table import comes_once, log_place
from hsslam_services.run.summary import read_summary


@contextmanager
def source_of_run(place: str) -> Iterator[None]:
    """Name the run in errors of its source, which the user of a run folder has not typed."""
    try:
        yield
    except UserError as error:
        raise UserError(
            f"{place}: its source cannot be read: {error} (a relative path counts from the folder in which "
            "the run began)"
        ) from None


def log_subject(
    place: str, given: RecordedSource | None, say: Say
) -> tuple[Subject, dict[str, Any]]:
    """Poses and the newest mesh of the log (a file or a run folder), and entries beside the figures.

    `given`: the source of the truth; None: that of the log. If the source cannot be read again, and so has no
    truth, frames come from the log.

    Raises:
        UserError: `place` is no log, or the log does not name its source or holds no poses.
    """
    files = log_parts(place, say)
    found = logged_poses(files)
    if not len(found.online):
        raise UserError(f"{place}: holds no poses: expected the log of a run that has tracked")
    run = logged_options(files)
    source = given
    if source is None and run is None:
        raise UserError(f"{place}: does not name its source: expected --source, too")
    if source is None and run is not None:
        if comes_once(run.source):
            source = RecordedSource(f"mcap:{place}", SourceOptions())
        else:
            with source_of_run(place):
                source = recorded_source(run.source, _options(run, files, found), say)
    assert source is not None
    logged = newest_mesh(files)
    if logged is not None and not logged.is_final:
        say(f"{place}: no final mesh: scoring the live one, which may lack parts of the map")
    subject = Subject(
        source=source.spec,
        options=source.options,
        trajectories={
            "online": found.online,
            "final": found.final,
            "keyframes": found.keyframes,
        },
        mesh=None if logged is None else logged.triangles,
        slam=run.slam if run else None,
        open_it=open_any_source,
    )
    lost = len(found.poses) - len(found.online)
    frames = {"tracked": len(found.online), "lost": lost}
    about: dict[str, Any] = {"run": place, "source": source.spec, "frames": frames}
    if run is not None:
        about |= {name: getattr(run, name) for name in ("noise", "preset", "seed", "pace")}
    return subject, about


def _options(run: ServeOptions, files: list[Path], found: LoggedPoses) -> SourceOptions:
    """Options of the source for the frames that the log has, or has poses of; for all if there are several
    cameras."""
    frames = {(pose.publisher, pose.index) for pose in found.poses}
    for logged in bus_messages(files, {FRAME.name}):
        message = logged.message()
        assert isinstance(message, messages.Frame)
        frames.add((message.publisher, message.index))
    if len({publisher for publisher, _ in frames}) > 1:
        return run.source_options
    return frames_of_run(run, [index for _, index in frames])


def run_subject(
    place: str, given: RecordedSource | None, say: Say
) -> tuple[Subject, dict[str, Any]]:
    """The results of a run, and entries beside its figures; for a log, or a killed run without a trajectory,
    those of the log.

    `given`: the source of the truth, for a log that does not name it.

    Raises:
        UserError: `place` is neither run folder nor log, or a file in it is malformed.
    """
    folder = Path(place)
    if is_log(place):
        return log_subject(log_place(place) or place, given, say)
    if folder.is_dir() and parts(folder) and not (folder / "trajectory.txt").exists():
        say(f"{place}: no trajectory.txt: scoring poses and mesh of its log")
        return log_subject(place, given, say)
    return _folder_subject(folder, say)


def _folder_subject(folder: Path, say: Say) -> tuple[Subject, dict[str, Any]]:
    run = RunInfo.read(folder).options
    counts = read_summary(folder).get("frames", {})
    mesh, saved = folder / "mesh.ply", folder / "map.safetensors"
    source = _source_of_run(folder, run, counts, say)
    subject = Subject(
        source=source.spec,
        options=source.options,
        trajectories=run_trajectories(folder),
        mesh=mesh if mesh.exists() else None,
        map=saved if saved.exists() else None,
        slam=run.slam,
        open_it=open_any_source,
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


def _source_of_run(
    folder: Path, run: ServeOptions, counts: dict[str, int], say: Say
) -> RecordedSource:
    """The source of the frames of a run; its own log if the source cannot be read again."""
    if not comes_once(run.source):
        read = counts.get("in", 0) + counts.get("bad", 0)  # an interrupted run read fewer frames
        with source_of_run(str(folder)):
            return recorded_source(
                run.source, replace(run.source_options, frames=read or run.frames), say
            )
    if not parts(folder):
        raise UserError(
            f"{folder}: nothing to score: --source {run.source} cannot be read again, and there is no log: "
            "expected run.mcap with its frames"
        )
    return RecordedSource(f"mcap:{folder}", SourceOptions())
