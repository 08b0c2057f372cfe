"""A client that floods a run with malformed messages and requests, from its first pose on."""

import threading
import time
from pathlib import Path
from typing import Any, TypeVar

from hsslam_bench.fuzz.sender import FuzzSender, open_sending_session
from hsslam_node.errors import UserError
from hsslam_proto.message import Message
from hsslam_proto.request_messages import Ask, Status
from hsslam_proto.requests import PAUSE, RESUME, STATUS, Request
from hsslam_services.bus.ask import NotDoneError, ask
from hsslam_services.run.run_info import RunInfo

A = TypeVar("A", bound=Message)
_RATE_HZ = 200.0  # of messages on each topic, and of each request
_CLOSE_S = 30.0
_LOOK_S = 1.0  # between two status requests
_COUNTED_S = 30.0  # for messages on their way to be counted


class Attacker:
    """Sends `count` malformed messages on each topic and request; `found` reports what was sent.

    If the run reaches its second half before all are sent, it is paused until the processes have counted all
    messages, since no process counts messages after its end.
    """

    def __init__(self, run_folder: Path, count: int) -> None:
        self._run_folder = run_folder
        self._count = count
        self._sender: FuzzSender | None = None
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()
        self._run: RunInfo | None = None
        self._look_again_s = 0.0
        self._give_up_s: float | None = None
        self._is_paused = self._is_resumed = False

    def poll(self) -> None:
        """Start sending after the first tracked pose; then pause and resume the run as needed."""
        if self._run is not None:
            self._pause_if_late(self._run)
        elif (run := _tracking_run(self._run_folder)) is not None:
            self._run = run
            self._thread = threading.Thread(target=self._send, args=(run,), daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop sending."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(_CLOSE_S)

    def found(self) -> dict[str, Any]:
        """Numbers of messages by topic, of requests by name, and of refused requests."""
        if self._sender is None:
            return {}
        sent = self._sender.sent
        return {
            "messages": dict(sent.messages),
            "requests": dict(sent.requests),
            "kinds": dict(sent.kinds),
            "refused": sent.refused,
            "not_refused": sent.not_refused,
            "paused": self._is_paused,
        }

    def _pause_if_late(self, run: RunInfo) -> None:
        """Pause the run once, if it is half over, and resume it when all messages are counted."""
        if time.monotonic() < self._look_again_s:
            return
        self._look_again_s = time.monotonic() + _LOOK_S
        status = _ask(run, STATUS)
        if status is None or self._is_resumed:
            return
        if not self._is_paused:
            is_late = self._is_sending() and status.frames_sent >= _frames(run) / 2
            self._is_paused = is_late and _ask(run, PAUSE) is not None
        elif self._is_counted(status):
            self._is_resumed = _ask(run, RESUME) is not None

    def _is_sending(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def _is_counted(self, status: Status) -> bool:
        """Whether all messages are counted; after `_COUNTED_S` uncounted ones are taken for lost."""
        if self._is_sending() or self._sender is None:
            return False
        self._give_up_s = self._give_up_s or time.monotonic() + _COUNTED_S
        counted = status.messages_rejected >= self._sender.sent.messages.total()
        return counted or time.monotonic() > self._give_up_s

    def _send(self, run: RunInfo) -> None:
        with open_sending_session(run.endpoint) as session:
            self._sender = FuzzSender(session, run.robot, seed=0, rate_hz=_RATE_HZ)
            self._sender.send(self._count, self._stopped.is_set)


def _tracking_run(folder: Path) -> RunInfo | None:
    try:
        run = RunInfo.read(folder)
    except UserError:
        return None
    status = _ask(run, STATUS)
    if status is None or status.frames_tracked == 0:
        return None
    # some topics have only the recorder as a reader, and it may start after the tracker
    return run if status.processes.get("recorder", "running") == "running" else None


def _ask(run: RunInfo, request: Request[Ask, A]) -> A | None:
    """The answer, or None if none comes within 2 s."""
    try:
        return ask(run.endpoint, run.robot, request, Ask(), timeout_s=2.0, connect_s=0.5)
    except (UserError, NotDoneError):
        return None


def _frames(run: RunInfo) -> int:
    """Number of frames that the camera sends, by the options; 0: not known."""
    lengths = [n for n in (run.options.frames, run.options.synth.length) if n is not None]
    return min(lengths, default=0)
