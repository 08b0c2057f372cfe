"""A log as files that other programs read."""

from collections.abc import Collection, Iterator
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.services.log.log_file import Say
from hsslam_node.services.log.log_options import Part


def export(files: list[Path], folder: Path, only: Collection[Part], say: Say) -> Iterator[str]:
    """Write the wanted parts of the log into the folder; yields a line for each that is written.

    What the log does not hold is told through `say`.

    Raises:
        UserError: the folder cannot be written, or holds such files of another log that are in the way.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if "trajectory" in only:
            from hsslam_node.services.log.export_trajectory import export_trajectory

            yield from export_trajectory(files, folder, say)
        if "mesh" in only:
            from hsslam_node.services.log.export_mesh import export_mesh

            yield from export_mesh(files, folder, say)
        if "frames" in only:
            from hsslam_node.services.log.export_frames import export_frames

            yield from export_frames(files, folder / "frames", say)
        if "rrd" in only:
            from hsslam_node.services.log.export_rrd import export_rrd

            yield from export_rrd(files, folder / "run.rrd")
    except OSError as error:
        place = error.filename or folder
        raise UserError(f"{place}: {error.strerror}: expected a folder to write to") from None
