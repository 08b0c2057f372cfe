"""What an attempt that has ended counts as, by its exit code, its words and its frames."""

import contextlib
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hsslam_batch.attempt.outcome import Kind
from hsslam_batch.attempt.watched_process import End, Limits
from hsslam_batch.plan.batch import Batch
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.exit_code import MEANINGS, ExitCode
from hsslam_services.run.summary import read_summary

_STATUS_LINE = "frame "


def judged(
    end: End,
    limits: Limits,
    words: str,
    meanings: Mapping[ExitCode, str] | Mapping[int, str] = MEANINGS,
) -> tuple[Kind, str]:
    """What a command that has ended counts as, and why in one line if it failed.

    `words`: its last line; `meanings`: of its exit codes.
    """
    if end.why == "timeout":
        return "timeout", f"not done after {limits.timeout_s:g} s: ended (--timeout)"
    if end.why == "memory":
        took = f"took {end.memory_mb / 1e3:.2f} GB, of {limits.memory_gb:g} allowed"
        return "memory", f"{took}: ended (--memory)"
    if end.code < 0:
        return "crash", f"killed by {signal.Signals(-end.code).name}; {words}"
    if end.code == ExitCode.BAD_INPUT:
        return "bad input", words
    if end.code != ExitCode.SAVED:
        meaning = next((f" ({text})" for code, text in meanings.items() if code == end.code), "")
        return "crash", f"exit code {end.code}{meaning}; {words}"
    return "done", ""


def judged_frames(summary: dict[str, Any], expected: int) -> tuple[Kind, str]:
    """Whether a run that ended well has a pose for each frame that its log has."""
    frames = summary.get("frames", {})
    done, sent = frames.get("tracked", 0) + frames.get("lost", 0), frames.get("in", 0)
    if done != sent or sent + frames.get("bad", 0) != expected:
        return "crash", f"{done} of {expected} frames have a pose, {sent} were sent"
    return "done", ""


def selected_frames(batch: Batch, source: str) -> int:
    """How many frames of a source a run uses.

    Raises:
        UserError: the log is not there, or cannot be read.
    """
    options = parse_command_line(["--config", str(batch.config)]).source_options
    return open_any_source(source, options).frame_count or 0


def last_words(output: Path) -> str:
    """The last line that a command printed, status lines apart: of a mistake the error."""
    text = output.read_text(errors="replace")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    said = [line for line in lines if not line.startswith(_STATUS_LINE)]
    return said[-1].removeprefix("error: ") if said else "no message"


def summary_of(run_dir: Path) -> dict[str, Any]:
    """summary.json as far as it is there; empty if it is damaged."""
    with contextlib.suppress(OSError, ValueError):
        return read_summary(run_dir)
    return {}
