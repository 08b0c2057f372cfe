"""Loads a saved map into named arrays: keyframes and parameters, as a run leaves them."""

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
    arrays: ArrayAllocator, path: Path, config: SlamConfig, *, may_be_fragment: bool = False
) -> tuple[KeyframeStore, FieldParameters]:
    """Load a saved map into arrays that no process uses yet; processes that attach later continue in it.

    If `config.bound.box` is set, the map covers that box too.

    Raises:
        UserError: the file is missing or damaged, has another version or another field than `config.field`,
            has no images of its keyframes (versions before 3), or maps less depth than `config.mapper`; or
            `config.bound.first_camera` is set; or it is of a fragment, unless `may_be_fragment` is set.
        OutOfMemoryError: there is no room for the arrays.
    """
    if config.bound.first_camera:
        raise UserError(
            f"bound.first_camera = {config.bound.first_camera}: expected none with a saved map ({path}), as "
            "the tracker finds the camera in the map"
        )
    saved = load_checkpoint(path)
    if not may_be_fragment:
        expect_fitted(path, saved)
    expect_field(path, saved.layout.config, config.field)
    _expect_depth(path, saved.max_depth_m, config.mapper.max_depth_m)
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
    """The keyframes of a saved map, one after the other; errors name `path`.

    Raises:
        UserError: the map has no keyframes, damaged ones, or no images of them (versions before 3).
    """
    images, camera, _ = _whole(path, saved)
    try:
        if len(images) == 0:
            raise ValueError("it has no keyframe")
        for k, stamp_ns in enumerate(saved.keyframe_stamps_ns.tolist()):
            color, depth_raw = images.pixels(k)
            (height, width), camera_px = color.shape[:2], (camera.width_px, camera.height_px)
            if (width, height) != camera_px:
                expected = "{}x{}".format(*camera_px)
                raise ValueError(f"keyframe {k} is {width}x{height} px: expected {expected}")
            yield Frame(k, stamp_ns, camera, color, depth_raw, images.depth_units_per_m)
    except ValueError as error:
        raise UserError(f"{path}: damaged map: {error}") from None


def _whole(path: Path, saved: MapCheckpoint) -> tuple[KeyframeImages, Camera, np.ndarray]:
    """Images, camera and second moment; UserError if the map is too old to have them."""
    images, camera, moment = saved.images, saved.camera, saved.second_moment
    if images is None or camera is None or moment is None:
        raise UserError(
            f"{path}: holds no images of its keyframes, as it is older than version 3: expected a map "
            "saved by this release"
        )
    return images, camera, moment


def expect_fitted(path: Path, saved: MapCheckpoint) -> None:
    """UserError if the map holds only the keyframes of a fragment."""
    if not saved.is_fitted:
        raise UserError(
            f"{path}: keyframes of a fragment, without a surface: expected a map; hsslam-map merge adds them "
            "to the map of a run that saw the same"
        )


def expect_field(path: Path, saved: FieldConfig, wanted: FieldConfig) -> None:
    """UserError that names the first option in which a map's field differs from the wanted one."""
    for field in dataclasses.fields(FieldConfig):
        here, there = getattr(wanted, field.name), getattr(saved, field.name)
        if here != there:
            raise UserError(
                f"{path}: map of another field: field.{field.name} is {there}: expected {here}; "
                "run with the preset and the --slam.field options that made the map"
            )


def _expect_depth(path: Path, saved_m: float | None, wanted_m: float) -> None:
    """UserError if depth would count that the map was not fitted to."""
    if saved_m is not None and wanted_m > saved_m:
        raise UserError(
            f"{path}: map of depth up to {saved_m:g} m: mapper.max_depth_m is {wanted_m:g}: expected at most "
            f"{saved_m:g}; run with --slam.mapper.max-depth-m {saved_m:g}"
        )


def _restore_parameters(
    arrays: ArrayAllocator, saved: MapCheckpoint, second_moment: np.ndarray, box: tuple[float, ...]
) -> FieldParameters:
    """The saved parameters, also over `box` if there is one, published as version 1; first moments are 0."""
    layout = saved.layout
    first = FieldLayout(layout.config, layout.lattice)
    parameters = FieldParameters.create(arrays, first, 0)
    if layout.first_bound is not None:
        parameters.grow(layout.bound, 0)
    assert parameters.layout == layout
    parameters.params[:], parameters.second_moment[:] = saved.params, second_moment
    parameters.resume_steps(saved.step)
    parameters.mark_stepped(np.arange(len(parameters.stepped_at)), saved.step)
    if box and not layout.bound.contains(np.reshape(box, (2, 3))).all():
        parameters.grow(Bound.of(*np.reshape(box, (2, 3))), 0)
    parameters.publish()
    return parameters
