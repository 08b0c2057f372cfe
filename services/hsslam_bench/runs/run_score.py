"""Scores a run of the benchmark and prints JSON; a file of its own because it is a process of its own.

`python -m hsslam_bench.runs.run_score RUN tsdf|consistency|rendering`
"""

import json
import sys
from pathlib import Path

from hsslam_node.evaluation.evaluate import Evaluator, Wanted
from hsslam_node.evaluation.mesh.tsdf_baseline import TSDF_SETTINGS
from hsslam_node.evaluation.scores import scores_as_json
from hsslam_services.commands.evaluate.subject import run_subject


def main() -> None:
    """Print the scores of the mesh and of TSDFs of its poses and depth (tsdf), of the agreement of frames
    (consistency), or of frames drawn from the map (rendering)."""
    folder, what = [argument for argument in sys.argv[1:] if argument != "--quick"]
    subject, _ = run_subject(folder, None, lambda text: print(text, file=sys.stderr))
    with_tsdf = what == "tsdf"
    wanted = Wanted(
        depth_views=0,
        rendering=what == "rendering",
        views=what == "rendering",
        consistency=what == "consistency",
        tsdfs=TSDF_SETTINGS if with_tsdf else (),
    )
    if not with_tsdf:
        subject = subject.without_mesh()
    found = Evaluator(subject, wanted).evaluate()
    if with_tsdf:
        from hsslam_node.evaluation.plots import draw_plots

        draw_plots(found, subject.trajectories, Path(folder) / "evaluation")
    print(json.dumps(scores_as_json(found.figures), allow_nan=False))


if __name__ == "__main__":
    main()
