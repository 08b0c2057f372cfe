"""The map of a run while it grows, as a `DenseMap` of each version."""

from functools import partial

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import keyframes_of_store
from hsslam_node.dense_map.seen_space import SeenSpace
from hsslam_node.dense_map.snapshot import published_map
from hsslam_node.device.device import Device
from hsslam_node.errors import UserError
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore


class GrowingMap:
    """Makes a `DenseMap` of the newest version; reads the depth of each keyframe only once."""

    def __init__(self, config: SlamConfig, device: Device) -> None:
        self._config = config
        self._device = device
        self._seen = SeenSpace(config.field.truncation_m, max_depth_m=config.mapper.max_depth_m)
        self._newest: tuple[tuple[int, int, int], DenseMap] | None = None

    def newest(self, store: KeyframeStore | None, parameters: FieldParameters | None) -> DenseMap:
        """The map now; query it before more is mapped.

        Raises:
            UserError: there is no map yet.
        """
        if store is None or parameters is None or not parameters.version:
            raise UserError("there is no map yet: expected a first keyframe")
        of = parameters.version, store.count, store.pose_version
        if self._newest is None or self._newest[0] != of:
            layout, params = published_map(parameters)
            keyframes, c = keyframes_of_store(store), self._config
            seen = partial(self._seen.follow, keyframes)
            dense_map = DenseMap(
                layout, params, keyframes, c.sampling, self._device, seen, c.mapper.max_depth_m
            )
            self._newest = of, dense_map
        return self._newest[1]

    def held(self, store: KeyframeStore | None, parameters: FieldParameters | None) -> DenseMap:
        """A snapshot of the map; later frames do not change its answers.

        Raises:
            UserError: there is no map yet.
        """
        held = self.newest(store, parameters)
        held.distances()  # reads the depth of keyframes that may be retired soon
        return held
