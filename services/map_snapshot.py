"""The map of a running service as a checkpoint: consistent, while everybody goes on working."""

from hsslam_node.checkpoint import MapCheckpoint
from hsslam_node.errors import UserError
from hsslam_node.field.parameters import FieldParameters
from hsslam_node.keyframes.store import KeyframeStore


def map_snapshot(store: KeyframeStore | None, parameters: FieldParameters | None) -> MapCheckpoint:
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
    return MapCheckpoint(layout, params, store.stamps_ns()[: len(poses)], poses)
