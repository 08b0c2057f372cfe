"""Scores meshes against the true surface of a source, all of them by the same views."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.evaluation.every_nth import EveryNth
from hsslam_node.evaluation.ground_truth import GroundTruth
from hsslam_node.evaluation.mesh.depth_l1 import DepthL1, depth_l1
from hsslam_node.evaluation.mesh.mesh_metrics import MeshMetrics, compare_meshes
from hsslam_node.evaluation.mesh.published_protocol import (
    FAR_M,
    CullingCameras,
    compare_as_published,
)
from hsslam_node.evaluation.mesh.virtual_views import virtual_views
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.triangles import triangle_mesh
from hsslam_node.progress import Track, silently
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions

CULL_EVERY = 10  # of the given cameras
MOST_GIVEN = 300  # of a run of more than 3000 frames: their depth takes 0.4 GB at 640x480
CULL_TOLERANCE_M = 0.03
# virtual cameras that cull in the literature's protocol: the first of those drawn
CULL_VIRTUAL = 100
DEPTH_VIEWS = 1000
_Y_UP = (".glb", ".gltf")
_READABLE = ".glb, .gltf, .obj, .off, .ply or .stl"  # kinds that need no further package
_SAME_SURFACE = 0.1  # noise moves depth by a smaller share; beyond, it is another surface
_DEPTH_WIDTH_PX = 160  # of the virtual views of the depth error


@dataclass(frozen=True)
class MeshJudge:
    """The true surface, and the views that say which parts of a mesh count.

    `given` are the source's own cameras at their true poses; `virtual` has T_world_cam [4, 4] and true
    depth [h, w] float32 m of views from places where no camera was.
    """

    surface: trimesh.Trimesh  # in the truth's world, m
    given: Views
    virtual: list[tuple[np.ndarray, np.ndarray]]
    virtual_camera: Camera
    # virtual views that cull in the literature's protocol, the first ones
    cull_views: int = CULL_VIRTUAL

    @classmethod
    def open(
        cls,
        truth: GroundTruth,
        spec: str,
        options: SourceOptions,
        virtual: int = CULL_VIRTUAL,
        cull_views: int = CULL_VIRTUAL,
        seed: int = 0,
        track: Track = silently,
    ) -> "MeshJudge | None":
        """None if the true surface is not known. `virtual`: number of virtual views."""
        surface = truth.mesh()
        if surface is None:
            return None
        given = given_views(truth, spec, options)
        camera = given.camera.scaled(min(_DEPTH_WIDTH_PX / given.camera.width_px, 1.0))
        drawn = virtual_views(surface, given, camera, virtual, seed)
        views = list(track(drawn, virtual, description="virtual views"))
        return cls(surface, given, views, camera, cull_views)

    def score(self, mesh: trimesh.Trimesh, seed: int = 0) -> MeshMetrics:
        """By our exact protocol: points to triangles, of what the given cameras saw."""
        return compare_meshes(mesh, self.surface, self.given, seed=seed)

    def score_as_published(self, mesh: trimesh.Trimesh, seed: int = 0) -> MeshMetrics:
        """By the protocol of the literature, with given and virtual cameras that see as far as the given."""
        reach_m = min(float(self.given.depths_m.max(initial=0.0)), FAR_M)
        given, virtual = self.given.T_world_cam, self.virtual_poses[: self.cull_views]
        cameras = CullingCameras(self.given.camera, given, virtual, reach_m)
        return compare_as_published(mesh, self.surface, cameras, seed=seed)

    def score_depth(
        self, mesh: trimesh.Trimesh, views: int = DEPTH_VIEWS, track: Track = silently
    ) -> DepthL1:
        """Depth error over the first `views` virtual views."""
        chosen = self.virtual[:views]
        watched = track(chosen, len(chosen), description="depth of virtual views")
        return depth_l1(mesh, watched, self.virtual_camera, self.given)

    @property
    def virtual_poses(self) -> np.ndarray:
        """T_world_cam of the virtual views, [V, 4, 4]."""
        return np.array([T for T, _ in self.virtual]).reshape(-1, 4, 4)


def given_views(truth: GroundTruth, spec: str, options: SourceOptions) -> Views:
    """Every tenth frame at its true pose: its depth without added noise, if noise left a measurement.

    Of more than 3000 frames, every n-th frame, so that there are at most 300.
    """
    row_of = {int(stamp): row for row, stamp in enumerate(truth.stamps_ns)}
    open_it = partial(open_source, spec)
    frames = open_it(options).frame_count or len(truth.stamps_ns)
    every = max(CULL_EVERY, -(-frames // MOST_GIVEN))
    exact = EveryNth.of_run(open_it, replace(options, noise="none"), every)
    is_exact = options.noise == "none"
    pairs = _together(exact, None if is_exact else EveryNth.of_run(open_it, options, every))
    camera = exact.source.camera.undistorted()
    depths_m = np.empty((-(-frames // every), camera.height_px, camera.width_px), np.float32)
    poses: list[np.ndarray] = []
    for frame, measured in islice(pairs, len(depths_m)):
        if frame.stamp_ns in row_of:
            true = frame.depth_m()
            agrees = np.abs(measured.depth_m() - true) < _SAME_SURFACE * true
            depths_m[len(poses)] = np.where(agrees, true, np.float32(0))
            poses.append(truth.T_world_cam[row_of[frame.stamp_ns]])
    T_world_cam = np.array(poses).reshape(-1, 4, 4)
    return Views(camera, T_world_cam, depths_m[: len(poses)], CULL_TOLERANCE_M)


def load_mesh(path: Path) -> trimesh.Trimesh:
    """A triangle mesh from a file, as it is; one of glTF, which has y up, is turned back to y down.

    Raises:
        UserError: not a file with triangles, or of a kind that cannot be read; a vertex of a face is missing
            or not finite.
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file: expected a mesh {_READABLE}")
    mesh = triangle_mesh(path, f"expected a mesh {_READABLE}")
    if path.suffix.lower() in _Y_UP:
        mesh.apply_transform(np.linalg.inv(OPENGL_FROM_OPENCV))
    return mesh


def _together(
    exact: Iterable[object], measured: Iterable[object] | None
) -> Iterator[tuple[Frame, Frame]]:
    """The frames of two sources that both have; `measured` None: it has the same frames."""
    pairs = ((a, a) for a in exact) if measured is None else zip(exact, measured, strict=True)
    for a, b in pairs:
        if isinstance(a, Frame) and isinstance(b, Frame):
            yield a, b
