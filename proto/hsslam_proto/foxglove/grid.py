"""The grid of free cells as a Foxglove Grid; alone, as it makes the pixels itself."""

import numpy as np
from foxglove_schemas_protobuf.Grid_pb2 import Grid as FoxgloveGrid
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField

from hsslam_proto.distance.arrays import cells_of
from hsslam_proto.distance.messages import Grid

_FREE, _OCCUPIED = (225, 235, 225, 150), (40, 40, 60, 230)  # RGBA; unknown cells are transparent
_CHANNELS = ("red", "green", "blue", "alpha")


def drawn_grid(message: Grid, frame: str) -> FoxgloveGrid:
    """A `foxglove.Grid` with one colour per cell, on the floor, in the frame `frame`."""
    cells = cells_of(message)
    colors = np.zeros((*cells.shape, 4), np.uint8)
    colors[cells == 0] = _FREE
    colors[cells > 0] = _OCCUPIED
    grid = FoxgloveGrid(
        frame_id=frame,
        column_count=message.width,
        row_stride=4 * message.width,
        cell_stride=4,
        fields=[
            PackedElementField(name=name, offset=k, type=PackedElementField.UINT8)
            for k, name in enumerate(_CHANNELS)
        ],
        data=colors.tobytes(),
    )
    grid.timestamp.FromNanoseconds(message.stamp_ns)
    grid.cell_size.x = grid.cell_size.y = message.resolution_m
    position, turn = grid.pose.position, grid.pose.orientation
    position.x, position.y, position.z = message.t
    turn.x, turn.y, turn.z, turn.w = message.q
    return grid
