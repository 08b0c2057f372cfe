"""The mesh, and the box of space that map and mesh cover."""

from dataclasses import dataclass

from hsslam_node.config.checks import expect_not_negative, expect_positive
from hsslam_node.errors import UserError


@dataclass(frozen=True)
class MesherConfig:
    """Mesh extraction."""

    voxel_m: float = 0.03
    """Voxel of the live mesh, m."""
    final_voxel_m: float = 0.03
    """Voxel of the mesh that is saved, m."""
    every_s: float = 5.0
    """Time between live meshes, s; 0: no live mesh."""

    def __post_init__(self) -> None:
        expect_positive(self, "mesher", "voxel_m", "final_voxel_m")
        expect_not_negative(self, "mesher", "every_s")


@dataclass(frozen=True)
class BoundConfig:
    """The box that the map covers, derived from the first frame (world = first camera), and its growth."""

    margin: float = 1.6
    """Reach of the box beyond the farthest depth of the first frame, times that depth."""
    least_m: float = 3.0
    """Least reach, m."""
    most_m: float = 12.0
    """Most reach, m."""
    grow: bool = True
    """Whether the box grows when a keyframe sees past it."""
    growth_m: float = 2.0
    """It then grows so far beyond what was seen, m; up and down 0.4 times that."""
    farthest_m: float = 50.0
    """It never reaches farther from the first camera, m."""

    def __post_init__(self) -> None:
        expect_positive(self, "bound", "margin", "least_m", "growth_m", "farthest_m")
        if not self.most_m >= self.least_m:
            raise UserError(
                f"bound.most_m = {self.most_m}: expected at least bound.least_m = {self.least_m}"
            )
