"""The map of a running service as a checkpoint: consistent, while everybody goes on working."""

from hsslam_node.checkpoint import MapCheckpoint
from hsslam_node.errors import UserError
from hsslam_node.field.parameters import FieldParameters
from hsslam_node.keyframes.store import KeyframeStore
from hsslam_node.rendering.ray_sampling import SamplingPattern


def map_snapshot(
    store: KeyframeStore | None, parameters: FieldParameters | None, sampling: SamplingPattern
) -> MapCheckpoint:
    """The map as published last, and the keyframes of now.

    Raises:
        UserError: there is no map yet.
    """
    if store is None or parameters is None or parameters.version == 0 or store.count == 0:
        raise UserError("there is no map yet: expected a first keyframe")
    while True:
        version, slot = parameters.published()
        layout, params = parameters.layout, slot.copy()
        if parameters.is_intact(version):
            break
    poses = store.poses()
    stamps_ns = store.stamps_ns()[: len(poses)]
    return MapCheckpoint(layout, params, stamps_ns, poses, store.camera, sampling)
