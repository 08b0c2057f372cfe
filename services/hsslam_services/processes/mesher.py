"""The mesher process: updates a mesh of the map, and publishes its changed blocks and small views of the map.

It answers the request `query`, which the supervisor passes on.

Subscribes: out/pose
Publishes: out/mesh_blocks, out/view
Arena: reads keyframes, map, map_state, load_level
"""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import rotation_from_quaternion
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.meshing.block_mesh import BlockMesh
from hsslam_node.meshing.block_surface import Block
from hsslam_node.meshing.live_mesh import HasTime, LiveMesh
from hsslam_node.meshing.map_queries import Queries, open_map_queries
from hsslam_node.meshing.marked_keyframes import MarkedKeyframes
from hsslam_node.meshing.sparse_space import SparseSpace
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster
from hsslam_proto import topics
from hsslam_proto.mesh.codec import BlockLattice, Triangles, blocks_message
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.messages import Pose, View
from hsslam_proto.requests import QUERY
from hsslam_services.arena.asked_map import AskedMap
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.bus.bus import Bus
from hsslam_services.governor.background_pace import BackgroundPace
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.launch.worker_device import worker_device

_EVERY_S = 2.5  # a view takes 52 ms of one core: 0.7 ms a frame at 30 Hz
_POLL_S = 0.2
_BETWEEN_S = 0.1
_REFRESH_S = 0.4  # with the message after it, 0.5 s
_BLOCKS_A_MESSAGE = 128


class ModelView:
    """Publishes views of the map from the newest pose."""

    def __init__(self, bus: Bus, level: SharedLevel) -> None:
        self._level = level
        self._poses = bus.subscribe(topics.POSE, 1)
        self._views = bus.publisher(topics.VIEW)
        self._next_s = 0.0

    def newest_pose(self) -> Pose | None:
        """The newest pose if a view is due and the pose is not lost; else None."""
        if time.monotonic() < self._next_s:
            return None
        pose = self._poses.poll()
        if pose is None or pose.status == "lost":
            return None
        self._next_s = time.monotonic() + _EVERY_S * self._level.now.mesh_every
        return pose

    def show(self, pose: Pose, camera: Camera, layout: FieldLayout, queries: Queries) -> None:
        """Render the view by ray casting, and publish it."""
        camera = camera.scaled(min(1.0, self._level.now.view_width_px / camera.width_px))
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
                map_epoch=pose.map_epoch,
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
        worker.stop_event().wait(loop.pause_s())


class _MeshState(NamedTuple):
    """The state of the whole mesh."""

    revision: int
    map_version: int
    map_epoch: int


class _MesherLoop:
    """Keeps the blocks of the mesh, and publishes those that change."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._device = worker_device(worker)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._mode = MapState(worker.run.arena_dir)
        self._blocks = worker.bus.publisher(topics.MESH_BLOCKS)
        self._blocks.answer_with(self._all_blocks)
        report = partial(worker.event, "info")
        asked_map = AskedMap(worker.arena, worker.options.slam, self._mode, report)
        worker.bus.answer(QUERY, asked_map.answer)
        self._level = SharedLevel(worker.run.arena_dir)
        self._pace = BackgroundPace(self._level, worker.stop_event())
        self._view = ModelView(worker.bus, self._level)
        config = worker.options.slam
        self._max_depth_m = config.mapper.max_depth_m
        self._lock = threading.Lock()  # guards the mesh: a thread of the bus calls `_all_blocks`
        self._mesh = LiveMesh(SparseSpace(config.mesher.voxel_m), config.field.truncation_m)
        self._marked = MarkedKeyframes(self._mesh)
        self._series = time.monotonic_ns()
        self._revision = 0
        self._version = 0
        self._poses_version = (-1, -1)
        self._begun_s = float("-inf")

    def has_news(self) -> bool:
        """Whether blocks wait, or a refresh is due and there are new keyframes or a newer map."""
        store, parameters = self._link.store(), self._link.parameters()
        if store is None or parameters is None or not parameters.version:
            return False
        if self._mesh.waiting or self._marked.is_behind:
            return True
        every_s = self._worker.options.slam.mesher.every_s * self._level.now.mesh_every
        if time.monotonic() - self._begun_s < every_s:
            return False
        news = (store.count, store.pose_version) != self._poses_version
        return news or parameters.version != self._version

    def pause_s(self) -> float:
        """Time for other processes before the next turn, s."""
        return _BETWEEN_S if self._mesh.waiting else _POLL_S

    def show_if_due(self) -> None:
        """Publish a view of the map from the camera if one is due."""
        store, parameters = self._link.store(), self._link.parameters()
        if store is None or parameters is None or not parameters.version:
            return
        pose = self._view.newest_pose()
        if pose is not None:
            with self._worker.timed("view"):
                queries = self._queries(parameters)
                self._view.show(pose, store.camera, parameters.layout, queries)

    def _queries(self, parameters: FieldParameters) -> Queries:
        """Queries of the parameters while they are stepped: a copy would be as large as the map, and steps
        meanwhile hardly change the mesh of a block."""
        parameters.follow()
        return open_map_queries(parameters.layout, parameters.params, self._device)

    def work(self) -> None:
        """Do one refresh: mark keyframes, mesh changed blocks, publish; the rest waits for the next one."""
        store, parameters = self._link.store(), self._link.parameters()
        assert store is not None and parameters is not None
        start = time.monotonic()
        if not self._mesh.waiting:
            self._begun_s = start
        queries, self._version = self._queries(parameters), parameters.version
        self._poses_version = store.count, store.pose_version

        def until(share: float) -> HasTime:
            end = start + share * _REFRESH_S

            def has_time() -> bool:
                self._lock.release()  # `_all_blocks` need not wait for the rest
                try:
                    self._pace.rest()
                finally:
                    self._lock.acquire()
                return time.monotonic() < end and not self._worker.should_stop()

            return has_time

        with self._lock:
            self._marked.cover(parameters.layout.bound)
            self._marked.mark(
                _kept_poses(store),
                store.camera,
                partial(_depth_m, store, self._max_depth_m),
                until(0.4),
            )
            self._mesh.probe(queries.sdf, until(0.6))
            refresh = self._mesh.refresh(queries.sdf, queries.color, until(1.0))
        self._publish(refresh.changed)
        self._worker.stage_ms["mesh"] = 1e3 * (time.monotonic() - start)
        self._worker.stage_ms["mesh_behind"] = 1e3 * (time.monotonic() - self._begun_s)
        self._worker.counters["mesh_blocks"] = len(self._mesh.meshes)
        self._worker.counters["mesh_blocks_waiting"] = refresh.waiting

    def _publish(self, changed: Mapping[Block, BlockMesh | None]) -> None:
        if not changed or self._worker.should_stop():
            return
        self._revision += 1
        self._blocks.put(self._message(list(changed.items()), self._state()))
        self._worker.count("meshes")
        self._worker.count("mesh_blocks_sent", len(changed))

    def _all_blocks(self) -> Iterator[MeshBlocks]:
        """All blocks, for a late subscriber, in messages of some megabytes, made one by one."""
        with self._lock:
            known: list[tuple[Block, BlockMesh | None]] = [
                (mesh.block, mesh) for mesh in self._mesh.meshes
            ]
            state = self._state()
        for k in range(0, len(known), _BLOCKS_A_MESSAGE):
            yield self._message(known[k : k + _BLOCKS_A_MESSAGE], state)

    def _state(self) -> _MeshState:
        return _MeshState(self._revision, self._version, self._mode.map_epoch)

    def _message(
        self, blocks: Sequence[tuple[Block, BlockMesh | None]], state: _MeshState
    ) -> MeshBlocks:
        space = self._mesh.space
        return blocks_message(
            [(block, _triangles(mesh, space) if mesh else None) for block, mesh in blocks],
            BlockLattice(space.voxel_m, space.block_m),
            series=self._series,
            revision=state.revision,
            map_version=state.map_version,
            map_epoch=state.map_epoch,
        )


def _triangles(mesh: BlockMesh, space: SparseSpace) -> Triangles:
    return Triangles(space.vertex_positions(mesh.block, mesh.vertices), mesh.faces, mesh.colors)


def _kept_poses(store: KeyframeStore) -> dict[int, np.ndarray]:
    """T_world_cam [4, 4] of each kept keyframe, by id, ascending."""
    ids = store.kept()
    return dict(zip(ids.tolist(), store.poses_of(ids), strict=True))


def _depth_m(store: KeyframeStore, max_depth_m: float, k: int) -> np.ndarray | None:
    """Depth [H, W] float32 of keyframe k, 0 beyond `max_depth_m`; None if it is retired."""
    try:
        depth_m = store.frame(k).depth_m()
        return np.where(depth_m <= max_depth_m, depth_m, 0)
    except RetiredKeyframeError:
        return None


if __name__ == "__main__":
    main()
