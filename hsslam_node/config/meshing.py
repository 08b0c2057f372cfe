"""The mesh, and the box of space that map and mesh cover."""

import math
from dataclasses import dataclass

from hsslam_node.config.checks import expect_in_range, expect_not_negative
from hsslam_node.errors import UserError

VOXEL_RANGE_M = (0.001, 1.0)  # of a mesh


@dataclass(frozen=True)
class MesherConfig:
    """Mesh extraction."""

    voxel_m: float = 0.03
    """Voxel size of the live mesh, m."""
    final_voxel_m: float = 0.03
    """Voxel size of the saved mesh, m."""
    every_s: float = 5.0
    """Time between live meshes, s; 0 turns them off."""

    def __post_init__(self) -> None:
        expect_in_range(self, "mesher", "voxel_m", *VOXEL_RANGE_M)
        expect_in_range(self, "mesher", "final_voxel_m", *VOXEL_RANGE_M)
        expect_not_negative(self, "mesher", "every_s")


@dataclass(frozen=True)
class BoundConfig:
    """The box that the map covers: set by the first frame (world frame = first camera), then it grows."""

    margin: float = 1.6
    """Reach of the box, times the farthest depth of the first frame."""
    least_m: float = 3.0
    """Smallest reach, m."""
    most_m: float = 12.0
    """Largest reach, m."""
    grow: bool = True
    """Let the box grow if a keyframe sees beyond it."""
    growth_m: float = 2.0
    """Growth beyond what the keyframe sees, m; up and down 0.4 times this."""
    farthest_m: float = 50.0
    """Largest distance of the box from the first camera, m."""
    box: tuple[float, ...] = ()
    """The box itself, m: lowest x y z, then highest x y z; it does not grow. If not set, the first frame
    sets it. A saved map covers both its own box and this one."""
    first_camera: tuple[float, ...] = ()
    """Pose of the first camera in the world of `box`: the rows of the 3x4 matrix that maps camera points to
    world points, m. If not set, the first camera is the world's origin. Not with a saved map."""

    def __post_init__(self) -> None:
        low, high = self.box[:3], self.box[3:]
        is_box = len(self.box) == 6 and all(a < b for a, b in zip(low, high, strict=True))
        if self.box and not (is_box and all(map(math.isfinite, self.box))):
            raise UserError(
                f"bound.box = {self.box}: expected six numbers: lowest x y z, then a higher x y z"
            )
        if self.first_camera and not (self.box and _is_rigid(self.first_camera)):
            raise UserError(
                f"bound.first_camera = {self.first_camera}: expected the rows of a rigid 3x4 matrix, and "
                "bound.box"
            )
        expect_in_range(self, "bound", "margin", 0.1, 100.0)
        for name in ("least_m", "most_m", "growth_m", "farthest_m"):
            expect_in_range(self, "bound", name, 0.01, 1000.0)
        if not self.most_m >= self.least_m:
            raise UserError(
                f"bound.most_m = {self.most_m}: expected at least bound.least_m = {self.least_m}"
            )


def _is_rigid(rows: tuple[float, ...]) -> bool:
    """Whether these 12 numbers are the rows [3, 4] of a rotation and a translation."""
    if len(rows) != 12 or not all(map(math.isfinite, rows)):
        return False
    x, y, z = (rows[k : k + 3] for k in (0, 4, 8))
    products = (sum(p * q for p, q in zip(a, b, strict=True)) for a in (x, y, z) for b in (x, y, z))
    unit = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    volume = sum(x[i] * (y[i - 2] * z[i - 1] - y[i - 1] * z[i - 2]) for i in range(3))
    return volume > 0 and all(abs(p - u) < 1e-4 for p, u in zip(products, unit, strict=True))
