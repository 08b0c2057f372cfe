"""The evaluator: after the run, the only process that sees ground truth; adds ATE."""

from hsslam_node.evaluation.evaluate_run import evaluate_run
from hsslam_node.services.summary import update_summary
from hsslam_node.services.worker import Worker, run_worker


def main() -> None:
    run_worker("evaluator", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    if not options.has_camera_process:
        return
    found = evaluate_run(worker.run.path, options.source, options.source_options)
    if found:
        update_summary(worker.run.path, {"evaluation": found})


if __name__ == "__main__":
    main()
