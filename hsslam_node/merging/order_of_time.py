"""Sorts the keyframes of a merged map by time; apart, as it does not need to know how maps are merged."""

from dataclasses import replace

import numpy as np

from hsslam_node.geometry.pose_covariance import UNTRACKED
from hsslam_node.map.checkpoint import MapCheckpoint


def in_order_of_time(merged: MapCheckpoint, seam: int) -> MapCheckpoint:
    """The map with the keyframes of the earlier run first, as meshes, grids and distances take the order of
    keyframes for the order of time.

    Runs with stamps that overlap, as those of two clocks that begin at 0, keep their order.

    Args:
        merged: with images.
        seam: number of the first keyframe of the second run.
    """
    stamps_ns, images, gaps = merged.keyframe_stamps_ns, merged.images, merged.keyframe_gaps
    assert images is not None and gaps is not None
    if stamps_ns[seam:].max() >= stamps_ns[:seam].min():
        return merged
    gaps = np.roll(gaps, -seam, axis=0)
    gaps[0], gaps[-seam] = 0.0, UNTRACKED
    return replace(
        merged,
        keyframe_stamps_ns=np.roll(stamps_ns, -seam),
        T_world_keyframe=np.roll(merged.T_world_keyframe, -seam, axis=0),
        images=images.rolled(seam),
        keyframe_gaps=gaps,
    )
