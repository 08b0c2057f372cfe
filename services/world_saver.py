"""Writes the trajectories of a map that is thrown away, before its keyframes are gone; then ends."""

from hsslam_node.errors import UserError
from hsslam_node.services.map_link import MapLink
from hsslam_node.services.run_mode import RunMode
from hsslam_node.services.saver import save_trajectories
from hsslam_node.services.worker import Worker, run_worker


def main() -> None:
    run_worker("world_saver", _run)


def _run(worker: Worker) -> None:
    store = MapLink(worker.arena, worker.options.slam).store()
    world = RunMode(worker.run.arena_dir).world
    try:
        save_trajectories(worker.run.path, worker.arena, store, world, f".world{world}")
    except OSError as error:
        where = f"{worker.run.path}: {error.strerror}"
        raise UserError(f"{where}: expected to write the trajectories so far there") from None


if __name__ == "__main__":
    main()
