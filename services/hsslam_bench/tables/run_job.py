"""Runs a job in a process of its own, so that a crash fails only this run."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.tables.plan import Job, RunResult
from hsslam_node.errors import UserError
from hsslam_services.launch.spawn import child_environment

_MODULE = "hsslam_bench.tables.table_run"
_JOB, _SCORE_JOB, _RESULT, _ERRORS = "job.json", "score.json", "result.json", "stderr.txt"


def run_job(
    job: Job, folder: Path, commit: str, report: Callable[[int, int], None] = lambda *_: None
) -> RunResult:
    """Run a job to its end in `folder`, which is emptied first; a failure is a result with `error`.

    `report` gets the frames that are done and the number of all frames. An interrupt kills the process.

    Raises:
        UserError: the folder is not writable.
    """
    try:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}: expected a folder for the run") from None
    found, error = _run(job, folder / _JOB, report)
    return RunResult(
        key=job.key,
        row=job.row,
        sequence=job.sequence,
        seed=job.seed,
        protocol=job.protocol,
        commit=commit,
        time=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        error=error,
        **found,
    )


def rescored(job: Job, result: RunResult, folder: Path, commit: str) -> RunResult:
    """The result with new scores of the trajectories, mesh and map in `folder`.

    Raises:
        RunFailedError: the process failed; the text has its last line of output.
    """
    found, error = _run(job, folder / _SCORE_JOB, lambda *_: None, "--score")
    if error:
        raise RunFailedError(error)
    return msgspec.structs.replace(
        result,
        values=result.values | found["values"],
        details=result.details | found["details"],
        scored_by=commit,
    )


def _run(
    job: Job, path: Path, report: Callable[[int, int], None], *options: str
) -> tuple[dict[str, Any], str]:
    """Write the job to `path` and run it; returns its result, and an error if it failed."""
    path.write_bytes(msgspec.json.encode(job))
    with (path.parent / _ERRORS).open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", _MODULE, str(path), *options],
            env=child_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        try:
            assert process.stdout is not None
            for line in process.stdout:
                done, _, total = line.strip().partition(" ")
                if done.isdigit() and total.isdigit():
                    report(int(done), int(total))
            code = process.wait()
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    if code:
        return {}, f"ended with code {code}: {_last_line(path.parent / _ERRORS)}"
    return msgspec.json.decode((path.parent / _RESULT).read_bytes()), ""


def _last_line(path: Path) -> str:
    lines = path.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no message"
