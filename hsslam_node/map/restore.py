"""A saved map made live again: keyframes and parameters in named arrays, as a run leaves them."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hsslam_node.config import FieldConfig, SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore


def restore_map(
    arrays: ArrayAllocator, path: Path, config: SlamConfig
) -> tuple[KeyframeStore, FieldParameters]:
    """Load the map of a file into arrays that no process uses yet; processes that attach later go on in it.

    With `config.bound.box` it covers that box as well.

    Raises:
        UserError: no such file, one that is damaged, of another version or of another field than
            `config.field`, or one without the images of its keyframes (versions before 3);
            `config.bound.first_camera`.
        OutOfMemoryError: there is no room for the arrays.
    """
    if config.bound.first_camera:
        raise UserError(
            f"bound.first_camera = {config.bound.first_camera}: expected none with a saved map ({path}), as "
            "the camera is found in it"
        )
    saved = load_checkpoint(path)
    expect_field(path, saved.layout.config, config.field)
    images, camera, moment = _whole(path, saved)
    if len(images) >= config.keyframes.capacity:
        raise UserError(
            f"{path}: {len(images)} keyframes: expected fewer than "
            f"keyframes.capacity = {config.keyframes.capacity}"
        )
    units, capacity = images.depth_units_per_m, config.keyframes.capacity
    store = KeyframeStore.create(arrays, camera, units, capacity)
    for k, frame in enumerate(saved_frames(path, saved)):
        store.append(frame, saved.T_world_keyframe[k], gap_covariance=saved.gap_covariance(k))
    store.mark_inherited()
    if saved.gravity is not None:
        store.world_frame.note_gravity(saved.gravity)
    store.world_frame.note_level(saved.T_level_world)
    return store, _restore_parameters(arrays, saved, moment, config.bound.box)


def saved_frames(path: Path, saved: MapCheckpoint) -> Iterator[Frame]:
    """The keyframes of a saved map, one after the other; `path` stands in errors.

    Raises:
        UserError: it has none, or they are damaged, or it holds no images of them (versions before 3).
    """
    images, camera, _ = _whole(path, saved)
    try:
        if len(images) == 0:
            raise ValueError("it has no keyframe")
        if not np.isfinite(saved.T_world_keyframe).all():
            raise ValueError("a pose of its keyframes is not finite")
        for k, stamp_ns in enumerate(saved.keyframe_stamps_ns.tolist()):
            color, depth_raw = images.pixels(k)
            if color.shape[:2] != (camera.height_px, camera.width_px):
                raise ValueError(f"keyframe {k} is of another size than its camera")
            yield Frame(k, stamp_ns, camera, color, depth_raw, images.depth_units_per_m)
    except ValueError as error:
        raise UserError(f"{path}: damaged map: {error}") from None


def _whole(path: Path, saved: MapCheckpoint) -> tuple[KeyframeImages, Camera, np.ndarray]:
    """Images, camera and second moment of a map that has them."""
    images, camera, moment = saved.images, saved.camera, saved.second_moment
    if images is None or camera is None or moment is None:
        raise UserError(
            f"{path}: holds no images of its keyframes, as maps before version 3: expected one saved "
            "by this release"
        )
    return images, camera, moment


def expect_field(path: Path, saved: FieldConfig, wanted: FieldConfig) -> None:
    """UserError that names what a map's field has otherwise than is wanted."""
    for field in dataclasses.fields(FieldConfig):
        here, there = getattr(wanted, field.name), getattr(saved, field.name)
        if here != there:
            raise UserError(
                f"{path}: map of another field: field.{field.name} is {there}: expected {here}; "
                "run with the preset and the --slam.field options that it was made with"
            )


def _restore_parameters(
    arrays: ArrayAllocator, saved: MapCheckpoint, second_moment: np.ndarray, box: tuple[float, ...]
) -> FieldParameters:
    """Over `box` as well, if there is one; published as version 1. The first moments are forgotten."""
    layout = saved.layout
    first = FieldLayout(layout.config, layout.lattice)
    parameters = FieldParameters.create(arrays, first, 0)
    if layout.first_bound is not None:
        parameters.grow(layout.bound, 0)
    assert parameters.layout == layout
    parameters.params[:], parameters.second_moment[:] = saved.params, second_moment
    while parameters.step < saved.step:
        parameters.count_step()
    parameters.mark_stepped(np.arange(len(parameters.stepped_at)), saved.step)
    if box and not layout.bound.contains(np.reshape(box, (2, 3))).all():
        parameters.grow(Bound.of(*np.reshape(box, (2, 3))), 0)
    parameters.publish()
    return parameters
