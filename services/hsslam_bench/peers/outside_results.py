"""Results that a user brings from other systems: a trajectory, and a mesh if there is one."""

from dataclasses import dataclass
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import GroundTruth
from hsslam_node.evaluation.trajectory.ate import at_true_stamps
from hsslam_node.geometry.trajectory import Trajectory, read_estimate
from hsslam_node.sources.files.truth_files import read_matrices
from hsslam_node.user_path import user_path

_EXPECTED = "expected NAME=trajectory.txt, NAME=trajectory.txt,mesh.ply or NAME=FOLDER"
_TRAJECTORY, _MESH = "trajectory.txt", "mesh.ply"
_MATRIX_NUMBERS = 16


@dataclass(frozen=True)
class OutsideResult:
    """Files of one system on one sequence; the mesh (m) lies in the world of the trajectory."""

    name: str
    trajectory: Path
    mesh: Path | None = None


def parsed_result(text: str) -> OutsideResult:
    """Parse `NAME=trajectory.txt[,mesh.ply]`, or `NAME=FOLDER` with files of these names.

    Raises:
        UserError: the text is neither.
    """
    name, equals, places = text.partition("=")
    trajectory, comma, mesh = places.partition(",")
    if not (name and equals and trajectory) or (comma and not mesh):
        raise UserError(f"--result {text}: {_EXPECTED}")
    place = user_path(trajectory)
    if not comma and place.is_dir():
        beside = place / _MESH
        return OutsideResult(name, place / _TRAJECTORY, beside if beside.exists() else None)
    return OutsideResult(name, place, user_path(mesh) if comma else None)


def results_in(folder: Path, sequence: str) -> list[OutsideResult]:
    """The results `FOLDER/SEQUENCE/NAME.txt`, each with the mesh `NAME.ply` if there is one."""
    found = []
    for path in sorted((folder / sequence).glob("*.txt")):
        mesh = path.with_suffix(".ply")
        found.append(OutsideResult(path.stem, path, mesh if mesh.exists() else None))
    return found


def read_trajectory(path: Path, truth: GroundTruth | None) -> Trajectory:
    """Camera-to-world poses (OpenCV axes) with the stamps of their frames.

    The file is in TUM format (each pose gets the stamp of the frame within 20 ms), or has a line of 16
    numbers for each frame, as Replica's `traj.txt`.

    Raises:
        UserError: the file is neither, or its number of lines differs from the number of frames.
    """
    if not _is_of_matrices(path):
        found = read_estimate(path)
        return found if truth is None else at_true_stamps(found, truth.trajectory)
    poses = read_matrices(path)
    count = None if truth is None else len(truth.stamps_ns)
    if truth is None or len(poses) != count:
        known = "a source with a true pose for every frame" if truth is None else f"{count} lines"
        raise UserError(f"{path}: {len(poses)} poses without stamps: expected {known}")
    return Trajectory(truth.stamps_ns, poses)


def _is_of_matrices(path: Path) -> bool:
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        return False  # read_tum reports the error
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return len(first.split()) == _MATRIX_NUMBERS
