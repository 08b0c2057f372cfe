"""The mapper process: fits the map to the keyframes and publishes versions of the map.

In real time, a keyframe message only wakes the loop; the arena has the number of keyframes.

Subscribes: out/keyframe, out/pose
Publishes: out/map, out/correction, sys/step
Arena: reads map_state, load_level; writes keyframes, map
"""

import math
import time
from functools import partial

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.mapping.map_optimiser import StepReport
from hsslam_node.mapping.mapper import Mapper
from hsslam_proto import topics
from hsslam_proto.frame_order import FrameOrder
from hsslam_proto.messages import MapVersion
from hsslam_proto.run_messages import Step
from hsslam_services.arena.arena import PARAMETERS_LEASE
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.memory_budget import MemoryBudget
from hsslam_services.arena.pose_corrector import PoseCorrector
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.bus.dead_pools import bytes_of_pools
from hsslam_services.governor.mapping_backlog import MappingBacklog
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.launch.worker_device import tell_device, worker_device

_POLL_S = 0.05
_SLICE = 32  # last iterations between checks of signals and clock
_RETIRING_SHARE = 0.25  # of --finish-s, to compare keyframes with those of the loaded map
_SAVING_S = 1.0  # time reserved to save the map at the end,
_SAVING_FACTOR = 2.0  # and this times the time of the first save


def main() -> None:
    run_worker("mapper", _run)


def _run(worker: Worker) -> None:
    loop = _MapperLoop(worker)
    _follow_keyframes(worker, loop)
    loop.retire_known()
    loop.do_last_iterations()
    loop.publish_all_poses()


def _follow_keyframes(worker: Worker, loop: "_MapperLoop") -> None:
    if worker.options.pace == "lockstep":
        poses = worker.bus.subscribe(topics.POSE, depth=64, history=True)
        steps = worker.bus.publisher(topics.STEP)
        order = FrameOrder()
        worker.ready()
        while not worker.should_stop():
            pose = poses.wait(_POLL_S)
            if pose is None:
                continue
            # the second pose of a frame that was sent twice only gets a step: the next frame may be under
            # way, and its keyframe must wait for its own pose
            is_new = order.is_new(pose.publisher, pose.index)
            while is_new and loop.has_work() and not worker.should_stop():
                loop.work()
            if is_new:
                loop.make_room()
            steps.put(Step(stage="mapped", index=pose.index, publisher=pose.publisher))
    else:
        keyframes = worker.bus.subscribe(topics.KEYFRAME, depth=64)
        worker.ready()
        while not worker.should_stop():
            if loop.has_work():
                loop.work()
            else:
                loop.make_room()
                keyframes.wait(_POLL_S)
            keyframes.drain()  # they only wake this loop


class _MapperLoop:
    """Does the iterations that new keyframes ask for; resumes after a restart."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._slam = worker.options.slam
        self._device = worker_device(worker, warm_started=True)
        tell_device(worker, self._device)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._mode = MapState(worker.run.arena_dir)
        self._level = SharedLevel(worker.run.arena_dir)
        self._maps = worker.bus.publisher(topics.MAP)
        self._corrector: PoseCorrector | None = None
        if self._slam.mapper.pose_rate > 0:
            self._corrector = PoseCorrector(worker.bus.publisher(topics.CORRECTION), self._mode)
        self._budget = MemoryBudget(
            worker.arena.folder,
            worker.options.memory_gb,
            partial(bytes_of_pools, worker.run.supervisor_pid),
        )
        self._mapper: Mapper | None = None
        self._parameters: FieldParameters | None = None
        self._backlog = MappingBacklog(
            self._slam.mapper.iterations,
            self._level,
            has_limit=worker.options.pace == "realtime",
        )
        self._refused = 0  # keyframes for which the tracker had no room
        self._iterations = 0
        store, parameters = self._link.store(), self._link.parameters()
        if store is not None and parameters is not None and parameters.version > 0:
            self._open(parameters)
            has_own = store.inherited < store.count
            self._backlog.skip_to(store.count - has_own)  # the newest one may not be mapped yet
            if has_own:
                worker.event("warning", f"mapper resumes at map version {parameters.version}")

    def has_work(self) -> bool:
        """Whether there are iterations to do."""
        store = self._link.store()
        if store is None or store.count == 0:
            return False
        if self._parameters is None:
            return True
        if self._mode.localise_only:
            self._backlog.skip_to(store.count)
            return False
        return self._backlog.take(store)

    def work(self) -> None:
        """Make the first map, or do the iterations of one keyframe; then publish."""
        store = self._link.store()
        assert store is not None
        if self._parameters is None:
            self._first_map(store)
            return
        assert self._mapper is not None
        start = time.perf_counter()
        n = self._backlog.next_count()
        with self._worker.arena.lease(PARAMETERS_LEASE):
            self._grow_bound(store)
            for _ in range(n):
                with self._worker.timed("iteration"):
                    report = self._mapper.iterate(store, self._level.now.rays)
                if self._mode.is_given_up:
                    break
            self._mapper.publish()
            refined = self._mapper.take_poses(store)
            if self._corrector and refined and self._mode.may_change:
                self._corrector.correct(store, *refined, losses=(report.loss, report.loss))
        self._backlog.done(n)
        self._iterations += n
        self._select(store)
        self._publish(report, store, start)

    def make_room(self) -> None:
        """Retire keyframes if the tracker has no room for a keyframe or a fragment; `work` would not do it
        without a new keyframe."""
        store = self._link.store()
        if store is None or self._mapper is None or self._mode.localise_only:
            return
        if store.room.refused > self._refused or store.room.is_short():
            self._refused = store.room.refused
            self._select(store)

    def _select(self, store: KeyframeStore) -> None:
        """Retire redundant keyframes, and more of them if memory is scarce."""
        assert self._mapper is not None
        notice = self._budget.apply(store)
        if notice is not None:
            self._worker.event("warning", notice)
        with self._worker.timed("select"):
            self._worker.count("keyframes retired", self._mapper.select(store))

    def _grow_bound(self, store: KeyframeStore) -> None:
        """Grow the map to what the new keyframes see; the caller holds the lease."""
        assert self._mapper is not None
        with self._worker.timed("cover"):
            try:
                bound = self._mapper.grow_bound(store)
            except OutOfMemoryError as error:
                self._worker.event("warning", f"the map cannot grow any more: {error}")
                return
        if bound is not None:
            sides = " x ".join(f"{side:.1f}" for side in bound.extent_m)
            self._worker.count("growths")
            self._worker.event("info", f"the map grows to {sides} m")

    def retire_known(self) -> None:
        """In a run that continues a saved map, retire keyframes that show only what it shows, as many as a
        quarter of the time for the end of the run allows."""
        store = self._link.store()
        if store is None or self._mapper is None or not self._mode.may_change:
            return
        quarter_s = _RETIRING_SHARE * self._worker.options.finish_budget_s
        end_s = min(self._last_iterations_end_s(), time.monotonic() + quarter_s)
        own = int((store.kept() >= store.inherited).sum()) if store.inherited else 0
        left = max(own - 1, 0)  # the newest stays
        while left and time.monotonic() < end_s and not self._worker.is_orphan():
            left = self._mapper.select_last(store)
            self._worker.should_stop()  # counts as a turn of the loop
        if left:
            what = "keyframe was" if left == 1 else "keyframes were"
            why = "--finish-s allows no more"
            self._worker.event("info", f"{left} {what} not compared with the loaded map: {why}")

    def do_last_iterations(self) -> None:
        """Do the iterations of the newest keyframes, as of a fragment that joins the map at the end. Then do
        the last iterations, over all keyframes, as many as the time before the map's saving allows.

        Publishes each slice, so that a killed process loses at most one.
        """
        store = self._link.store()
        if store is None or self._mapper is None or self._parameters is None:
            return
        if not self._mode.may_change:
            return
        end_s = self._last_iterations_end_s()
        if self._worker.is_orphan() or time.monotonic() >= end_s:
            return
        while self.has_work() and time.monotonic() < end_s and not self._worker.is_orphan():
            self.work()
            self._worker.should_stop()  # counts as a turn of the loop
        n = self._mapper.last_iterations(store)
        if n == 0:
            return
        with self._worker.arena.lease(PARAMETERS_LEASE):
            self._grow_bound(store)  # to keyframes without iterations under load
        self._worker.event("info", f"the source has ended: {n} last iterations of the map")
        start, done, start_s = time.perf_counter(), 0, time.monotonic()
        while done == 0 or (done < n and time.monotonic() < end_s and not self._worker.is_orphan()):
            with self._worker.arena.lease(PARAMETERS_LEASE):
                for _ in range(min(_SLICE, n - done)):
                    of_time = (time.monotonic() - start_s) / max(end_s - start_s, 1e-3)
                    report = self._mapper.refine_sparse(store, min(max(done / n, of_time), 1.0))
                    done += 1
                self._mapper.publish()
            self._worker.should_stop()  # counts as a turn of the loop
        self._iterations += done
        self._publish(report, store, start)
        if done < n:
            self._worker.event(
                "info", f"{done} of {n} last iterations done: --finish-s allows no more"
            )

    def publish_all_poses(self) -> None:
        """If mapping refines poses, publish those of all keyframes, as corrections leave some out."""
        if self._corrector and (store := self._link.store()) is not None:
            with self._worker.arena.lease(PARAMETERS_LEASE):
                self._corrector.publish_all(store)

    def _last_iterations_end_s(self) -> float:
        """Monotonic time at which the last iterations must end, so that the map is saved in time."""
        budget_s, stopped_ns = self._worker.options.finish_budget_s, self._mode.stopped_ns
        if math.isinf(budget_s) or not stopped_ns:
            return math.inf
        saving_s = _SAVING_S + _SAVING_FACTOR * 1e-9 * self._mode.saved_in_ns
        return 1e-9 * stopped_ns + budget_s - saving_s

    def _first_map(self, store: KeyframeStore) -> None:
        start = time.perf_counter()
        bound = initial_bound(store.frame(0), self._slam.bound, self._slam.mapper.max_depth_m)
        layout = FieldLayout.over(self._slam.field, bound)
        self._open(FieldParameters.create(self._worker.arena, layout, self._worker.options.seed))
        assert self._mapper is not None and self._parameters is not None
        n, done = self._slam.mapper.first_iterations, 0
        with self._worker.arena.lease(PARAMETERS_LEASE):
            while True:
                report = self._mapper.initialise(store)
                done += 1
                if done >= n or self._worker.should_stop():
                    break
            self._mapper.publish()
        self._backlog.skip_to(1)
        self._iterations += done
        self._publish(report, store, start)

    def _open(self, parameters: FieldParameters) -> None:
        self._parameters = parameters
        self._mapper = Mapper(self._slam, parameters, self._worker.options.seed, self._device)

    def _publish(self, report: StepReport, store: KeyframeStore, start: float) -> None:
        assert self._parameters is not None
        self._worker.counters.update(
            iterations=self._iterations, map_version=self._parameters.version
        )
        self._worker.count("samples outside the bound", report.outside)
        self._maps.put(
            MapVersion(
                version=self._parameters.version,
                iterations=self._parameters.step,
                loss=report.loss,
                keyframes=store.count,
                mapping_ms=1e3 * (time.perf_counter() - start),
                map_epoch=self._mode.map_epoch,
            )
        )


if __name__ == "__main__":
    main()
