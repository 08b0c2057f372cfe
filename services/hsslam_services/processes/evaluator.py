"""The evaluator: after the run, the only process that sees ground truth; adds ATE.

What the comparison with ground truth found, in one line for people.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hsslam_node.evaluation.evaluate_run import evaluate_run
from hsslam_services.launch.worker import Worker, run_worker
from hsslam_services.log.source import recorded_source
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.summary import update_summary


def evaluation_line(found: Mapping[str, Any]) -> str:
    """ATE of each trajectory in cm and, where the true mesh is known, distance in cm and completion in %.

    `found`: as `evaluate_run` returns it; what is not known is None there.
    """
    ates_m = {name: ate.get("rmse_m") for name, ate in found.get("ate", {}).items()}
    known = [f"{name} {1e2 * ate_m:.2f} cm" for name, ate_m in ates_m.items() if ate_m is not None]
    line = f"ATE: {', '.join(known)}" if known else "ATE: no poses to compare"
    mesh = found.get("mesh", {})
    off_m, complete = mesh.get("accuracy_mean_m"), mesh.get("completion_ratio_5cm")
    if off_m is not None and complete is not None:
        line += f"; mesh: {1e2 * off_m:.2f} cm off, {1e2 * complete:.1f} % complete within 5 cm"
    return line


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
        update_summary(worker.run.path, {"evaluation": found})
        worker.event("info", evaluation_line(found))


if __name__ == "__main__":
    main()
