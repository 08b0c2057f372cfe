"""The request `save`: a separate process saves the map, one at a time."""

import contextlib
import subprocess
import time
from concurrent.futures import Future
from pathlib import Path

import msgspec

from hsslam_proto.request_messages import SavedMap
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.disk.disk_work import STEP_S, DiskWork
from hsslam_services.launch.process_table import MAP_SAVER, ONE_SHOT_TIMEOUT_S
from hsslam_services.launch.spawn import Process, Spawn, last_error, not_started, process_name
from hsslam_services.run.maps_folder import SAVE_REQUEST
from hsslam_services.run.process_result import ProcessResult, clear_result, read_result
from hsslam_services.run.run_info import RunInfo, write_atomically

_KILL_TIMEOUT_S = 5.0


class MapSaving:
    """Starts the process that saves, and answers when it has ended."""

    def __init__(
        self,
        run: RunInfo,
        spawn: Spawn,
        timeout_s: float = ONE_SHOT_TIMEOUT_S[MAP_SAVER],
        disk: DiskWork | None = None,
    ) -> None:
        self._disk = disk or DiskWork()
        self._run = run
        self._arena_dir = Path(run.arena_dir)
        self._spawn = spawn
        self._timeout_s, self._deadline_s = timeout_s, 0.0
        self._asked: list[PendingRequest] = []  # the same request, all answered alike
        self._process: Process | None = None
        self._result: Future[ProcessResult] | None = None  # once the process has ended

    @property
    def is_busy(self) -> bool:
        return self._process is not None

    def ask(self, asked: PendingRequest) -> None:
        """Start to save the map under a name; refused during another save.

        The same request during its save gets the same answer: a busy zenoh sends a request twice.
        """
        if self._asked and asked.message == self._asked[0].message:
            self._asked.append(asked)
            return
        if self.is_busy:
            asked.refuse("busy", "save: another map is being saved")
            return
        try:
            self._disk.do(lambda: clear_result(self._run.path, process_name(MAP_SAVER)))
            write_atomically(self._arena_dir / SAVE_REQUEST, msgspec.json.encode(asked.message))
            self._process = self._spawn(MAP_SAVER, self._run.path)
            self._asked = [asked]
            self._deadline_s = time.monotonic() + self._timeout_s
        except OSError as error:
            asked.refuse("failed", f"save: {not_started(error)}")

    def tick(self) -> None:
        """Answer if the process has ended; kill it if it takes too long."""
        if self._process is None:
            return
        code = self._process.poll()
        if code is not None:
            self._ended(code)
        elif self._asked and time.monotonic() > self._deadline_s:
            self._process.kill()
            self._refuse(f"not done after {self._timeout_s:g} s: killed")

    def _ended(self, code: int) -> None:
        """Answer once the disk gives the result of the process, for which it has a limited time."""
        if self._result is None:
            name = process_name(MAP_SAVER)
            self._result = self._disk.ask(lambda: read_result(self._run.path, name))
            self._deadline_s = time.monotonic() + STEP_S
        if self._result.done():
            result = self._result.result()
        elif time.monotonic() > self._deadline_s:
            self._result.cancel()
            result = ProcessResult(error=f"the disk does not answer for {STEP_S:g} s")
        else:
            return
        self._process, self._result = None, None
        if code == 0 and result.answer:
            while self._asked:
                self._asked.pop().answer(msgspec.convert(result.answer, SavedMap))
        else:
            self._refuse(last_error(result, self._run.path, MAP_SAVER))

    def close(self) -> None:
        """Kill the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_KILL_TIMEOUT_S)
        self._refuse("the run has ended")

    def _refuse(self, why: str) -> None:
        """Refuse the waiting requests, if any."""
        while self._asked:
            self._asked.pop().refuse("failed", f"save: {why}")
