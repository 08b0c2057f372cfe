"""The trajectory saver: writes the trajectories when a run or a map epoch ends; apart as each process is.

Arena: reads keyframes, map_state, pose_log
"""

from hsslam_node.errors import UserError
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.artefacts.trajectory_files import TrajectoryFiles
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker


def main() -> None:
    run_worker("trajectory_saver", _run)


def _run(worker: Worker) -> None:
    store = SharedMap(worker.arena, worker.options.slam).store()
    mode = MapState(worker.run.arena_dir)
    suffix = f".epoch{mode.map_epoch}" if mode.is_given_up else ""
    files = TrajectoryFiles(worker.arena, store, mode.map_epoch, suffix)
    worker.add_to_summary(files.section(worker.run.path))
    files.save(worker.run.path)
    if files.lost and mode.is_given_up:
        worker.event("error", files.lost)  # a reset does not bring the poses back
    elif files.lost:
        raise UserError(files.lost)


if __name__ == "__main__":
    main()
