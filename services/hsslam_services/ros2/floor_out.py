"""Publishes free cells and distances of the floor to ROS 2, from the run's own topics."""

import numpy as np

from hsslam_node.distance.grid_map import CELL_UNKNOWN
from hsslam_proto import topics
from hsslam_proto.distance.arrays import T_world_raster, cells_of, slice_m
from hsslam_proto.distance.messages import Esdf, Grid, Raster
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.subscription import Subscription
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import Qos
from hsslam_services.ros2.node import RosNode

_UNKNOWN_M = 1000.0  # as nvblox has it


class FloorOut:
    """Publishes each grid, and distances while a ROS node subscribes to them.

    `frame`: name of the frame `map`; the grid lies along its axes. `has_ros_stamps`: the source has stamps
    of ROS.
    """

    def __init__(
        self,
        bus: Bus,
        node: RosNode,
        messages: RosMessages,
        frame: str,
        *,
        has_ros_stamps: bool,
    ) -> None:
        self._bus, self._messages = bus, messages
        self._frame = frame
        self._has_ros_stamps = has_ros_stamps
        self._grids = bus.subscribe(topics.GRID, 1, history=True)
        self._slices: Subscription[Esdf] | None = None
        self._last: Grid | None = None
        self._map = node.publisher("map", "nav_msgs/msg/OccupancyGrid", Qos(1, is_latched=True))
        self._distances = node.publisher(
            "static_map_slice", "nvblox_msgs/msg/DistanceMapSlice", Qos(1)
        )

    def tell_news(self, T_map_world: np.ndarray) -> None:
        """Publish the newest grid and distances since the last call; T_map_world [4, 4]: world to `frame`."""
        make = self._messages
        if (grid := self._grids.poll()) is not None:
            self._last = grid
            self._put_grid(grid, cells_of(grid), T_map_world)
        if not self._distances.has_subscribers():
            if self._slices is not None:  # computing them costs time
                self._bus.unsubscribe(self._slices)
                self._slices = None
            return
        if self._slices is None:
            self._slices = self._bus.subscribe(topics.ESDF, 1)
        if (found := self._slices.poll()) is not None:
            corner = (T_map_world @ T_world_raster(found))[:3, 3]
            corner[2] += (found.low_m + found.high_m) / 2
            self._distances.put(
                make.distance_slice(
                    self._stamp_ns(found),
                    self._frame,
                    found.resolution_m,
                    corner,
                    slice_m(found),
                    _UNKNOWN_M,
                )
            )

    def forget(self, T_map_world: np.ndarray) -> None:
        """Publish the last grid with all cells unknown: a reset begins another `map`."""
        if self._last is not None:
            unknown = np.full_like(cells_of(self._last), CELL_UNKNOWN)
            self._put_grid(self._last, unknown, T_map_world)

    def _put_grid(self, grid: Grid, cells: np.ndarray, T_map_world: np.ndarray) -> None:
        T, stamp_ns = T_map_world @ T_world_raster(grid), self._stamp_ns(grid)
        message = self._messages.occupancy_grid(stamp_ns, self._frame, grid.resolution_m, T, cells)
        self._map.put(message)

    def _stamp_ns(self, message: Raster) -> int:
        """Time of capture on the clock of ROS."""
        return message.source_stamp_ns if self._has_ros_stamps else message.stamp_ns
