"""`hsslam-bench ablation|replica|tum|scannet`: measures a table of the paper, prints and writes it."""

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
    track,
)

from hsslam_bench.results.document import fill_table
from hsslam_bench.results.report import machine
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.tables.figures import disagreements, markdown_table, measured_rows, rich_table
from hsslam_bench.tables.options import TableOptions
from hsslam_bench.tables.paper_tables import LITERATURE, METHOD_OF_PRESET, TABLES, PaperTable
from hsslam_bench.tables.plan import Plan, RunResult, folder_name, plan_table
from hsslam_bench.tables.published.scene_settings import settings_of
from hsslam_bench.tables.result_file import ResultFile
from hsslam_bench.tables.run_job import rescored, run_job
from hsslam_node.presets import PresetName
from hsslam_services.commands.cli import parse_options
from hsslam_services.run.summary import source_commit

_WIDTH = 230  # characters, without a terminal


def table_command(name: str, args: Sequence[str]) -> int:
    """Measure the table of this name; returns the exit code.

    Raises:
        UserError: a bad option, or a file that is not readable or writable.
    """
    options = parse_options(TableOptions, f"hsslam-bench {name}", args)
    table = TABLES[name]
    plan = plan_table(table, options)
    path = options.out or Path("runs/tables") / f"{name}.json"
    file = ResultFile(path, name)
    width = None if sys.stdout.isatty() else _WIDTH
    console = Console(emoji=False, highlight=False, markup=False, width=width)
    for line in plan.skipped:
        console.print(line, soft_wrap=True)
    interrupted = False
    results: list[RunResult] = []
    if options.show:
        results = [found for job in plan.jobs if (found := file.newest(job))]
    elif plan.jobs:
        step = _rescore if options.rescore else _measure
        try:
            step(plan, file, path.with_suffix(""), results, console)
        except KeyboardInterrupt:
            interrupted = True
    _print(table, plan, options, results, path, console)
    return int(interrupted or not results or any(result.error for result in results))


def _measure(
    plan: Plan, file: ResultFile, runs: Path, results: list[RunResult], console: Console
) -> None:
    """Fill `results` and show the progress; without a terminal print one line a run."""
    commit, on = source_commit(), machine()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(
        *columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True
    ) as progress:
        all_runs = progress.add_task("runs", total=len(plan.jobs))
        frames = progress.add_task("frames", total=None)
        for job in plan.jobs:
            result = file.done(job, commit)
            if result is None:
                progress.reset(frames, description=job.name, total=None)
                result = run_job(
                    job,
                    runs / folder_name(job),
                    commit,
                    lambda done, total: progress.update(frames, completed=done, total=total),
                )
                file.add(result, on)
                text = result.error or f"ATE {result.values.get('ate_cm', float('nan')):.3f} cm"
            else:
                text = "kept from an earlier call"
            results.append(result)
            progress.advance(all_runs)
            if result.error or not console.is_terminal:
                console.print(f"{job.name}: {text}", soft_wrap=True)


def _rescore(
    plan: Plan, file: ResultFile, runs: Path, results: list[RunResult], console: Console
) -> None:
    """Score the files of the runs again; a run without files keeps its scores."""
    commit, on = source_commit(), machine()
    for job in track(plan.jobs, "scoring", console=console, transient=True):
        result = file.newest(job)
        if result is None or result.error:
            continue
        try:
            folder = runs / folder_name(result)
            if not folder.is_dir():
                raise RunFailedError(f"{folder}: no such folder")
            result = rescored(job, result, folder, commit)
            file.add(result, on)
        except RunFailedError as failure:
            console.print(f"{job.name}: keeps its scores: {failure}", soft_wrap=True)
        results.append(result)


def _print(
    table: PaperTable,
    plan: Plan,
    options: TableOptions,
    results: Sequence[RunResult],
    path: Path,
    console: Console,
) -> None:
    if not results:
        console.print("nothing was measured: no table")
        return
    method = METHOD_OF_PRESET[options.preset]
    rows = measured_rows(table, plan.rows, results, method)
    notes = _protocol(options, results, table.metrics)
    if table.sequences:
        notes += disagreements(rows, table.metrics)
    title = f"{table.title}, preset {options.preset}"
    console.print(rich_table(title, rows, table.metrics))
    for note in notes:
        console.print(note, soft_wrap=True)
    text = markdown_table(rows, table.metrics) + "".join(f"\n{note}\n" for note in notes)
    path.with_suffix(".md").write_text(text)
    for document in options.docs:
        fill_table(document, table.name, text)
    console.print(f"results: {path}, {path.with_suffix('.md')}", soft_wrap=True)


def _protocol(
    options: TableOptions, results: Sequence[RunResult], metrics: Sequence[str]
) -> list[str]:
    """Lines with everything that a reader needs to reproduce the table."""
    used = [options.protocol, f"seeds {' '.join(map(str, options.seeds))}"]
    commits = sorted({result.commit or "unknown" for result in results})
    used.append(f"commit {', '.join(commits)}")
    scored = sorted({result.scored_by for result in results if result.scored_by})
    if scored:
        used.append(f"scored by {', '.join(scored)}")
    if options.device == "cpu":
        used.append("frames/s of processor time")
    lines = [f"{'; '.join(used)}.", *_values(options.preset, results)]
    if set(LITERATURE) & set(metrics):
        lines.append(
            "lit.: the literature's protocol, as in the paper; all others: our exact protocol."
        )
    failed = [f"{r.row} {r.sequence} seed {r.seed}: {r.error}" for r in results if r.error]
    return lines + [f"failed: {text}" for text in failed]


def _values(preset: PresetName, results: Sequence[RunResult]) -> list[str]:
    """A line for each group of sequences for which the preset has special values."""
    names: dict[str, list[str]] = {}
    for sequence in dict.fromkeys(result.sequence for result in results):
        settings = settings_of(preset, sequence)
        changed = [f"{name} = {value:g}" for name, value in settings.overrides.items()]
        if changed:
            text = f"values of {settings.data_set}: {', '.join(changed)}"
            names.setdefault(text, []).append(sequence)
    return [f"{', '.join(sequences)}: {text}." for text, sequences in names.items()]
