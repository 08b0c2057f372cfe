"""The map of a run as a checkpoint."""

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.map.gap_covariances import gap_covariances
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore


def map_snapshot(
    store: KeyframeStore | None,
    parameters: FieldParameters | None,
    config: SlamConfig,
) -> MapCheckpoint:
    """The newest published map and the keyframes now; other processes may go on meanwhile.

    Raises:
        UserError: there is no map yet.
    """
    if store is None or parameters is None or parameters.version == 0 or store.count == 0:
        raise UserError("there is no map yet: expected its first version")
    while True:
        layout, params = published_map(parameters)
        checkpoint = _checkpoint(store, parameters, params, config)
        if checkpoint.layout is layout:
            return checkpoint


def published_map(parameters: FieldParameters) -> tuple[FieldLayout, np.ndarray]:
    """The layout of the newest published version and a copy of its parameters [P], also if another thread
    lets the map grow meanwhile."""
    while True:
        layout = parameters.layout
        params = published_params(parameters)[1]
        if parameters.layout is layout:
            return layout, params


def published_params(
    parameters: FieldParameters, copy: np.ndarray | None = None
) -> tuple[int, np.ndarray]:
    """The newest published version and a copy of its parameters [P], never torn by a publisher.

    `copy`: an earlier copy, reused if it has the right size.
    """
    while True:
        version, slot = parameters.published()
        if copy is None or len(copy) != len(slot):
            copy = np.empty_like(slot)
        np.copyto(copy, slot)
        if parameters.is_intact(version):
            return version, copy


def _checkpoint(
    store: KeyframeStore,
    parameters: FieldParameters,
    params: np.ndarray,
    config: SlamConfig,
) -> MapCheckpoint:
    """Everything needed to continue the map; `params` [P] have the layout `parameters.layout`."""
    keyframes, images = KeyframeImages.of(store)
    return MapCheckpoint(
        layout=parameters.layout,
        params=params,
        keyframe_stamps_ns=store.stamps_ns()[keyframes],
        T_world_keyframe=store.poses_of(keyframes),
        keyframe_gaps=gap_covariances(store, keyframes),
        camera=store.camera,
        sampling=config.sampling,
        images=images,
        second_moment=parameters.second_moment.copy(),
        step=parameters.step,
        max_depth_m=config.mapper.max_depth_m,
        gravity=store.world_frame.gravity,
        T_level_world=store.world_frame.T_level_world,
    )
