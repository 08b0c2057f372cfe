"""Open3D's dense SLAM: each frame is tracked against the surface of its voxel model, as in KinectFusion."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import trimesh

from hsslam_bench.peers.systems.peer import Estimate
from hsslam_node.errors import UserError
from hsslam_node.evaluation.mesh.tsdf_baseline import import_open3d
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory

VOXEL_M = 3 / 512  # both as in Open3D's example
MOST_DEPTH_M = 3.0
TRUNCATION_VOXELS = 8.0
_LEAST_DEPTH_M = 0.1
_BLOCKS = 20_000  # allocated at the start; more are added as needed
_LEAST_WEIGHT = 3.0  # least frames that observe a voxel of the mesh, as in Open3D's example


def expect_open3d() -> Any:
    """Import Open3D.

    Raises:
        UserError: Open3D or a system library that it needs is not installed.
    """
    return import_open3d("the dense SLAM of Open3D")


class _Model:
    """The voxel model, and the pose of the camera.

    Source: Open3D, `examples/python/t_reconstruction_system/dense_slam.py`.
    """

    def __init__(self, first: Frame) -> None:
        self._o3d = open3d = expect_open3d()
        self._device = open3d.core.Device("CPU:0")
        self._model: Any = open3d.t.pipelines.slam.Model(
            VOXEL_M, 16, _BLOCKS, open3d.core.Tensor(np.eye(4)), self._device
        )
        self._input, self._seen = self._frame(first), self._frame(first)
        self._units = float(first.depth_units_per_m)
        self._count = 0
        self.T_world_cam = np.eye(4)

    def take(self, frame: Frame) -> bool:
        """Track the frame and integrate it; returns False if tracking failed and the frame is left out."""
        o3d, model = self._o3d, self._model
        for kind, image in (("depth", frame.depth_raw), ("color", frame.color)):
            tensor = o3d.core.Tensor(np.ascontiguousarray(image))
            self._input.set_data_from_image(kind, o3d.t.geometry.Image(tensor))
        if self._count:
            try:
                found = model.track_frame_to_model(
                    self._input, self._seen, self._units, MOST_DEPTH_M
                )
            except RuntimeError:  # singular system: no overlap
                return False
            self.T_world_cam = self.T_world_cam @ found.transformation.numpy()
        model.update_frame_pose(self._count, o3d.core.Tensor(self.T_world_cam))
        model.integrate(self._input, self._units, MOST_DEPTH_M, TRUNCATION_VOXELS)
        model.synthesize_model_frame(
            self._seen, self._units, _LEAST_DEPTH_M, MOST_DEPTH_M, TRUNCATION_VOXELS, False
        )
        self._count += 1
        return True

    def mesh(self) -> trimesh.Trimesh:
        """The mesh in the world of the poses."""
        found = self._model.extract_trianglemesh(_LEAST_WEIGHT).to_legacy()
        return trimesh.Trimesh(
            np.asarray(found.vertices), np.asarray(found.triangles), process=False
        )

    def _frame(self, first: Frame) -> Any:
        c, K = first.camera, self._o3d.core.Tensor(first.camera.K)
        return self._o3d.t.pipelines.slam.Frame(c.height_px, c.width_px, K, self._device)


def frame_to_model(frames: Iterable[Frame]) -> Estimate:
    """Poses and mesh of the frames.

    Raises:
        UserError: the source has no readable frame.
    """
    model: _Model | None = None
    stamps_ns, poses = [], []
    for frame in frames:
        model = model or _Model(frame)
        if model.take(frame):
            stamps_ns.append(frame.stamp_ns)
            poses.append(model.T_world_cam)
    if model is None:
        raise UserError("no readable frame: expected at least one")
    return Estimate(Trajectory(np.array(stamps_ns, np.int64), np.array(poses)), model.mesh())
