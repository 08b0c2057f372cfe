"""The built-in sources, `synth:room` and others: frames of the scenes of `hsslam_node.synth`."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.inertial.reading import ImuReading
from hsslam_node.odometry.reading import OdometryReading
from hsslam_node.odometry.simulated import simulated_odometry
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import BadFrame, IsLate, LateFrame, ReadsInTime
from hsslam_node.synth.scenes.scenes import SCENES

if TYPE_CHECKING:
    import trimesh

_UNITS_PER_M = 5000.0
_UP = np.array([0.0, 0.0, 1.0])  # of the scenes' world
_FOCAL_PER_WIDTH = 525.0 / 640.0  # the field of view of a Kinect


class SynthSource(ReadsInTime):
    """A built-in scene of `SCENES`, rendered on the fly; frame n is stamped n / rate."""

    def __init__(self, name: str, options: SourceOptions) -> None:
        synth = options.synth
        trajectory, self._rows = _trajectory(name, options)
        self._stamps_ns, self._poses = trajectory.stamps_ns, trajectory.T_world_cam
        self._odometry: Sequence[OdometryReading | None] = [None] * len(self._rows)
        if synth.odometry_noise is not None:
            noise, seed = synth.odometry_noise, options.seed
            self._odometry = simulated_odometry(self._poses, noise, seed)
        self._imu: Sequence[ImuReading | None] = [None] * len(self._rows)
        if synth.imu_noise is not None:
            from hsslam_node.inertial.simulated import simulated_imu  # imports SciPy

            rate_hz = synth.rate_hz / options.stride
            self._imu = simulated_imu(self._poses, rate_hz, _UP, synth.imu_noise, options.seed)
        self._scene = SCENES[name].build(synth)
        self._seed = synth.seed
        self.name = f"synth:{name}"
        self.camera = _camera(synth)
        self.rate_hz = synth.rate_hz / options.stride
        self.frame_count: int | None = len(self._poses)
        self.depth_units_per_m = _UNITS_PER_M

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """Every frame, a late one as a `LateFrame`; first builds textures that are not cached (seconds)."""
        from hsslam_node.synth.rendering.renderer import Renderer  # imports numba and OpenCV

        renderer = Renderer(self._scene, self.camera, _UNITS_PER_M, self._seed)
        for index in range(first, len(self._rows)):
            stamp_ns = int(self._stamps_ns[index])
            if is_late(index, stamp_ns):
                yield LateFrame(index, stamp_ns)
                continue
            color, depth = renderer.render(self._poses[index], self._rows[index])
            sensors = self._odometry[index], self._imu[index]
            yield Frame(index, stamp_ns, self.camera, color, depth, _UNITS_PER_M, *sensors)


def synth_truth(
    name: str, options: SourceOptions
) -> tuple[Trajectory, "Callable[[], trimesh.Trimesh]"]:
    """Exact trajectory of the frames of `SynthSource(name, options)`, and the mesh of static parts."""
    from hsslam_node.synth.rendering.scene_mesh import scene_mesh  # imports trimesh

    trajectory, _ = _trajectory(name, options)
    return trajectory, lambda: scene_mesh(SCENES[name].build(options.synth).still_parts)


def _trajectory(name: str, options: SourceOptions) -> tuple[Trajectory, Sequence[int]]:
    """Trajectory of the frames in use, and their rows."""
    poses = SCENES[name].poses(options.synth)
    rows = options.selected(len(poses))
    stamps_ns = np.round(np.arange(len(poses)) * (1e9 / options.synth.rate_hz)).astype(np.int64)
    return Trajectory(stamps_ns[list(rows)], poses[list(rows)]), rows


def _camera(synth: SynthOptions) -> Camera:
    focal = _FOCAL_PER_WIDTH * synth.width_px
    cx, cy = (synth.width_px - 1) / 2, (synth.height_px - 1) / 2
    return Camera(synth.width_px, synth.height_px, focal, focal, cx, cy)
