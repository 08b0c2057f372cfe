"""The evaluator: compares a finished run with ground truth; a process is a file of its own.

No other process sees ground truth.
"""

from dataclasses import replace
from pathlib import Path

from hsslam_node.evaluation.evaluate_run import evaluate_run
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.log.source import recorded_source
from hsslam_services.run.camera_progress import CameraProgress


def main() -> None:
    run_worker("evaluator", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    read = CameraProgress.read(Path(worker.run.arena_dir)).next_index
    if not options.has_camera_process or not options.evaluate or read == 0:
        return
    until_now = replace(options.source_options, frames=read)  # an interrupted run is judged so far
    worker.event("info", "comparing with ground truth, if the source has it")
    source = recorded_source(options.source, until_now, lambda text: worker.event("info", text))
    found = evaluate_run(worker.run.path, source.spec, source.options)
    if found:
        worker.add_to_summary({"evaluation": found})


if __name__ == "__main__":
    main()
