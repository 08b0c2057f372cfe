"""A truncated signed distance volume fused from a trajectory and its depth: the baseline of the map."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera

_BLOCK = 8  # voxels along a side of an Open3D block
_BLOCKS = 8_000  # at the start, 80 MB; it grows
_LEAST_COMPONENT_FACES = 50  # as in the mesher


@dataclass(frozen=True)
class TsdfOptions:
    """Parameters of the TSDF; the defaults are the more accurate of both settings on house with noise."""

    voxel_m: float = 0.02
    """Voxel size, m."""
    truncation_m: float = 0.06
    """Truncation distance, m."""
    max_depth_m: float = 10.0
    """Ignore depth beyond this, m."""
    least_weight: float = 3.0
    """Frames that must observe a voxel of the surface."""

    def __post_init__(self) -> None:
        for name in ("voxel_m", "truncation_m", "max_depth_m", "least_weight"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                option = name.replace("_", "-")
                raise UserError(f"--tsdf.{option} {getattr(self, name)}: expected above 0")

    @property
    def name(self) -> str:
        """Name in tables: voxel size and truncation distance."""
        return f"TSDF {100 * self.voxel_m:g} / {100 * self.truncation_m:g} cm"


# The first is more accurate on house with noise; the second, of Co-SLAM's evaluation, completes more.
TSDF_SETTINGS = (TsdfOptions(), TsdfOptions(voxel_m=0.03, truncation_m=0.12))


class TsdfVolume:
    """A volume that integrates frames one by one.

    Raises:
        UserError: Open3D is not installed, or misses a library of the system.

    Source: Curless and Levoy (1996); Open3D's VoxelBlockGrid.
    """

    def __init__(self, options: TsdfOptions | None = None) -> None:
        self._options = options or TsdfOptions()
        self._o3d = import_open3d()
        core = self._o3d.core
        self._grid = self._o3d.t.geometry.VoxelBlockGrid(
            attr_names=("tsdf", "weight", "color"),
            attr_dtypes=(core.float32, core.float32, core.float32),
            attr_channels=((1), (1), (3)),
            voxel_size=self._options.voxel_m,
            block_resolution=_BLOCK,
            block_count=_BLOCKS,
            device=core.Device("CPU:0"),
        )
        self.frames = 0  # taken so far
        self.truncation_m = self._options.truncation_m

    def integrate(self, frame: Frame, T_world_cam: np.ndarray) -> None:
        """Integrate a frame with its pose [4, 4]; one without depth up to `max_depth_m` adds nothing."""
        options, o3d = self._options, self._o3d
        depth_m = frame.depth_m()
        if not ((depth_m > 0) & (depth_m <= options.max_depth_m)).any():
            return
        depth = o3d.t.geometry.Image(o3d.core.Tensor(frame.depth_raw))
        color = o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(frame.color)))
        K, extrinsic = self._view(frame.camera, T_world_cam)
        units, far = frame.depth_units_per_m, options.max_depth_m
        cut = options.truncation_m / options.voxel_m  # Open3D wants it in voxels
        blocks = self._grid.compute_unique_block_coordinates(depth, K, extrinsic, units, far, cut)
        self._grid.integrate(blocks, depth, color, K, K, extrinsic, units, far, cut)
        self.frames += 1

    def mesh(self) -> trimesh.Trimesh:
        """Coloured mesh in the world of the poses.

        Connected pieces of fewer than 50 faces are left out, as in our own meshes.
        """
        if not self.frames:
            return trimesh.Trimesh()
        found = self._grid.extract_triangle_mesh(weight_threshold=self._options.least_weight)
        found = found.to_legacy()
        mesh = trimesh.Trimesh(
            np.asarray(found.vertices),
            np.asarray(found.triangles),
            vertex_colors=(np.clip(np.asarray(found.vertex_colors), 0, 1) * 255).astype(np.uint8),
            process=False,
        )
        return _without_crumbs(mesh)

    def depth_m(self, camera: Camera, T_world_cam: np.ndarray) -> np.ndarray:
        """Depth [H, W] float32 m of its surface seen from a pose [4, 4]; 0: no surface."""
        options, o3d = self._options, self._o3d
        K, extrinsic = self._view(camera, T_world_cam)
        blocks = self._grid.hashmap().key_tensor()[
            self._grid.hashmap().active_buf_indices().to(o3d.core.int64)
        ]
        found = self._grid.ray_cast(
            blocks, K, extrinsic, camera.width_px, camera.height_px, ["depth"], 1.0, 0.1,
            options.max_depth_m, options.least_weight, options.truncation_m / options.voxel_m,
        )  # fmt: skip
        return found["depth"].numpy()[..., 0]

    def _view(self, camera: Camera, T_world_cam: np.ndarray) -> tuple[Any, Any]:
        tensor = self._o3d.core.Tensor
        return tensor(camera.K), tensor(np.linalg.inv(T_world_cam))


def fuse_tsdfs(
    frames: Iterable[tuple[Frame, np.ndarray]], settings: Sequence[TsdfOptions] = TSDF_SETTINGS
) -> dict[str, trimesh.Trimesh]:
    """Coloured meshes (`TsdfVolume.mesh`) of frames with their T_world_cam [4, 4], by the setting's name.

    Raises:
        UserError: Open3D is not installed, or misses a library of the system.
    """
    volumes = {options.name: TsdfVolume(options) for options in settings}
    for frame, T_world_cam in frames:
        for volume in volumes.values():
            volume.integrate(frame, T_world_cam)
    return {name: volume.mesh() for name, volume in volumes.items()}


def import_open3d(user: str = "the TSDF") -> Any:
    """Import Open3D, which is slow; `user`: what needs it, for errors.

    Raises:
        UserError: Open3D is not installed, or misses a library of the system.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise UserError(
            f"{user} needs Open3D: {error}: pip install 'hsslam-node[dev]', and libusb-1.0"
        ) from None
    # It prints warnings on stdout, where programs print their results.
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def _without_crumbs(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    labels = trimesh.graph.connected_component_labels(
        mesh.face_adjacency, node_count=len(mesh.faces)
    )
    large = np.bincount(labels) >= _LEAST_COMPONENT_FACES
    mesh.update_faces(large[labels])
    mesh.remove_unreferenced_vertices()
    return mesh
