"""Distances in a file: esdf.npz, read with NumPy alone."""

from pathlib import Path

import numpy as np

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.floor_plane import FloorPlane
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError, one_line

_FORMAT = "hsslam-esdf 1"


def write_esdf(path: Path, distances: DistanceMap, floor: FloorPlane) -> None:
    """Write the distances and what is known of each voxel.

    | array | |
    |---|---|
    | `distance_m` [nx, ny, nz] float32 | m to the nearest surface, negative inside, nan far from seen space |
    | `states` [nx, ny, nz] uint8 | 0 unknown (the distance is a guess), 1 free, 2 occupied |
    | `voxel_m`, `first` [3] | voxel (i, j, k) has its middle at `voxel_m * (first + (i, j, k) + 0.5)` |
    | `T_grid_world` [4, 4] | from the frame of the run to that of the voxels |
    | `up` [3], `up_source` | direction against gravity in the frame of the run, and how it was found |
    | `floor_height_m` | of the floor along `up`, over the origin of the run |
    | `format` | "hsslam-esdf 1" |

    Raises:
        UserError: the path does not end in .npz, or cannot be written.
    """
    if path.suffix.lower() != ".npz":
        raise UserError(f"{path}: expected a name that ends in .npz, as esdf.npz")
    try:
        # a stream, as NumPy adds .npz to a name that ends in .NPZ
        with durable_file(path) as partial, partial.open("wb") as stream:
            np.savez_compressed(
                stream,
                format=np.array(_FORMAT),
                distance_m=distances.distance_m,
                states=distances.states,
                voxel_m=np.array(distances.grid.voxel_m),
                first=np.array(distances.grid.first, np.int64),
                T_grid_world=distances.T_grid_world,
                up=np.array(floor.up),
                up_source=np.array(floor.source),
                floor_height_m=np.array(floor.height_m),
            )
    except OSError as error:
        raise UserError(f"{path}: cannot write distances: {error.strerror}") from None


def read_esdf(path: Path) -> tuple[DistanceMap, FloorPlane]:
    """What `write_esdf` wrote.

    Raises:
        UserError: no such file, or not one of distances.
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file: expected distances that hsslam-map has written")
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["format"]) != _FORMAT:
                raise ValueError(f"format {file['format']}")
            states, first = file["states"], [int(n) for n in file["first"]]
            nx, ny, nz = states.shape
            grid = VoxelGrid(float(file["voxel_m"]), (first[0], first[1], first[2]), (nx, ny, nz))
            distances = DistanceMap(grid, file["distance_m"], states, file["T_grid_world"])
            x, y, z = (float(value) for value in file["up"])
            source = str(file["up_source"])
            floor = FloorPlane((x, y, z), float(file["floor_height_m"]), source)  # type: ignore[arg-type]
    except Exception as error:  # NumPy, zipfile and zlib raise errors of many types
        raise UserError(f"{path}: not a file of distances: {one_line(error)}") from None
    return distances, floor
