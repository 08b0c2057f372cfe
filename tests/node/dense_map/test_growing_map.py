"""The map of a run that another thread lets grow while it is read."""

from dataclasses import replace

import numpy as np

from hsslam_node.config import BoundConfig
from hsslam_node.dense_map.growing_map import GrowingMap
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.device.device import CPU
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.parameters import FieldParameters
from tests.small_room import SMALL, TINY_FIELD, empty_room


class _GrowsMeanwhile(FieldParameters):
    """The mapper of another thread comes between a reader's copy and its next line."""

    def published(self) -> tuple[int, np.ndarray]:
        found = super().published()
        if self.version < 3:
            bound = self.layout.bound
            self.grow(Bound(bound.low, tuple(np.add(bound.high, 1.0))), 0)
            self.publish()
        return found


def test_layout_and_parameters_of_a_map_that_grows_fit_each_other():
    config = replace(
        SMALL, field=TINY_FIELD, bound=BoundConfig(margin=1.0, least_m=2.0, most_m=4.0)
    )
    room = empty_room(config)
    room.parameters.publish()
    growing = _GrowsMeanwhile(room.arrays, config.field)
    points = room.store.poses()[:, :3, 3]
    found = GrowingMap(config, CPU).newest(room.store, growing).query(points)
    assert growing.version == 3
    grown = FieldParameters(room.arrays, config.field)
    expected = GrowingMap(config, CPU).newest(room.store, grown).query(points)
    np.testing.assert_array_equal(found.distance_m, expected.distance_m)

    again = empty_room(config)
    again.parameters.publish()
    growing = _GrowsMeanwhile(again.arrays, config.field)
    saved = map_snapshot(again.store, growing, config)
    assert growing.version == 3
    assert len(saved.params) == len(saved.second_moment) == saved.layout.parameter_count
