"""The global bundle adjustment process: corrects keyframe poses.

Subscribes: out/map, sys/step
Publishes: out/correction, sys/step
Arena: reads map_state, load_level; writes keyframes, map
"""

import time
from contextlib import AbstractContextManager, nullcontext
from functools import partial

from hsslam_node.bundle_adjustment.adjustment import BundleAdjustment
from hsslam_node.bundle_adjustment.open_adjustment import open_adjustment
from hsslam_node.bundle_adjustment.report import BaReport
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.frame_order import FrameOrder
from hsslam_proto.run_messages import Step
from hsslam_services.arena.arena import PARAMETERS_LEASE
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.pose_corrector import PoseCorrector
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.governor.background_pace import BackgroundPace
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.launch.worker_device import worker_device

_POLL_S = 0.1
_CATCH_UP_SHARE = 0.3  # share of `finish_budget_s` for rounds after the last frame


def main() -> None:
    run_worker("global_ba", _run)


def _run(worker: Worker) -> None:
    loop = _BaLoop(worker)
    if worker.options.pace == "lockstep":
        steps = worker.bus.subscribe(topics.STEP, depth=64)
        done = worker.bus.publisher(topics.STEP)
        order = FrameOrder()
        worker.ready()
        while not worker.should_stop():
            step = steps.wait(_POLL_S)
            if step is not None and step.stage == "mapped":
                if order.is_new(step.publisher, step.index):  # as in the mapper: one round a frame
                    loop.work_if_due()
                done.put(Step(stage="done", index=step.index, publisher=step.publisher))
    else:
        maps = worker.bus.subscribe(topics.MAP, depth=1)
        worker.ready()
        while not worker.should_stop():
            if maps.wait(_POLL_S) is not None:
                loop.work_if_due()
    loop.catch_up()
    loop.publish_all()


class _BaLoop:
    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._is_lockstep = worker.options.pace == "lockstep"
        self._device = worker_device(worker)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._mode = MapState(worker.run.arena_dir)
        self._corrector = PoseCorrector(worker.bus.publisher(topics.CORRECTION), self._mode)
        self._level = SharedLevel(worker.run.arena_dir)
        self._pace = BackgroundPace(self._level, worker.stop_event())
        self._count_at_round = 0
        self._ba: BundleAdjustment | None = None
        self._loops: list[tuple[int, int]] = []  # closed since the last correction

    def work_if_due(self) -> None:
        """Do one round if enough keyframes have come since the last."""
        if (opened := self._opened()) is None:
            return
        ba, store = opened
        if ba.is_due(store) and self._may_begin(store.count):
            self._round(ba, store)

    def catch_up(self) -> None:
        """After the last frame: do rounds over keyframes that no round has seen, as under load; in lockstep,
        only if a fragment has joined the map since the last round."""
        budget_s = self._worker.options.finish_budget_s
        end_s = 1e-9 * self._mode.stopped_ns + _CATCH_UP_SHARE * budget_s
        while not self._worker.is_orphan() and time.monotonic() < end_s:
            opened = self._opened()
            if opened is None:
                return
            ba, store = opened
            if not (ba.has_joined(store) if self._is_lockstep else ba.is_behind(store)):
                return
            self._round(ba, store)

    def publish_all(self) -> None:
        """Publish the poses of all keyframes, as corrections leave some out."""
        if (store := self._link.store()) is not None:
            with self._alone():
                self._corrector.publish_all(store)

    def _opened(self) -> tuple[BundleAdjustment, KeyframeStore] | None:
        """The adjustment and its keyframes; None while there is no map to adjust."""
        options = self._worker.options
        store, parameters = self._link.store(), self._link.parameters()
        if not options.slam.ba.enabled or store is None or parameters is None:
            return None
        if parameters.version == 0 or not self._may_step():
            return None
        if self._ba is None:
            self._ba = open_adjustment(options.slam, parameters, options.seed, self._device)
        return self._ba, store

    def _round(self, ba: BundleAdjustment, store: KeyframeStore) -> None:
        self._count_at_round = store.count
        lease = partial(self._worker.arena.lease, PARAMETERS_LEASE)
        with self._worker.timed("round"):
            report = ba.round(store, lease, self._may_step, self._rest)
        self._worker.count("rounds")
        self._worker.count("keyframes refined", len(report.keyframes))
        self._worker.count("loops", len(report.loops))
        self._loops += report.loops
        if report.moved and self._may_step():
            with self._alone():
                self._correct(store, report)

    def _alone(self) -> AbstractContextManager[None]:
        """If mapping refines poses too, only the holder of the lease writes them."""
        is_alone = self._worker.options.slam.mapper.pose_rate == 0
        return nullcontext() if is_alone else self._worker.arena.lease(PARAMETERS_LEASE)

    def _rest(self) -> None:
        """Rest between two pieces of a round; counts as a turn of the loop for the supervisor."""
        self._worker.should_stop()
        self._pace.rest()

    def _correct(self, store: KeyframeStore, report: BaReport) -> None:
        losses = report.loss_before, report.loss_after
        self._corrector.correct(
            store, report.keyframes, report.T_world_cam, report.known, losses, self._loops,
            T_then=report.T_then,
        )  # fmt: skip
        self._worker.count("corrections")
        self._loops = []

    def _may_begin(self, count: int) -> bool:
        """Whether enough keyframes have come since the last round for the load level."""
        every = self._worker.options.slam.ba.every_keyframes * self._level.now.ba_every
        return self._level.number == 0 or count - self._count_at_round >= every

    def _may_step(self) -> bool:
        """Whether the map may change; asked before each step, as a client can forbid it at any time."""
        return self._mode.may_change


if __name__ == "__main__":
    main()
