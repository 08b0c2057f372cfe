"""The task of a Ray worker: starts `hsslam-batch work` for a log, and passes on its progress and result.

It imports neither NumPy nor PyTorch. If the worker dies, the command's standard input closes, and the command
ends the run.
"""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

import msgspec

from hsslam_batch.attempt.outcome import Ended, Frames, Line, Outcome, Refused, Unavailable


class TaskResult(msgspec.Struct, frozen=True):
    """The result of a task: an outcome, or why there is none.

    `is_begun`: False if the batch is stopping, or if the command refused the log (`trouble`). `is_lost`: its
    worker or machine died, `is_out_of_memory`: as Ray killed it. `is_unavailable`: folder or store of the
    batch failed. `node_id`: Ray's id.
    """

    outcome: Outcome | None = None
    trouble: str = ""
    is_begun: bool = True
    is_lost: bool = False
    is_out_of_memory: bool = False
    is_unavailable: bool = False
    node_id: str = ""


def perform(arguments: list[str], index: int, board: Any) -> TaskResult:
    """Run `hsslam-batch work` with these arguments; `board`: the handle of a `Board`."""
    command = [sys.executable, "-P", "-m", "hsslam_batch", "work", *arguments, "--json", "--tied"]
    return perform_command(command, index, board)


def perform_command(command: Sequence[str], index: int, board: Any) -> TaskResult:
    """Run a command that prints the same lines as `hsslam-batch work --json`."""
    import ray

    node_id = ray.get_runtime_context().get_node_id()
    if not ray.get(board.begin.remote(index, node_id)):
        return TaskResult(is_begun=False)
    outcome, refusal, lack = None, "", ""
    with tempfile.TemporaryFile() as stderr:  # a pipe that is not read would stop the process
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stderr,
            start_new_session=True,
        )
        assert process.stdout
        for text in process.stdout:
            match msgspec.json.decode(text, type=Line):
                case Frames(frames):
                    board.progress.remote(index, frames)
                case Ended(found):
                    outcome = found
                case Refused(reason):
                    refusal = reason
                case Unavailable(reason):
                    lack = reason
        code = process.wait()
        stderr.seek(0)
        words = stderr.read().decode(errors="replace").strip().splitlines()
    if outcome is not None:
        return TaskResult(outcome, node_id=node_id)
    if refusal:
        return TaskResult(trouble=refusal, is_begun=False, node_id=node_id)
    if lack:
        return TaskResult(trouble=lack, is_unavailable=True, node_id=node_id)
    how = f"exit code {code}" if code >= 0 else f"signal {-code}"
    last = words[-1].removeprefix("error: ") if words else "no message"
    return TaskResult(trouble=f"hsslam-batch work ended with {how}: {last}", node_id=node_id)
