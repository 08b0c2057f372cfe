"""Covariances of the gaps between some keyframes of a store; apart, as joins and saved maps need it."""

from itertools import pairwise

import numpy as np

from hsslam_node.geometry.pose_covariance import carried, turned
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore


def gap_covariances(store: KeyframeStore, ids: np.ndarray) -> np.ndarray:
    """[n, 6, 6] as `KeyframeStore.gap_covariance`, of the motion to each keyframe of `ids` [n], sorted, from
    the one before it in `ids`; 0 for the first."""
    poses = store.poses()
    gaps = np.zeros((len(ids), 6, 6))
    for n, (before, k) in enumerate(pairwise(ids.tolist()), 1):
        for between in range(before + 1, k + 1):
            gap = store.gap_covariance(between)
            if gap.any():
                T = inverse(poses[k]) @ poses[between]
                gaps[n] += carried(turned(gap, T[:3, :3]), -T[:3, 3])
    return gaps
