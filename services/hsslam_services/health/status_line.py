"""The status line: redrawn on a terminal, else printed every 5 s.

A slow or closed reader does not block or end the run.
"""

import sys
import time
from collections.abc import Mapping
from typing import TextIO, cast

from rich.console import Console
from rich.live import Live
from rich.text import Text

from hsslam_proto.messages import Pose
from hsslam_services.health.run_state import RunState
from hsslam_services.health.status import frames_dropped, frames_sent, load_level
from hsslam_services.launch.child import Child
from hsslam_services.run.camera_progress import SOURCE_FRAMES
from hsslam_services.run.resilient_stream import ResilientStream

_REDRAW_S = 0.25
_PRINT_S = 5.0
_DRAIN_S = 2.0
_STYLES = {"running": "green", "starting": "yellow", "waiting": "yellow", "ended": "dim"}


class StatusLine:
    """A context manager that shows the state of a run; `say` prints a line above it."""

    def __init__(self, console: Console | None = None) -> None:
        self._stream = ResilientStream(sys.stderr)
        self._console = console or Console(file=cast(TextIO, self._stream), highlight=False)
        self._live = (
            Live(console=self._console, auto_refresh=False, transient=True)
            if self._console.is_terminal
            else None
        )
        self._shown_s = 0.0

    def __enter__(self) -> "StatusLine":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def drain(self) -> None:
        """Wait until all lines are written, at most 2 s."""
        self._stream.drain(_DRAIN_S)

    def say(self, text: str, level: str = "info") -> None:
        """Print one line above the status line."""
        style = {"warning": "yellow", "error": "red"}.get(level, "")
        printable = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
        line = Text(printable, style=style)  # events may come from strangers: no escape sequences
        if self._console.is_terminal:
            self._console.print(line)
        else:
            self._console.print(line, soft_wrap=True)

    def show(self, state: RunState, children: Mapping[str, Child], memory_mb: int = 0) -> None:
        """Show the state if an update is due."""
        now = time.monotonic()
        if now - self._shown_s < (_REDRAW_S if self._live else _PRINT_S):
            return
        self._shown_s = now
        line = status_text(state, children, memory_mb)
        if self._live:
            self._live.update(line, refresh=True)
        else:
            self._console.print(line, soft_wrap=True)


def _quality(pose: Pose | None) -> str:
    """Tracking quality, with the fragment if there is one, or "lost"; "-" before the first pose."""
    if pose is None:
        return "-"
    if pose.fragment:
        return f"{pose.quality:.2f} in fragment {pose.fragment}"
    return "lost" if pose.status == "lost" else f"{pose.quality:.2f}"


def status_text(state: RunState, children: Mapping[str, Child], memory_mb: int = 0) -> Text:
    """Frame, rate, latency, tracking quality, keyframes, map version, drops, memory, health.

    After the number of the frame stands how many the source has, or has sent if it has no end.
    """
    pose = state.pose
    length = children["camera"].counted(SOURCE_FRAMES) if "camera" in children else 0
    frames = length or frames_sent(children, state)
    now_s = time.monotonic()
    has_none = state.tracking(now_s) == "none"
    quality = _quality(pose)
    frame = "-" if pose is None else str(pose.index)
    text = Text(
        f"frame {frame}/{frames}  {state.fps(now_s):.1f} FPS  {state.latency_ms(now_s):.0f} ms  "
        f"quality {'-' if has_none else quality}  "
        f"keyframes {state.last_keyframe + 1}  map {state.map.version if state.map else 0}  "
        f"dropped {frames_dropped(children)}  lost {state.lost}  memory {memory_mb} MB  "
    )
    if level := load_level(children):
        text.append(f"load level {level}  ", style="yellow")
    for name, child in children.items():
        text.append(f"{name}:", style="dim")
        text.append(f"{child.state} ", style=_STYLES.get(child.state, "red"))
    return text
