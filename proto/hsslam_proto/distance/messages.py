"""Messages of free space and distances around the camera."""

from typing import Annotated

from msgspec import Meta

from hsslam_node.distance.states import BLOCK_SIDE as SIDE
from hsslam_proto.message import (
    Index,
    Message,
    Name,
    Quaternion,
    Real,
    SizePx,
    StampNs,
    Vector,
    expect_bytes,
    expect_pose,
)

BlockVoxels = Annotated[int, Meta(ge=SIDE, le=SIDE)]


class Raster(Message, frozen=True, kw_only=True):
    """A level grid of `height` rows of `width` cells of `resolution_m`, over the floor."""

    index: Index
    stamp_ns: StampNs
    source_stamp_ns: StampNs
    t: Vector
    q: Quaternion
    resolution_m: Real
    width: SizePx
    height: SizePx
    low_m: Real
    high_m: Real
    up_by: Name
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        _expect_place(self, self.resolution_m, "resolution_m")
        if not self.low_m < self.high_m:
            raise ValueError(
                f"low_m = {self.low_m}, high_m = {self.high_m}: expected low_m < high_m"
            )


class Grid(Raster, frozen=True, kw_only=True):
    """Free and occupied cells of the floor around the camera, as of frame `index`.

    `cells` is [height, width] int8: -1 unknown, 0 free, 100 occupied from `low_m` to `high_m` above the
    floor. The corner of cell (0, 0) lies at `t` in the world, on the floor. Rows go along y, columns along x
    of the grid's frame, whose z is up; `q` rotates that frame into the world. `up_by` is the source of the
    direction up: "gravity" (of an IMU), "floor plane", "camera poses" (no floor seen yet),
    "--base-T-camera", "level camera" (assumed with --ros2-out if --base-T-camera is not given).
    """

    cells: memoryview

    def __post_init__(self) -> None:
        super().__post_init__()
        expect_bytes(self, "cells", self.width * self.height)


class Esdf(Raster, frozen=True, kw_only=True):
    """Distance in the plane of the floor from each cell of a `Grid` to the nearest occupied cell.

    `distance_mm` is [height, width] int16 mm from the middle of the cell to the nearest edge of an occupied
    one: 0 if it is occupied itself, at most 2000, -32768 if it is unknown. The surface in the occupied cell
    is not nearer, and up to a diagonal of a cell farther. All other fields are as in `Grid`.
    """

    distance_mm: memoryview

    def __post_init__(self) -> None:
        super().__post_init__()
        expect_bytes(self, "distance_mm", 2 * self.width * self.height)


class EsdfBlocks(Message, frozen=True, kw_only=True):
    """Distances to the nearest surface in a box around the camera, in cubes of 16 x 16 x 16 voxels.

    `blocks` [B, 3] int32 (x, y, z): block b begins at voxel 16 * b of a lattice. The lowest corner of its
    voxel (0, 0, 0) lies at `t` in the world; `q` rotates its axes into the world, z is up.
    `distance_mm` [B, 16, 16, 16] int16 mm, x fastest, then y: signed, negative behind a surface, at most
    2000, at the voxels' middles; -32768: unknown. For interpolation, unknown voxels that touch a known one
    have a distance too. Surfaces outside the box are not known. A block replaces its earlier version; it is
    sent again if a distance has changed by more than 5 mm. `first` and `voxels` are the first voxel and the
    size of the box: blocks that lie wholly outside are gone. `series` grows when the lattice changes: blocks
    of earlier series are gone. The answer to a `get` on the key is all current blocks, measured within the
    last second or at the next update; there is no answer if no update comes for a second.
    """

    index: Index
    stamp_ns: StampNs
    series: Index
    revision: Index
    t: Vector
    q: Quaternion
    voxel_m: Real
    block_voxels: BlockVoxels = SIDE
    first: tuple[int, int, int]
    voxels: tuple[SizePx, SizePx, SizePx]
    blocks: memoryview
    distance_mm: memoryview
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        _expect_place(self, self.voxel_m, "voxel_m")
        if max(map(abs, self.first)) >= 2**31:
            raise ValueError(f"first = {self.first}: expected voxels below 2^31")
        count = memoryview(self.blocks).nbytes // 12
        expect_bytes(self, "blocks", 12 * count)
        expect_bytes(self, "distance_mm", 2 * SIDE**3 * count)


def _expect_place(message: Raster | EsdfBlocks, side_m: float, name: str) -> None:
    if not 0 < side_m < 1e3:
        raise ValueError(f"{name} = {side_m}: expected metres above 0")
    expect_pose(message.t, message.q)
