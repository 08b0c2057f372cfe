"""The final map saver: writes the map at the end of a run; apart as each process is.

Arena: reads keyframes, map
"""

from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.artefacts.map_file import has_changed, save_map
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker


def main() -> None:
    run_worker("final_map_saver", _run)


def _run(worker: Worker) -> None:
    published = SharedMap(worker.arena, worker.options.slam).published()
    if published is not None:
        if has_changed(*published):
            worker.event("info", f"saving the map: {len(published[0].kept())} keyframes")
        else:
            worker.event("info", "the map is as it was loaded: not saved again")
        worker.add_to_summary(save_map(worker.run.path, *published, worker.options))


if __name__ == "__main__":
    main()
