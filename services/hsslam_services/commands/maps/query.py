"""`hsslam-map query`: prints distances at points of a saved map."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.distance.occupancy import FAR_M
from hsslam_node.errors import UserError
from hsslam_services.commands.maps.whole_space import expect_far, map_file
from hsslam_services.commands.point_table import print_answers


@dataclass(frozen=True)
class QueryOptions:
    """Prints for points in a saved map: the distance to the nearest surface, its gradient, whether a keyframe
    saw the point, and the certainty.

    Examples:
      hsslam-map query map.safetensors --point 0.5 -0.2 2
      hsslam-map query map.safetensors --points places.txt --json

    Points are metres in the world frame of the map. The distance is negative behind a surface. Near a surface
    it comes from the neural field, else from the depth of the keyframes in voxels of 5 cm, 2 m at most. It is
    - (in JSON null) if no keyframe saw the point.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("map",)
    VALUES: ClassVar = {"map": "MAP", "point": "X Y Z..."}

    map: str = ""
    """Run folder, or the file of a saved map."""
    point: tuple[float, ...] = ()
    """Points, m: three numbers each."""
    points: Path | None = None
    """File with more points: lines X Y Z, with spaces or commas between, or a NumPy array [N, 3] (.npy)."""
    json: bool = False
    """Print JSON instead of a table."""
    far_m: float = FAR_M
    """Ignore surfaces and free space that keyframes saw only from beyond this distance, m."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """Where the map is evaluated; auto: an NVIDIA GPU if one works."""

    def __post_init__(self) -> None:
        expect_far(self.far_m)
        if len(self.point) % 3 or not np.isfinite(self.point).all():
            given = " ".join(f"{number:g}" for number in self.point)
            raise UserError(
                f"--point {given}: expected X Y Z in metres, three numbers for each point"
            )

    def places(self) -> np.ndarray:
        """All points [N, 3] m.

        Raises:
            UserError: there are none, or the file cannot be read.
        """
        given = np.array(self.point, np.float64).reshape(-1, 3)
        places = given if self.points is None else np.concatenate([given, read_points(self.points)])
        if len(places) == 0:
            raise UserError("query: no point: expected --point X Y Z or --points FILE")
        return places


def query_map(options: QueryOptions) -> None:
    """Run the command."""
    path = map_file(options.map, "query")
    places = options.places()
    saved = SavedMap.open(path, options.device, options.far_m)
    print_answers(places, saved.query(places), as_json=options.json)


def read_points(path: Path) -> np.ndarray:
    """The points [N, 3] m of a file: lines of three numbers, # begins a comment; or .npy.

    Raises:
        UserError: the file cannot be read, or has another format.
    """
    try:
        if path.suffix.lower() == ".npy":
            with path.open("rb") as stream:
                rows = np.lib.format.read_array(stream, allow_pickle=False)
        else:
            rows = _rows(path)
        points = rows.astype(np.float64, casting="same_kind")
    except OSError as error:
        raise UserError(f"--points {path}: {error.strerror}: expected a file of points") from None
    except (ValueError, TypeError, OverflowError, MemoryError) as error:
        reason = " ".join(str(error).split())
        raise UserError(
            f"--points {path}: {reason}: expected lines X Y Z, or [N, 3] in .npy"
        ) from None
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise UserError(
            f"--points {path}: {list(points.shape)}: expected finite metres [N, 3], X Y Z a line"
        )
    return points


def _rows(path: Path) -> np.ndarray:
    """Rows [N, 3] of a text file; ValueError names the line that has no three numbers."""
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        if words := line.partition("#")[0].replace(",", " ").split():
            try:
                x, y, z = map(float, words)
            except ValueError:
                raise ValueError(f"line {number}: {line.strip()[:60]!r}") from None
            rows.append((x, y, z))
    return np.array(rows, np.float64).reshape(-1, 3)
