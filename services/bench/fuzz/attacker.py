"""Somebody who floods a run with what nobody can read, from its first pose on."""

import threading
from pathlib import Path
from typing import Any

from hsslam_node.errors import UserError
from hsslam_node.proto.request_messages import Ask
from hsslam_node.proto.requests import STATUS
from hsslam_node.services.bench.fuzz.sender import FuzzSender
from hsslam_node.services.control.ask import NotDoneError, ask
from hsslam_node.services.run_info import RunInfo
from hsslam_node.services.zenoh_session import open_client

_RATE_HZ = 400.0  # of messages on each topic, and of each request
_CLOSE_S = 30.0


class Attacker:
    """Sends `count` of each; what it has sent is told at the end."""

    def __init__(self, run_folder: Path, count: int) -> None:
        self._run_folder = run_folder
        self._count = count
        self._sender: FuzzSender | None = None
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()

    def poll(self) -> None:
        """Begin when all processes that a step needs take work: when there is a pose."""
        if self._thread is None and (run := _tracking_run(self._run_folder)) is not None:
            self._thread = threading.Thread(target=self._send, args=(run,), daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Send no more."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(_CLOSE_S)

    def found(self) -> dict[str, Any]:
        """What was sent, by topic and by request, and how many requests were refused."""
        if self._sender is None:
            return {}
        sent = self._sender.sent
        return {
            "messages": dict(sent.messages),
            "requests": dict(sent.requests),
            "kinds": dict(sent.kinds),
            "refused": sent.refused,
            "not_refused": sent.not_refused,
        }

    def _send(self, run: RunInfo) -> None:
        with open_client(run.endpoint) as session:
            self._sender = FuzzSender(session, run.robot, seed=0, rate_hz=_RATE_HZ)
            self._sender.send(self._count, self._stopped.is_set)


def _tracking_run(folder: Path) -> RunInfo | None:
    try:
        run = RunInfo.read(folder)
        status = ask(run.endpoint, run.robot, STATUS, Ask(), timeout_s=1.0, connect_s=0.5)
    except (UserError, NotDoneError):
        return None
    return run if status.frames_tracked > 0 else None
