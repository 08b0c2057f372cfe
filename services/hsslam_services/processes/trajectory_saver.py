"""The trajectory saver: writes the trajectories of a map before a reset; a process is a file of its own.

A process of its own because the supervisor, which resets, does not import torch.

Arena: reads keyframes, map_state, pose_log
"""

from hsslam_node.errors import UserError
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker, run_worker
from hsslam_services.run.trajectory_files import save_trajectories


def main() -> None:
    run_worker("trajectory_saver", _run)


def _run(worker: Worker) -> None:
    store = SharedMap(worker.arena, worker.options.slam).store()
    world = MapState(worker.run.arena_dir).world
    try:
        section = save_trajectories(worker.run.path, worker.arena, store, world, f".world{world}")
    except OSError as error:
        where = f"{worker.run.path}: {error.strerror}"
        raise UserError(f"{where}: expected to write the trajectories so far there") from None
    worker.add_to_summary(section)


if __name__ == "__main__":
    main()
