"""A few small frames of the built-in room with their true poses, and a map trained on them."""

import fcntl
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from hsslam_node.config import BoundConfig, FieldConfig, SlamConfig
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.presets import REALTIME
from hsslam_node.rendering.ray_sampling import SamplingPattern
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.tracking.map_view import MapView
from tests.folder_of_workers import folder_of_workers

OPTIONS = SourceOptions(frames=40, synth=SynthOptions(width_px=160, height_px=120))
SMALL = replace(
    REALTIME,
    field=FieldConfig(plane_channels=16, hash_table_log2=13),
    keyframes=replace(REALTIME.keyframes, capacity=128),
    bound=BoundConfig(margin=1.3, least_m=3.0, most_m=8.0),
)

# to track by rendering: of 3 samples a ray, too few lie off the surface
RENDERED = replace(
    SMALL,
    sampling=SamplingPattern(free_samples=2, surface_samples=4, free_reach=1.0, surface_reach=1.0),
)

TINY_FIELD = FieldConfig(  # for Triton's interpreter
    plane_channels=16,
    coarse_cell_m=1.0,
    geometry_fine_cell_m=0.5,
    appearance_fine_cell_m=0.5,
    hash_levels=2,
    hash_table_log2=8,
)


@dataclass(frozen=True)
class MappedRoom:
    """Ten keyframes at their true poses (world = first camera) and a map of them."""

    config: SlamConfig
    store: KeyframeStore
    parameters: FieldParameters
    arrays: MemoryAllocator


@cache
def room_frames() -> tuple[Frame, ...]:
    """Forty frames, 160 x 120."""
    return tuple(f for f in open_source("synth:room", OPTIONS).frames() if isinstance(f, Frame))


@cache
def room_poses() -> np.ndarray:
    """True poses of the frames relative to the first, [40, 4, 4]."""
    truth = open_ground_truth("synth:room", OPTIONS)
    assert truth
    return inverse(truth.T_world_cam[0]) @ truth.T_world_cam


def mapped_room(config: SlamConfig = SMALL) -> MappedRoom:
    """A copy of its own of the map after 200 iterations of SMALL, with the samples of `config`."""
    arrays = MemoryAllocator()
    for name, array in _trained(config.sampling).items():
        arrays.create(name, array.shape, array.dtype)[...] = array
    parameters = FieldParameters(arrays, config.field)
    return MappedRoom(config, KeyframeStore(arrays), parameters, arrays)


def map_view(config: SlamConfig = SMALL) -> MapView:
    """The map after 200 iterations, as it was published."""
    parameters = mapped_room(config).parameters
    version, params = parameters.published()
    return MapView(version, kernel_layout(parameters.layout), params, config.field.truncation_m)


def empty_room(config: SlamConfig = SMALL) -> MappedRoom:
    """The keyframes with an untrained map."""
    return _untrained(config, MemoryAllocator())


def with_black(frame: Frame, *, stamp_ns: int | None = None) -> Frame:
    """The frame with nothing in it: no light, no depth."""
    stamp_ns = frame.stamp_ns if stamp_ns is None else stamp_ns
    black, holes = np.zeros_like(frame.color), np.zeros_like(frame.depth_raw)
    return replace(frame, stamp_ns=stamp_ns, color=black, depth_raw=holes)


def displaced(T: np.ndarray, distance_m: float, angle_deg: float, seed: int = 0) -> np.ndarray:
    """The pose moved by this much in random directions."""
    rng = np.random.default_rng(seed)
    shift, axis = rng.normal(size=3), rng.normal(size=3)
    shift *= distance_m / np.linalg.norm(shift)
    axis *= np.deg2rad(angle_deg) / np.linalg.norm(axis)
    return T @ se3_exp(np.array([*shift, *axis]))


def pose_error(T: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Distance of the camera centres, m, and angle between the cameras, degrees."""
    angle = np.linalg.norm(se3_log(inverse(truth) @ T)[3:])
    return float(np.linalg.norm(T[:3, 3] - truth[:3, 3])), float(np.rad2deg(angle))


def _untrained(config: SlamConfig, arrays: MemoryAllocator) -> MappedRoom:
    frames, poses = room_frames(), room_poses()
    first = frames[0]
    store = KeyframeStore.create(arrays, first.camera, first.depth_units_per_m, 128)
    for k in range(0, 40, 4):
        store.append(frames[k], poses[k])
    bound = initial_bound(first, config.bound, config.mapper.max_depth_m)
    layout = FieldLayout.over(config.field, bound)
    return MappedRoom(config, store, FieldParameters.create(arrays, layout, 0), arrays)


@cache
def _trained(sampling: SamplingPattern) -> dict[str, np.ndarray]:
    """The arrays of the trained map; one worker trains it for all that run tests in parallel."""
    if (folder := folder_of_workers()) is None:
        return _train(sampling)
    samples = f"{sampling.free_samples}_{sampling.surface_samples}_{sampling.surface_reach}"
    path = folder / f"trained_room_{samples}.npz"
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            np.savez_compressed(path, allow_pickle=False, **_train(sampling))
    with np.load(path) as arrays:
        return dict(arrays)


def _train(sampling: SamplingPattern) -> dict[str, np.ndarray]:
    names: list[str] = []

    class Recorder(MemoryAllocator):
        def create(self, name, shape, dtype):
            names.append(name)
            return super().create(name, shape, dtype)

    arrays = Recorder()
    room = _untrained(SMALL, arrays)
    mapper = Mapper(replace(SMALL, sampling=sampling), room.parameters, 0)
    for _ in range(200):
        mapper.iterate(room.store)
    room.parameters.publish()
    return {name: arrays.open(name) for name in dict.fromkeys(names)}
