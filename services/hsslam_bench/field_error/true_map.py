"""A map made keyframe by keyframe as in lockstep, but at true poses."""

import numpy as np

from hsslam_bench.field_error.true_frames import TrueFrame
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.tracking.map_view import MapViews


class TrueMap:
    """Maps keyframes with true poses; answers queries with the values that a tracker reads."""

    def __init__(self, config: SlamConfig, first: TrueFrame, seed: int) -> None:
        c, arrays, frame = config, MemoryAllocator(), first.frame
        self._config = config
        self._store = KeyframeStore.create(
            arrays, frame.camera, frame.depth_units_per_m, c.keyframes.capacity
        )
        self._store.append(frame, first.T_world_cam)
        layout = FieldLayout.over(c.field, initial_bound(frame, c.bound, c.mapper.max_depth_m))
        parameters = FieldParameters.create(arrays, layout, seed)
        self._mapper = Mapper(c, parameters, seed)
        for _ in range(c.mapper.first_iterations):
            self._mapper.initialise(self._store)
        self._mapper.publish()
        self._views = MapViews(parameters, CPU)

    def add(self, keyframe: TrueFrame) -> None:
        """Map a keyframe, with the iterations of lockstep."""
        self._store.append(keyframe.frame, keyframe.T_world_cam)
        self._mapper.grow_bound(self._store)
        for _ in range(self._config.mapper.iterations):
            self._mapper.iterate(self._store)
        self._mapper.publish()

    def ask(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """SDF [N], m, and its gradient [N, 3] at points [N, 3] float32 m; nan: the map has no value."""
        view = self._views.newest()
        assert view is not None
        n = len(points)
        sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
        gradient = np.empty((n, 3), np.float32)
        query_sdf(view.params, view.layout, points, sdf, inside, gradient, True)
        is_known = (inside > 0) & (np.abs(sdf) <= 0.95)  # as in `add_sdf_term`
        scale = np.where(is_known, np.float32(view.truncation_m), np.float32(np.nan))
        return sdf * scale, gradient * scale[:, None]
