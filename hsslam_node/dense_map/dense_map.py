"""A dense map and its queries: distances, rays, free space, views, mesh and keyframes."""

import threading
from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hsslam_node.dense_map.answers import MapAnswers, RayHits
from hsslam_node.dense_map.free_space import are_free
from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.dense_map.map_renderer import MapRenderer
from hsslam_node.dense_map.measured_rays import measured_reach
from hsslam_node.dense_map.measuring import TRUSTED, answers_at
from hsslam_node.dense_map.seen_space import SeenCells, SeenSpace
from hsslam_node.dense_map.shapes import Boxes, Shapes, Spheres, finite_rows, rigid_transform
from hsslam_node.device.device import CPU, Device
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.occupancy import FAR_M
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera, expect_camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.layout import FieldLayout
from hsslam_node.meshing.map_queries import open_map_queries
from hsslam_node.presets import REALTIME
from hsslam_node.rendering.ray_sampling import SamplingPattern
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster
from hsslam_node.rendering.view_blending import blend_views

_PASSED = 2.0  # voxels: so far behind a measured surface, the field has another one
_BEYOND_M = 1e9  # farther than any map, and far below overflow

if TYPE_CHECKING:
    from trimesh import Trimesh


class DenseMap:
    """One version of a map. Points, poses and distances are metres in the world of the map.

    `SavedMap` opens one from a file, `Slam.map` is the map so far. Threads may ask it at once.

    Args:
        layout: of the parameters.
        params: [P] float32, not copied: they must not change.
        keyframes: of the map.
        sampling: pattern of the rays in training; views need it.
        device: evaluates the field.
        seen: returns what the keyframes saw, at the first query that needs it; None: from their depth.
        max_depth_m: farther depth counts as none, as in the mapping.
        far_m: without `seen`, surfaces and free space that keyframes saw only from farther do not count.
    """

    def __init__(
        self,
        layout: FieldLayout,
        params: np.ndarray,
        keyframes: MapKeyframes,
        sampling: SamplingPattern,
        device: Device = CPU,
        seen: Callable[[], SeenCells] | None = None,
        max_depth_m: float = REALTIME.mapper.max_depth_m,
        far_m: float = FAR_M,
    ) -> None:
        self._layout = layout
        self._params = params
        self._keyframes = keyframes
        self._sampling = sampling
        self._truncation_m = layout.config.truncation_m
        self._queries = open_map_queries(layout, params, device)
        self._rays = SdfRayCaster(self._queries.sdf, layout.bound, self._truncation_m)
        self._max_depth_m = max_depth_m
        space = SeenSpace(self._truncation_m, max_depth_m=max_depth_m, far_m=far_m)
        self._look = seen or partial(space.follow, keyframes)
        self._looking = threading.Lock()
        self._found: SeenCells | None = None  # what `_look` returned

    @property
    def bound(self) -> Bound:
        """The box that the map covers."""
        return self._layout.bound

    @property
    def camera(self) -> Camera:
        """The camera that the map was made with."""
        return self._keyframes.camera

    @property
    def keyframes(self) -> MapKeyframes:
        """Poses and depth of the keyframes."""
        return self._keyframes

    def query(self, points: ArrayLike) -> MapAnswers:
        """Distance, gradient, known and certainty at points [N, 3].

        Near surfaces the distance comes from the field, else from `distances`, 2 m at most. The first call
        reads the depth of the keyframes (40 ms each).

        Raises:
            UserError: the points are not [N, 3], or not finite.
        """
        rows = np.clip(finite_rows("points", points, 3), -_BEYOND_M, _BEYOND_M)
        rows = np.ascontiguousarray(rows, np.float32)
        return answers_at(rows, self._queries, self._truncation_m, self._seen)

    def distances(self) -> DistanceMap:
        """Free, occupied and unknown voxels by the keyframes, and distances to occupied ones."""
        return self._seen.distances

    def raycast(self, origins: ArrayLike, directions: ArrayLike, max_m: float = 10.0) -> RayHits:
        """How far rays from `origins` [N, 3] along `directions` [N, 3], of any length, meet no surface.

        Space that no keyframe saw counts as free: `is_free` tells whether all was seen. A ray that starts
        behind a surface must come out before it can hit one. A surface that no keyframe saw, or that
        keyframes saw through later, is no hit: the ray passes it. If the field has no surface within 10 cm
        behind a measured one, the ray ends at the measured one; its length is then good to 5 cm. With unseen
        voxels just before the measured one, this holds only if the field has no surface on the ray. A ray
        that reaches the map after more than 10^9 m hits nothing.

        Raises:
            UserError: the arrays are not [N, 3], not finite, or a direction is 0; `max_m` is below 0.
        """
        start = finite_rows("origins", origins, 3)
        along = finite_rows("directions", directions, 3)
        largest = np.abs(along).max(axis=1, keepdims=True)
        if not (isinstance(max_m, int | float | np.number) and max_m >= 0):
            raise UserError(f"max_m = {max_m!r}: expected metres, 0 or more")
        if len(start) != len(along) or not (largest > 0).all():
            raise UserError(
                f"directions {list(along.shape)}: expected one for each of {len(start)} origins, "
                "none of length 0"
            )
        along = along / largest
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        seen = self._seen
        distance_m = self._rays.distances(start, along, max_m, seen.may_have_surface)
        distance_m = np.where(distance_m > 0, distance_m, np.inf)
        nearest_m = np.minimum(distance_m, max_m)
        over_gaps = ~np.isfinite(distance_m)
        measured_m = measured_reach(seen.distances, start, along, nearest_m, over_gaps)
        is_passed = measured_m < distance_m - _PASSED * seen.grid.voxel_m
        distance_m = np.where(is_passed, measured_m, distance_m)
        return RayHits(distance_m, np.isfinite(distance_m))

    def is_free(self, shapes: Shapes) -> np.ndarray:
        """Mask [N] of the `Spheres` or `Boxes` whose space keyframes saw everywhere, without a surface in it.

        Space up to 1 cm outside may count as inside.

        Raises:
            UserError: `shapes` is neither of them.
        """
        if not isinstance(shapes, Spheres | Boxes):
            raise UserError(f"shapes is a {type(shapes).__name__}: expected Spheres or Boxes")
        seen = self._seen
        near_m, slack_m = TRUSTED * self._truncation_m, seen.grid.voxel_m

        def ask(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            distance_m, _, known, _ = self.query(points)
            at_least_m = np.maximum(np.minimum(distance_m, near_m), distance_m - slack_m)
            return at_least_m, known

        return are_free(shapes, ask)

    def render(
        self,
        T_world_cam: ArrayLike,
        camera: Camera | None = None,
        *,
        from_keyframes: bool = True,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 RGB and planar depth [H, W] float32 m as seen from T_world_cam [4, 4].

        Pixels without a surface are black, with depth 0. A surface that keyframes saw through later is not
        shown, unless the map is an old one without images. The first call reads the depth of the keyframes.

        Args:
            T_world_cam: pose of the view.
            camera: of the view; None: that of the keyframes.
            from_keyframes: take colours from the keyframes near the view (`blend_views`), and from the field
                where none shows the surface. False: from the field alone.

        Raises:
            UserError: the pose is no rotation and translation [4, 4]; the camera has a lens, or is no
                `Camera`; a keyframe of a file is damaged.
        """
        T = rigid_transform("T_world_cam", T_world_cam)
        camera = self.camera.undistorted() if camera is None else expect_camera("camera", camera)
        if camera.has_lens:
            raise UserError(
                f"camera.distortion = {list(camera.distortion)}: expected a camera without a lens, such as "
                "Camera.undistorted()"
            )
        has_depth = len(self._keyframes) > 0 and self._keyframes.color is not None
        depth_m = self._rays.depth(camera, T, self._seen.is_not_gone if has_depth else None)
        images = self._keyframes.posed_images if from_keyframes else None
        if images is None:
            color = 255 * self._renderer.render(depth_m, camera, T)[0]
        else:
            color, is_shown = blend_views(depth_m, camera, T, images)
            hidden_m = np.where(is_shown, np.float32(0), depth_m)
            color += 255 * self._renderer.render(hidden_m, camera, T)[0]
        return (color + 0.5).astype(np.uint8), depth_m

    def mesh(self, voxel_m: float = 0.02, *, everywhere: bool = False) -> "Trimesh":
        """The coloured mesh of what the keyframes saw, by marching cubes of this size; may be empty.

        `everywhere`: all surfaces in the bound, also guessed ones.

        Raises:
            UserError: the voxel is not above 0, or not finite.
        """
        from hsslam_node.meshing.extract_mesh import (  # a tracker needs no mesh
            extract_mesh,
            extract_whole_mesh,
        )

        queries, keyframes = self._queries, self._keyframes
        if everywhere:
            return extract_whole_mesh(
                queries.sdf, queries.color, self.bound, voxel_m, queries.threads
            )
        return extract_mesh(
            queries.sdf,
            queries.color,
            self.bound,
            keyframes.camera,
            keyframes.views,
            voxel_m,
            max_depth_m=self._max_depth_m,
            threads=queries.threads,
        )

    def trajectory(self) -> Trajectory:
        """The poses of the keyframes, a copy."""
        return Trajectory(self._keyframes.stamps_ns.copy(), self._keyframes.T_world_cam.copy())

    @cached_property
    def _renderer(self) -> MapRenderer:
        return MapRenderer(self._layout, self._params, self._sampling)

    @property
    def _seen(self) -> SeenCells:
        with self._looking:  # from Python 3.12 on, `cached_property` has no lock
            if self._found is None:
                self._found = self._look()
            return self._found
