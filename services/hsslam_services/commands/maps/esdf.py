"""`hsslam-map esdf`: writes the distances in a saved map as arrays."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.esdf_file import write_esdf
from hsslam_node.distance.occupancy import FAR_M
from hsslam_node.distance.states import FREE, OCCUPIED
from hsslam_services.commands.maps.whole_space import (
    expect_far,
    expect_space,
    floor_and_space,
    map_file,
)
from hsslam_services.commands.output_files import expect_file


@dataclass(frozen=True)
class EsdfOptions:
    """Writes the distance to the nearest surface at every voxel of a saved map, as NumPy arrays: esdf.npz.

    Example:
      hsslam-map esdf runs/desk --out esdf.npz

    Arrays: distance_m [nx, ny, nz] (m, negative inside, nan far from seen space), states [nx, ny, nz]
    (0 unknown, 1 free, 2 occupied; the distance of an unknown voxel is a guess), voxel_m, first [3]
    (voxel i, j, k has its middle at voxel_m times first + i, j, k + 0.5), T_grid_world [4, 4] (from the
    world of the map to the frame of hsslam-map grid, z up and the floor at z = 0), up [3], up_source,
    floor_height_m. Unknown voxels are no surfaces: where one is nearer than the distance, an unseen surface
    may be, too.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("run",)
    VALUES: ClassVar = {"run": "RUN", "up": "X Y Z"}
    ALIASES: ClassVar = {"out": "-o"}

    run: str = ""
    """Run folder, or the file of a saved map."""
    out: Path = Path("esdf.npz")
    """Output file .npz."""
    from_height_m: float = -math.inf
    """Lowest height above the floor, m (-inf: all)."""
    to_height_m: float = math.inf
    """Highest height above the floor, m (inf: all)."""
    up: tuple[float, ...] = ()
    """Direction against gravity in the world frame of the map (none: estimated)."""
    base_T_camera: tuple[float, ...] = ()
    """Pose of the camera in base_link: x y z qx qy qz qw, m, optical axes (none: that of the run)."""
    voxel: float = 0.05
    """Side of a voxel, m."""
    far_m: float = FAR_M
    """Ignore surfaces and free space that keyframes saw only from beyond this distance, m."""

    def __post_init__(self) -> None:
        expect_space(self.from_height_m, self.to_height_m, self.up, self.base_T_camera, self.voxel)
        expect_far(self.far_m)


def write_distances(options: EsdfOptions) -> None:
    """Run the command."""
    path = map_file(options.run, "esdf")
    expect_file("--out", options.out, (".npz",))
    saved = SavedMap.open(path, "cpu")
    floor, space = floor_and_space(
        saved, options.up, options.base_T_camera, options.voxel, options.far_m
    )
    distances = DistanceMeter().measure(space).between(options.from_height_m, options.to_height_m)
    write_esdf(options.out, distances, floor)
    shape = " x ".join(map(str, distances.grid.shape))
    free, occupied = (np.count_nonzero(distances.states == state) for state in (FREE, OCCUPIED))
    print(floor.text)
    print(f"{options.out}: {shape} voxels of {options.voxel:g} m, {free} free, {occupied} occupied")
