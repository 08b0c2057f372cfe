"""The built-in source `synth:room`."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.source import BadFrame, SourceOptions, SynthOptions
from hsslam_node.sources.synth_room.motion import hand_held_poses
from hsslam_node.sources.synth_room.scene import build_scene

if TYPE_CHECKING:
    import trimesh

_UNITS_PER_M = 5000.0
_FOCAL_PER_WIDTH = 525.0 / 640.0  # the field of view of a Kinect


class SynthRoom:
    """A furnished room, rendered on the fly; frame n is stamped n / rate."""

    def __init__(self, options: SourceOptions) -> None:
        synth = options.synth
        self._rows = options.selected(synth.length)
        self._poses = hand_held_poses(synth.size_m, synth.length, synth.seed)[list(self._rows)]
        self._stamps_ns = _stamps_ns(synth)[list(self._rows)]
        self._scene = build_scene(synth.size_m, synth.seed)
        self._seed = synth.seed
        self.name = "synth:room"
        self.camera = _camera(synth)
        self.rate_hz = synth.rate_hz / options.stride
        self.frame_count: int | None = len(self._rows)
        self.depth_units_per_m = _UNITS_PER_M

    def frames(self) -> Iterator[Frame | BadFrame]:
        """Every frame of the loop; the first call builds the textures (seconds)."""
        from hsslam_node.sources.synth_room.renderer import Renderer  # imports numba and OpenCV

        renderer = Renderer(self._scene, self.camera, _UNITS_PER_M, self._seed)
        for index, (stamp_ns, pose) in enumerate(zip(self._stamps_ns, self._poses, strict=True)):
            color, depth = renderer.render(pose)
            yield Frame(index, int(stamp_ns), self.camera, color, depth, _UNITS_PER_M)


def synth_room_truth(
    options: SourceOptions,
) -> tuple[Trajectory, "Callable[[], trimesh.Trimesh]"]:
    """Exact trajectory of the frames that `SynthRoom(options)` delivers, and its mesh on demand."""
    from hsslam_node.sources.synth_room.scene_mesh import scene_mesh  # imports trimesh

    synth = options.synth
    rows = list(options.selected(synth.length))
    poses = hand_held_poses(synth.size_m, synth.length, synth.seed)
    trajectory = Trajectory(_stamps_ns(synth)[rows], poses[rows])
    return trajectory, lambda: scene_mesh(build_scene(synth.size_m, synth.seed))


def _camera(synth: SynthOptions) -> Camera:
    focal = _FOCAL_PER_WIDTH * synth.width_px
    cx, cy = (synth.width_px - 1) / 2, (synth.height_px - 1) / 2
    return Camera(synth.width_px, synth.height_px, focal, focal, cx, cy)


def _stamps_ns(synth: SynthOptions) -> np.ndarray:
    return np.round(np.arange(synth.length) * (1e9 / synth.rate_hz)).astype(np.int64)
