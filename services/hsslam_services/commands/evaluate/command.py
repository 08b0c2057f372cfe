"""`hsslam-eval`: scores a run, or a trajectory and a mesh, against ground truth: table, JSON, plots."""

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from hsslam_node.errors import UserError
from hsslam_node.evaluation.evaluate import Evaluator, Subject, Wanted
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.scores import scores_as_json
from hsslam_node.evaluation.trajectory.ate import at_true_stamps
from hsslam_node.geometry.trajectory import Trajectory, read_estimate, write_tum
from hsslam_node.sources.options.source import SourceOptions
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.commands.cli import exit_code, parse_options, terminal_progress
from hsslam_services.commands.evaluate.options import EvalOptions
from hsslam_services.commands.evaluate.subject import run_subject, source_of_run
from hsslam_services.commands.evaluate.table import eval_table
from hsslam_services.commands.output_files import (
    expect_json_file,
    expect_writable_folder,
    write_json_file,
)
from hsslam_services.log.reading.files import is_log
from hsslam_services.log.reading.source import RecordedSource, recorded_source
from hsslam_services.run.summary import source_commit

_PROG = "hsslam-eval"
_VIEWS_FILE = "virtual_views.txt"


def main(args: Sequence[str] | None = None) -> None:
    """Run the command; exit code 0, 1 or 2, see `EvalOptions`."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _evaluate(_options(given))):
        sys.exit(code)


def _options(args: Sequence[str]) -> EvalOptions:
    options = parse_options(EvalOptions, _PROG, args)
    options.expect_subject()
    return options


def _evaluate(options: EvalOptions) -> None:
    if options.json is not None:
        expect_json_file(options.json)
    if options.plots is not None:
        expect_writable_folder("--plots", options.plots)
    subject, about = _subject(options)
    wanted = Wanted(
        depth_views=options.depth_views,
        cull_views=options.cull_views,
        rendering=options.rendering,
        views=options.views,
        consistency=options.consistency,
        tsdfs=options.tsdf_settings,
        seed=options.seed,
    )
    is_of_run = options.run and not options.source
    with terminal_progress() as progress:
        with source_of_run(options.run) if is_of_run else nullcontext():
            evaluator = Evaluator(subject, wanted, progress.track)
        evaluator.expect_pairs(options.run or f"--trajectory {options.trajectory}")
        found = evaluator.evaluate()
    figures: dict[str, Any] = scores_as_json({**about, **found.figures})
    console = Console(emoji=False, highlight=False, markup=False)
    for table in eval_table(figures):
        console.print(table)
    for what, why in figures.get("left_out", {}).items():
        _echo(f"{what}: not scored: {why}")
    written: list[Path] = []
    if options.json is not None:
        write_json_file(options.json, figures)
        written.append(options.json)
    folder = options.plots or _writable_folder(options.run)
    if folder is not None:
        from hsslam_node.evaluation.plots import draw_plots  # matplotlib is slow to import

        written += draw_plots(found, subject.trajectories, folder)
    path = _views_file(folder, options.json)
    if found.judge is not None and path is not None:
        poses = found.judge.virtual_poses
        write_tum(path, Trajectory(np.arange(len(poses)) * 1_000_000_000, poses))
        written.append(path)
    for path in written:
        console.print(str(path), soft_wrap=True)


def _views_file(folder: Path | None, json: Path | None) -> Path | None:
    """The file for the poses of virtual views: in the folder of the plots, else beside the file of `--json`
    and with its name, as those of other evaluations may be there; None if there is neither, or that file is
    a stream such as /dev/stdout."""
    if folder is not None:
        return folder / _VIEWS_FILE
    if json is not None and json.is_file() and not json.absolute().is_relative_to("/dev"):
        return json.with_name(f"{json.stem}.{_VIEWS_FILE}")
    return None


def _subject(options: EvalOptions) -> tuple[Subject, dict[str, Any]]:
    """The subject of the evaluation, and entries beside its figures."""
    about: dict[str, Any] = {"commit": source_commit(), "evaluation_seed": options.seed}
    source = (
        RecordedSource(options.source, SourceOptions.among(options)) if options.source else None
    )
    if options.run:
        subject, of_run = run_subject(options.run, source, _echo)
        return subject, about | of_run
    assert source is not None  # expect_subject
    source = recorded_source(source.spec, source.options, _echo)
    trajectories = {}
    if options.trajectory:
        trajectories["final"] = _given_poses(options.trajectory, source)
    about |= {"source": options.source, "noise": options.noise}
    spec, used = source.spec, source.options
    return Subject(spec, used, trajectories, options.mesh, open_it=open_any_source), about


def _given_poses(path: Path, source: RecordedSource) -> Trajectory:
    """The poses with the stamps of the source's frames, which scores of mesh and consistency need."""
    found = read_estimate(path)
    if len(found) == 0:
        raise UserError(f"--trajectory {path}: no poses: expected poses in TUM format")
    truth = open_ground_truth(source.spec, source.options)
    return found if truth is None else at_true_stamps(found, truth.trajectory)


def _writable_folder(run: str) -> Path | None:
    """Default folder of the plots of a run; None for a log, or with a warning if it cannot be written."""
    if not run or is_log(run):
        return None
    folder = Path(run) / "evaluation"
    try:
        expect_writable_folder("--plots", folder)
    except UserError as error:
        _echo(f"no plots: {str(error).removeprefix('--plots ')}, or --plots FOLDER")
        return None
    return folder


def _echo(text: str) -> None:
    print(text, file=sys.stderr)


if __name__ == "__main__":
    main()
