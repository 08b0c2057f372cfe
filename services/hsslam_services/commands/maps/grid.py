"""`hsslam-map grid`: writes the floor of a saved map for Nav2's map server."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, grid_map
from hsslam_node.distance.nav2_files import write_nav2_files
from hsslam_node.distance.occupancy import FAR_M
from hsslam_node.errors import UserError
from hsslam_services.commands.maps.whole_space import (
    expect_far,
    expect_space,
    floor_and_space,
    map_file,
)
from hsslam_services.commands.output_files import expect_file


@dataclass(frozen=True)
class GridOptions:
    """Writes the floor of a saved map for Nav2: free, occupied and unknown cells as map.yaml and map.pgm.

    Example:
      hsslam-map grid runs/desk --out map.yaml --to-height-m 0.6

    A cell is occupied if a keyframe measured a surface over it from less than --far-m and between the two
    heights above the floor. Of the other cells, those over which keyframes saw a third of this height or more
    are free, and the rest are unknown. The frame of the map has z up and the floor at z = 0.
    It is that of hsslam-serve --grid: if the run had --base-T-camera or --ros2-out, x and y are those of the
    frame map in ROS. Otherwise up is against gravity if the run had an IMU, else the normal of the floor that
    the keyframes saw, else the mean up of their images. The command prints which.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("run",)
    VALUES: ClassVar = {"run": "RUN", "up": "X Y Z"}
    ALIASES: ClassVar = {"out": "-o"}

    run: str = ""
    """Run folder, or the file of a saved map."""
    out: Path = Path("map.yaml")
    """Output file .yaml; the picture .pgm is written beside it."""
    from_height_m: float = 0.15
    """Lowest height of obstacles above the floor, m; if above 0, at least --voxel."""
    to_height_m: float = 1.6
    """Highest height of obstacles above the floor, m."""
    up: tuple[float, ...] = ()
    """Direction against gravity in the world frame of the map (none: estimated)."""
    base_T_camera: tuple[float, ...] = ()
    """Pose of the camera in base_link: x y z qx qy qz qw, m, optical axes (none: that of the run)."""
    voxel: float = 0.05
    """Side of a cell and height of a layer, m; layers that begin between the two heights count."""
    far_m: float = FAR_M
    """Ignore surfaces and free space that keyframes saw only from beyond this distance, m."""

    def __post_init__(self) -> None:
        expect_space(self.from_height_m, self.to_height_m, self.up, self.base_T_camera, self.voxel)
        expect_far(self.far_m)
        if 0 < self.from_height_m < self.voxel:
            raise UserError(
                f"--voxel {self.voxel:g} --from-height-m {self.from_height_m:g}: expected --voxel of at most "
                f"{self.from_height_m:g}: a larger voxel holds both the floor and obstacles on it"
            )


def write_grid(options: GridOptions) -> None:
    """Run the command."""
    path = map_file(options.run, "grid")
    expect_file("--out", options.out, (".yaml",))
    saved = SavedMap.open(path, "cpu")
    floor, space = floor_and_space(
        saved, options.up, options.base_T_camera, options.voxel, options.far_m
    )
    grid = grid_map(space, options.from_height_m, options.to_height_m)
    picture = write_nav2_files(options.out, grid, floor)
    height, width = grid.cells.shape
    counts = {
        name: int(np.count_nonzero(grid.cells == value))
        for name, value in (("free", CELL_FREE), ("occupied", CELL_OCCUPIED))
    }
    cells = ", ".join(f"{count} {name}" for name, count in counts.items())
    print(floor.text)
    print(
        f"{options.out}, {picture.name}: {width} x {height} cells of {options.voxel:g} m, {cells}"
    )
