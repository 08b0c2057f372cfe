"""The evaluator: compares a finished run with ground truth; apart as each process is.

No other process sees ground truth.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.evaluation.evaluate_run import evaluate_run
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.log.reading.source import recorded_source
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.source_table import log_place


def main() -> None:
    run_worker("evaluator", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    read = CameraProgress.read(Path(worker.run.arena_dir)).next_index
    if not options.has_camera_process or not options.evaluate or read == 0:
        return
    until_now = replace(options.source_options, frames=read)  # for an interrupted run
    worker.event("info", "comparing with ground truth, if the source has it")
    try:
        source = recorded_source(options.source, until_now, partial(worker.event, "info"))
        found = evaluate_run(worker.run.path, source.spec, source.options)
    except UserError as error:
        if not log_place(options.source):
            raise
        # the source of a log and its ground truth may be on another machine, or unknown
        worker.event("warning", f"not compared with ground truth: {error}")
        return
    if found:
        worker.add_to_summary({"evaluation": found})
    elif source.options.reorders:
        why = f"the source repeats frames, and {source.spec} has no ground truth for some of them"
        worker.event("warning", f"not compared with ground truth: {why}")


if __name__ == "__main__":
    main()
