"""The mesher process: turns the published map into a mesh now and then, and into small views of it.

Subscribes: out/pose
Publishes: out/mesh, out/view
Arena: reads keyframes, map, map_state
"""

import time

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import rotation_from_quaternion
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.meshing.block_mesher import BlockMesher
from hsslam_node.meshing.map_queries import Queries, open_map_queries
from hsslam_node.meshing.observed_space import ObservedSpace, surface_shift_m
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster
from hsslam_proto import topics
from hsslam_proto.mesh_codec import mesh_message
from hsslam_proto.messages import Pose, View
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker, run_worker, worker_device

_WIDTH_PX = 64
_EVERY_S = 2.5  # 52 ms of one core: 0.7 ms a frame at 30 Hz
_POLL_S = 0.2
_BLOCKS_AT_A_TIME = 8  # between looks at the clock
_NOWHERE = np.zeros((0, 4, 4))


class ModelView:
    """Publishes what the map looks like from the newest pose."""

    def __init__(self, bus: Bus) -> None:
        self._poses = bus.subscribe(topics.POSE, 1)
        self._views = bus.publisher(topics.VIEW)
        self._next_s = 0.0

    def newest_pose(self) -> Pose | None:
        """The pose to look from, if it is time to look."""
        if time.monotonic() < self._next_s:
            return None
        pose = self._poses.poll()
        if pose is None or pose.status == "lost":
            return None
        self._next_s = time.monotonic() + _EVERY_S
        return pose

    def show(self, pose: Pose, camera: Camera, layout: FieldLayout, queries: Queries) -> None:
        """Cast a ray for each pixel, and publish."""
        camera = camera.scaled(min(1.0, _WIDTH_PX / camera.width_px))
        T_world_cam = np.eye(4)
        T_world_cam[:3, :3] = rotation_from_quaternion(np.array(pose.q))
        T_world_cam[:3, 3] = pose.t
        caster = SdfRayCaster(queries.sdf, layout.bound, layout.config.truncation_m)
        color = model_image(caster, queries, camera, T_world_cam)
        self._views.put(
            View(
                index=pose.index,
                stamp_ns=pose.stamp_ns,
                width_px=camera.width_px,
                height_px=camera.height_px,
                color=color.data.cast("B"),
                world=pose.world,
            )
        )


def model_image(
    caster: SdfRayCaster, queries: Queries, camera: Camera, T_world_cam: np.ndarray
) -> np.ndarray:
    """Colours [H, W, 3] uint8 RGB of the surfaces seen from T_world_cam [4, 4]; black: none."""
    depth_m = caster.depth(camera, T_world_cam)  # [H, W]
    points = world_points(depth_m, camera, T_world_cam)
    image = np.zeros((camera.height_px, camera.width_px, 3), np.uint8)
    if len(points):
        colors = queries.color(points)
        image[depth_m > 0] = np.clip(255 * colors + 0.5, 0, 255).astype(np.uint8)
    return image


def main() -> None:
    run_worker("mesher", _run)


def _run(worker: Worker) -> None:
    every_s = worker.options.slam.mesher.every_s
    loop = _MesherLoop(worker)
    worker.ready()
    while not worker.should_stop():
        loop.show_if_due()
        if every_s > 0 and loop.has_news():
            loop.work()
            worker.stop_event().wait(every_s)
        else:
            worker.stop_event().wait(_POLL_S)


class _MesherLoop:
    """Keeps the mesh of the observed blocks; asks those again that new keyframes see."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._device = worker_device(worker)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._mode = MapState(worker.run.arena_dir)
        self._meshes = worker.bus.publisher(topics.MESH)
        self._view = ModelView(worker.bus)
        self._mesher: BlockMesher | None = None
        self._params = np.zeros(0, np.float32)
        self._seen_from = _NOWHERE  # T_world_cam [k, 4, 4] of the keyframes observed so far

    def has_news(self) -> bool:
        """Whether keyframes have come since the last mesh."""
        store, parameters = self._link.store(), self._link.parameters()
        return bool(
            store and parameters and parameters.version and store.count > len(self._seen_from)
        )

    def show_if_due(self) -> None:
        """The map from where the camera is, for whoever looks on."""
        store, parameters = self._link.store(), self._link.parameters()
        if store is None or parameters is None or not parameters.version:
            return
        pose = self._view.newest_pose()
        if pose is not None:
            with self._worker.timed("view"):
                self._copy_map(parameters)
                queries = open_map_queries(parameters.layout, self._params, self._device)
                self._view.show(pose, store.camera, parameters.layout, queries)

    def work(self) -> None:
        """Observe new keyframes, mesh what changed, publish."""
        store, parameters = self._link.store(), self._link.parameters()
        assert store is not None and parameters is not None
        start = time.perf_counter()
        version = self._copy_map(parameters)
        mesher = self._mesher_over(parameters)
        self._observe(mesher, store)
        queries = open_map_queries(parameters.layout, self._params, self._device)
        while not self._worker.should_stop():
            if mesher.update(queries.sdf, queries.color, _BLOCKS_AT_A_TIME).waiting == 0:
                break
        mesh = mesher.mesh()
        if len(mesh.faces) == 0 or self._worker.should_stop():
            return
        colors = np.asarray(mesh.visual.vertex_colors)[:, :3]  # type: ignore[union-attr]
        world = self._mode.world
        self._meshes.put(mesh_message(mesh.vertices, mesh.faces, colors, version, world=world))
        self._worker.count("meshes")
        self._worker.stage_ms["mesh"] = 1e3 * (time.perf_counter() - start)

    def _mesher_over(self, parameters: FieldParameters) -> BlockMesher:
        bound = parameters.layout.bound
        if self._mesher is None or self._mesher.space.bound != bound:  # or the map has grown
            voxel_m = self._worker.options.slam.mesher.voxel_m
            self._mesher = BlockMesher(ObservedSpace(bound, voxel_m))
            self._seen_from = _NOWHERE
        return self._mesher

    def _observe(self, mesher: BlockMesher, store: KeyframeStore) -> None:
        poses = store.poses()
        observed = len(self._seen_from)
        if surface_shift_m(self._seen_from, poses[:observed]) > mesher.space.voxel_m:
            mesher.clear()  # after a loop; less than that stays within what is asked
            observed, self._seen_from = 0, _NOWHERE
        for k in range(observed, len(poses)):
            mesher.observe(store.frame(k).depth_m(), store.camera, poses[k])
        self._seen_from = np.concatenate([self._seen_from, poses[observed:]])

    def _copy_map(self, parameters: FieldParameters) -> int:
        while True:
            version, params = parameters.published()
            if len(self._params) != len(params):
                self._params = np.zeros(len(params), np.float32)
            np.copyto(self._params, params)
            if parameters.is_intact(version):
                return version


if __name__ == "__main__":
    main()
