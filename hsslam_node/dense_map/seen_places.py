"""What keyframes saw about points that are asked for, in bounded memory."""

import time
from collections import OrderedDict
from collections.abc import Callable
from functools import partial

import numpy as np

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.dense_map.seen_space import SeenCells, SeenSpace
from hsslam_node.distance.voxel_grid import VOXEL_M, GridSizeError
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound

MOST_CELLS = 1 << 24  # 0.5 GB
_BESIDE_M = 2.5  # of points: their distances are to surfaces up to 2 m away
# boxes begin and end at multiples of 4 m, so that points of the next query often lie in the same box
_STEP_CELLS = 80
_MOST_BOXES = 32  # also of those in which keyframes saw nothing
_FARTHEST_M = 1e9
_Box = tuple[tuple[int, ...], tuple[int, ...]]  # first and end, in steps


class SeenPlaces:
    """Follows keyframes as `SeenSpace` does, all of the map while it has at most `most_cells` cells.

    After that it follows them in boxes about the points. The boxes that were asked for least recently are
    forgotten, so that all of them have at most `most_cells`. Not thread-safe.

    Args:
        reach_m, max_depth_m: as of a `SeenSpace`.
        report: takes a line for people when the map has become too large.
        most_cells: of 5 cm, 31 bytes each.
    """

    def __init__(
        self,
        reach_m: float,
        max_depth_m: float,
        report: Callable[[str], None],
        most_cells: int = MOST_CELLS,
    ) -> None:
        self._space_of = partial(SeenSpace, reach_m, VOXEL_M, max_depth_m)
        self._report, self._most_cells = report, most_cells
        self._whole: SeenSpace | None = self._space_of(expect_room=self._expect_few)
        # the box that was used last comes last
        self._boxes: OrderedDict[_Box, SeenSpace] = OrderedDict()

    @property
    def cells(self) -> int:
        """Number of cells that are kept."""
        return sum(space.cells for space in (self._whole, *self._boxes.values()) if space)

    def follow_for(
        self, keyframes: MapKeyframes, points: np.ndarray, seconds: float
    ) -> SeenCells | int:
        """What keyframes saw about points [N, 3] m, finite; the number of keyframes left after `seconds`.

        Raises:
            UserError: the points lie so far apart that the space about them has more than `most_cells`, or
                there was no keyframe yet.
        """
        deadline_s = time.monotonic() + seconds
        if self._whole is not None:
            try:
                return self._whole.follow_for(keyframes, seconds)
            except GridSizeError:
                self._whole = None
                self._report(
                    f"query: the map has more than {self._most_cells} cells of {VOXEL_M:g} m: each query now "
                    "reads the keyframes about its points, and is slower at new places"
                )
        tight = _box_about(np.clip(points, -_FARTHEST_M, _FARTHEST_M))
        while True:
            box = self._box_with(tight)
            try:
                return self._boxes[box].follow_for(keyframes, deadline_s - time.monotonic())
            except GridSizeError:
                del self._boxes[box]
                if box == tight:
                    break  # else the box of an earlier query has grown too large
        apart_m = np.linalg.norm(np.ptp(points, axis=0))
        raise UserError(
            f"points are up to {apart_m:.0f} m apart: the space about them has more than "
            f"{self._most_cells} cells of {VOXEL_M:g} m: expected fewer, in several queries"
        )

    def _box_with(self, tight: _Box) -> _Box:
        """The box that was used last of those that hold this one; a new one if there is none."""
        for box in reversed(self._boxes):
            if np.all(np.less_equal(box[0], tight[0])) and np.all(np.less_equal(tight[1], box[1])):
                break
        else:
            box = tight
            within = Bound.of(*(np.multiply(_STEP_CELLS * VOXEL_M, end) for end in box))
            make_room = partial(self._make_room, box)
            self._boxes[box] = self._space_of(within=within, expect_room=make_room)
            if len(self._boxes) > _MOST_BOXES:
                self._boxes.popitem(last=False)
        self._boxes.move_to_end(box)
        return box

    def _make_room(self, box: _Box, cells: int) -> None:
        """Forget the boxes that were used longest ago until `cells` cells of this box fit in."""
        self._expect_few(cells)
        for other in [other for other in self._boxes if other != box]:
            if cells + self.cells - self._boxes[box].cells <= self._most_cells:
                break
            del self._boxes[other]

    def _expect_few(self, cells: int) -> None:
        if cells > self._most_cells:
            raise GridSizeError(f"{cells} cells: expected {self._most_cells} at most")


def _box_about(points: np.ndarray) -> _Box:
    """The smallest box that holds what the distances of points [N, 3] m depend on."""
    if len(points) == 0:
        points = np.zeros((1, 3))
    step_m = _STEP_CELLS * VOXEL_M
    low = np.floor((points.min(axis=0) - _BESIDE_M) / step_m).astype(np.int64)
    high = np.ceil((points.max(axis=0) + _BESIDE_M) / step_m).astype(np.int64)
    return tuple(low.tolist()), tuple(high.tolist())
