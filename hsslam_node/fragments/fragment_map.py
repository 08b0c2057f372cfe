"""The map of a fragment that has not joined; apart, as tracking in a fragment needs no field."""

from dataclasses import replace

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.mapping.bound import initial_bound


def fragment_map(fragment: Fragment, config: SlamConfig) -> MapCheckpoint:
    """The kept keyframes of a fragment with their poses, for `merge_maps`.

    Raises:
        UserError: its first keyframe has no depth that counts.
    """
    store = fragment.store
    bound = initial_bound(store.frame(0), config.bound, config.mapper.max_depth_m)
    layout = FieldLayout.over(config.field, bound)
    parameters = FieldParameters.create(MemoryAllocator(), layout, 0)
    parameters.publish()
    return replace(map_snapshot(store, parameters, config), is_fitted=False)
