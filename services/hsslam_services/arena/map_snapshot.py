"""The map of a run as a checkpoint."""

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.rendering.ray_sampling import SamplingPattern


def map_snapshot(
    store: KeyframeStore | None, parameters: FieldParameters | None, sampling: SamplingPattern
) -> MapCheckpoint:
    """The map as published last, and the keyframes of now, while everybody goes on working.

    Raises:
        UserError: there is no map yet.
    """
    if store is None or parameters is None or parameters.version == 0 or store.count == 0:
        raise UserError("there is no map yet: expected a first keyframe")
    while True:
        version, slot = parameters.published()
        params = slot.copy()
        if parameters.is_intact(version):
            return map_checkpoint(store, parameters, params, sampling)


def map_checkpoint(
    store: KeyframeStore,
    parameters: FieldParameters,
    params: np.ndarray,
    sampling: SamplingPattern,
) -> MapCheckpoint:
    """Everything that going on in the map needs; `params` [P] lie as `parameters.layout` says."""
    poses = store.poses()
    return MapCheckpoint(
        layout=parameters.layout,
        params=params,
        keyframe_stamps_ns=store.stamps_ns()[: len(poses)],
        T_world_keyframe=poses,
        camera=store.camera,
        sampling=sampling,
        images=KeyframeImages.of(store, len(poses)),
        second_moment=parameters.second_moment.copy(),
        step=parameters.step,
    )
