"""The global bundle adjustment process: corrects keyframe poses, refines what the map renders badly.

Subscribes: out/map, sys/step
Publishes: out/correction, sys/step
Arena: reads map_state; writes keyframes, map
"""

from functools import partial

from hsslam_node.bundle_adjustment.open_adjustment import open_adjustment
from hsslam_node.bundle_adjustment.report import BaReport, BundleAdjustment
from hsslam_proto import topics
from hsslam_proto.messages import Correction, Step
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.arena import PARAMETERS_LEASE
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker, run_worker, worker_device

_POLL_S = 0.1


def main() -> None:
    run_worker("global_ba", _run)


def _run(worker: Worker) -> None:
    loop = _BaLoop(worker)
    if worker.options.pace == "lockstep":
        steps = worker.bus.subscribe(topics.STEP, depth=64)
        done = worker.bus.publisher(topics.STEP)
        newest = -1
        worker.ready()
        while not worker.should_stop():
            step = steps.wait(_POLL_S)
            if step is not None and step.stage == "mapped":
                if step.index > newest:  # as in the mapper: one round a frame
                    loop.work_if_due()
                newest = max(newest, step.index)
                done.put(Step(stage="done", index=step.index))
    else:
        maps = worker.bus.subscribe(topics.MAP, depth=1)
        worker.ready()
        while not worker.should_stop():
            if maps.wait(_POLL_S) is not None:
                loop.work_if_due()


class _BaLoop:
    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._device = worker_device(worker)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._corrections = worker.bus.publisher(topics.CORRECTION)
        self._mode = MapState(worker.run.arena_dir)
        self._ba: BundleAdjustment | None = None
        self._loops: list[tuple[int, int]] = []  # closed since the last correction

    def work_if_due(self) -> None:
        """One round, if enough keyframes have come since the last."""
        options = self._worker.options
        store, parameters = self._link.store(), self._link.parameters()
        if not options.slam.ba.enabled or store is None or parameters is None:
            return
        if parameters.version == 0 or not self._may_step():
            return
        if self._ba is None:
            self._ba = open_adjustment(options.slam, parameters, options.seed, self._device)
        if not self._ba.is_due(store):
            return
        with self._worker.timed("round"):
            lease = partial(self._worker.arena.lease, PARAMETERS_LEASE)
            report = self._ba.round(store, lease, self._may_step)
        self._worker.count("rounds")
        self._worker.count("keyframes refined", len(report.keyframes))
        self._worker.count("loops", len(report.loops))
        self._loops += report.loops
        if report.moved and self._may_step():
            base = store.pose_version
            version = store.correct_poses(report.keyframes, report.T_world_cam)
            self._worker.count("corrections")
            self._corrections.put(_correction(report, base, version, self._loops, self._mode.world))
            self._loops = []

    def _may_step(self) -> bool:
        """Whether the map may change; asked anew before each step, as a client can say no meanwhile."""
        return self._mode.may_change


def _correction(
    report: BaReport, base: int, version: int, loops: list[tuple[int, int]], world: int
) -> Correction:
    poses = [wire_pose(T) for T in report.T_world_cam]
    return Correction(
        pose_version=version,
        base_version=base,
        keyframes=[int(k) for k in report.keyframes],
        t=[t for t, _ in poses],
        q=[q for _, q in poses],
        loss_before=report.loss_before,
        loss_after=report.loss_after,
        loops=[(min(pair), max(pair)) for pair in loops],
        world=world,
    )


if __name__ == "__main__":
    main()
