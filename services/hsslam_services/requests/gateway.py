"""The request gateway: answers requests of clients in the supervisor's loop."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from hsslam_proto import requests as rpc
from hsslam_proto import topics
from hsslam_proto.request_messages import Done, Status
from hsslam_proto.run_messages import Event
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.health.run_state import RunState
from hsslam_services.health.status import rejected_messages, run_status
from hsslam_services.launch.child import Child
from hsslam_services.launch.spawn import Spawn
from hsslam_services.requests.map_reset import MapReset
from hsslam_services.requests.map_save import MapSaving
from hsslam_services.requests.mesh_and_trajectory import NewestMesh, TrajectorySoFar
from hsslam_services.requests.passed_on import PassedOn
from hsslam_services.requests.pause_and_mode import CameraPause, ModeSetting
from hsslam_services.run.run_info import RunInfo

_AT_A_TIME = 64  # requests in one turn of the loop


class Gateway:
    """Answers the table of requests; `tick` never blocks, but for a second if the disk hangs.

    `wants_stop`: a client has asked to stop the run. `is_loading`: the map of `--map` is not in the arena
    yet, and no process of the run has started; the supervisor resets it.
    """

    def __init__(self, bus: Bus, run: RunInfo, spawn: Spawn, disk: DiskWork | None = None) -> None:
        self.wants_stop = False
        self.is_loading = bool(run.options.map)
        self._is_stopping = False
        self._run = run
        self._bus = bus
        self._events = bus.publisher(topics.EVENT)
        self._requests = bus.requests()
        self._pause = CameraPause(bus, run)
        self._mode = ModeSetting(bus, run)
        self._mesh = NewestMesh(bus)
        self._trajectory = TrajectorySoFar(Path(run.arena_dir), self._warn)
        self._queries = PassedOn(bus, rpc.QUERY)
        self._places = PassedOn(bus, rpc.LOCATE)
        self._saving = MapSaving(run, spawn, disk=disk)
        self._reset = MapReset(bus, run, spawn, self._pause, disk)

    @property
    def is_busy(self) -> bool:
        """Whether a save or a reset is in progress; the end of the run waits for it."""
        return self._saving.is_busy or self._reset.is_busy

    @property
    def is_resetting(self) -> bool:
        """Whether a reset restarts tracker and mapper; other processes start after them."""
        return self._reset.is_busy

    def begin_stop(self) -> None:
        """Refuse requests that change the run from now on: it ends."""
        self._is_stopping = True

    def tick(self, state: RunState, children: Mapping[str, Child], memory_mb: int) -> None:
        """Answer the requests since the last call."""
        for _ in range(_AT_A_TIME):
            asked = self._requests.poll()
            if asked is None:
                break
            if asked.request is rpc.STATUS:
                asked.answer(self.status(state, children, memory_mb))
            else:
                self._mode.has_map |= state.map is not None
                self._answer(asked, state, children)
        self._saving.tick()
        map_epoch = self._reset.map_epoch
        self._reset.tick()
        if self._reset.map_epoch != map_epoch:
            self._mode.has_map = False
            self._mesh.forget(self._reset.map_epoch)

    def status(self, state: RunState, children: Mapping[str, Child], memory_mb: int) -> Status:
        """State of the run."""
        phase = "stopping" if self._is_stopping else self._pace
        rejected = sum(self.rejected(children).values())
        status = run_status(self._run, state, children, self._requests, phase, memory_mb, rejected)
        return msgspec.structs.replace(status, mode=self._mode.now, map_epoch=self._reset.map_epoch)

    def rejected(self, children: Mapping[str, Child]) -> dict[str, int]:
        """Messages that could not be read, by topic."""
        return rejected_messages(self._bus.subscriptions, children)

    def section(self, children: Mapping[str, Child]) -> dict[str, Any]:
        """For the summary: counts of requests, of refused requests and of unreadable messages."""
        return {
            "requests": {"received": self._requests.received, "refused": self._requests.refused},
            "rejected": self.rejected(children),
        }

    def close(self) -> None:
        """End a save or reset in progress."""
        self._saving.close()
        self._reset.close()

    def _warn(self, text: str) -> None:
        self._events.put(Event.now("control", "warning", text))

    @property
    def _pace(self) -> Any:
        return "paused" if self._pause.is_paused else "running"

    def _answer(
        self, asked: PendingRequest, state: RunState, children: Mapping[str, Child]
    ) -> None:
        match asked.request:
            case rpc.MESH:
                self._mesh.ask(asked)
            case rpc.QUERY:
                self._queries.ask(asked)
            case rpc.TRAJECTORY:
                self._trajectory.ask(asked)
            case rpc.STOP:
                again = self.wants_stop or self._is_stopping
                self.wants_stop = True
                asked.answer(Done(text="was stopping already" if again else "stopping"))
            case _ if self._is_stopping:
                asked.refuse("not_now", f"{asked.request.name}: the run is ending")
            case _ if self._reset.is_busy and asked.request is not rpc.RESET:
                asked.refuse("busy", f"{asked.request.name}: a reset is in progress")
            case rpc.LOCATE:
                self._places.ask(asked)
            case rpc.SAVE:
                self._saving.ask(asked)
            case rpc.PAUSE:
                self._pause.set(asked, True)
            case rpc.RESUME:
                self._pause.set(asked, False)
            case rpc.SET_MODE:
                self._mode.set(asked)
            case rpc.RESET if self.is_loading:
                asked.refuse("not_now", "reset: the map of --map is being loaded")
            case rpc.RESET if self._saving.is_busy:
                asked.refuse("busy", "reset: a map is being saved")
            case rpc.RESET:
                has_map = self._mode.has_map or state.last_keyframe >= 0
                self._reset.ask(asked, has_map=has_map, state=state, children=children)
