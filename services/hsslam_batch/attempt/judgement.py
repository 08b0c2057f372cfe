"""Judges an attempt that has ended, by its exit code, its last line of output and its frames."""

import contextlib
import errno
import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hsslam_batch.attempt.outcome import Kind
from hsslam_batch.attempt.watched_process import End, Limits
from hsslam_batch.plan.batch import Batch
from hsslam_node.errors import (
    GPU_IS_FULL,
    MORE_SHARED_MEMORY,
    OUT_OF_MEMORY,
    STORAGE_FAILS,
    TOO_FEW_FILES,
    on_one_line,
)
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.launch.spawn import how_it_ended
from hsslam_services.run.camera_progress import SOURCE_FRAMES, UNREAD
from hsslam_services.run.exit_code import MEANINGS, ExitCode
from hsslam_services.run.summary import read_summary

_STATUS_LINE = "frame "
_NOT_SAVED = " not saved: "
_KILLED = how_it_ended(-signal.SIGKILL)
_SHORT_OF = (errno.ENOSPC, errno.EDQUOT, errno.ENOMEM, errno.EMFILE, errno.ENFILE, errno.EAGAIN)
_FAILS = (*STORAGE_FAILS, errno.EROFS)
_OF_THE_MACHINE = (  # in errors that are not the log's
    MORE_SHARED_MEMORY,
    GPU_IS_FULL,
    OUT_OF_MEMORY,
    TOO_FEW_FILES,
    "can't start new thread",  # by Python
    *(os.strerror(number) for number in (*_SHORT_OF, *_FAILS)),
)
_OF_THE_POSES = ("tracker", "mapper", "global_ba")  # processes that a log's results depend on


def judged(
    end: End,
    limits: Limits,
    words: str,
    meanings: Mapping[ExitCode, str] | Mapping[int, str] = MEANINGS,
) -> tuple[Kind, str]:
    """The kind of outcome of a command that has ended, and one line about why if it failed.

    `words`: the last line that it printed; `meanings`: text for each exit code.
    """
    if end.why == "timeout":
        return "timeout", f"stopped: took longer than {limits.timeout_s:g} s (--timeout)"
    if end.why == "memory":
        used = f"used {end.memory_mb / 1e3:.2f} GB, more than {limits.memory_gb:g}"
        return "memory", f"stopped: {used} (--memory)"
    if end.code < 0:
        return "crash", f"killed by {signal.Signals(-end.code).name}; {words}"
    if end.code == ExitCode.BAD_INPUT:
        return kind_of_error(words), words
    if end.code != ExitCode.SAVED:
        meaning = next((f" ({text})" for code, text in meanings.items() if code == end.code), "")
        return "crash", f"exit code {end.code}{meaning}; {words}"
    return "done", ""


def kind_of_error(text: str) -> Kind:
    """The kind of a failure by its text: a crash, which is tried again, if the machine lacks memory, room,
    threads or files, or if its disk or network fails; else bad input."""
    return "crash" if any(of_machine in text for of_machine in _OF_THE_MACHINE) else "bad input"


def judged_frames(summary: dict[str, Any], expected: int | None) -> tuple[Kind, str]:
    """Done if a run has a pose message for each frame of its log, except bad frames, if all are in run.mcap,
    if no disk failed to give a frame, and if no process was restarted whose restart changes poses or map;
    else a crash.

    `expected`: frames of the log; None: not known, so that each frame that was sent needs a pose message.
    """
    frames = summary.get("frames", {})
    done, sent = frames.get("tracked", 0) + frames.get("lost", 0), frames.get("in", 0)
    if expected is None:
        expected = max(sent, 1) + frames.get("bad", 0)
    if done != sent or sent + frames.get("bad", 0) != expected:
        return "crash", f"{done} of {expected} frames have a pose, {sent} were sent"
    processes = summary.get("processes", {})
    if unread := _of_camera(summary).get(UNREAD):
        return "crash", f"{unread} frames could not be read: the disk or its network failed"
    for name in _OF_THE_POSES:
        if restarts := processes.get(name, {}).get("restarts"):
            return (
                "crash",
                f"{name} was restarted {restarts} x: the results are others than without",
            )
    if missing := summary.get("log", {}).get("frames_dropped"):
        return "crash", f"{missing} frames are not in run.mcap, as on a disk that is nearly full"
    return "done", ""


def judged_with_kills(kind: Kind, reason: str, end: End, output: Path) -> tuple[Kind, str]:
    """The same kind and reason, but `out of memory` for a crash if the kernel has killed processes for lack
    of memory meanwhile, and if SIGKILL has ended the command or, as its output says, a process of it.
    """
    if kind != "crash" or not end.oom_kills:
        return kind, reason
    if end.code != -signal.SIGKILL and _KILLED not in output.read_text(errors="replace"):
        return kind, reason
    killed = "a process" if end.oom_kills == 1 else f"{end.oom_kills} processes"
    return "out of memory", f"{reason}; the kernel killed {killed}: expected more --memory"


def _of_camera(summary: dict[str, Any]) -> dict[str, int]:
    """The counters of the camera of a run."""
    return summary.get("processes", {}).get("camera", {}).get("counters", {})


def selected_frames(summary: dict[str, Any], batch: Batch, source: str) -> int | None:
    """Number of frames of a source that a run uses; None: not known before the run.

    The camera of the run has counted them; opens the source if it has not, which may take as long as a run.

    Raises:
        UserError: the log is missing or not readable.
    """
    if (counted := _of_camera(summary).get(SOURCE_FRAMES)) is not None:
        return counted
    options = parse_command_line(["--config", str(batch.config)]).source_options
    return open_any_source(source, options).frame_count


def last_words(output: Path) -> str:
    """The last line that a command printed, except status lines; after an error, the error.

    If something is not saved, the last line that says why: what is kept in memory goes with the attempt.
    """
    text = output.read_text(errors="replace")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    messages = [line for line in lines if not line.startswith(_STATUS_LINE)]
    messages = [line for line in messages if _NOT_SAVED in line] or messages
    return on_one_line(messages[-1].removeprefix("error: ")) if messages else "no message"


def summary_of(run_dir: Path) -> dict[str, Any]:
    """The content of summary.json; empty if the file is missing or damaged."""
    with contextlib.suppress(OSError, ValueError):
        return read_summary(run_dir)
    return {}
