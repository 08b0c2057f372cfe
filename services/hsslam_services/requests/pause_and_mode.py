"""The requests `pause`, `resume` and `set-mode`."""

from hsslam_proto import topics
from hsslam_proto.request_messages import Done, Mode, SetMode
from hsslam_proto.run_messages import Event, Hold
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.run.run_info import RunInfo


class CameraPause:
    """Pauses the camera for clients, and for the service while it cannot take frames.

    `is_paused`: a client has paused the camera.
    """

    def __init__(self, bus: Bus, run: RunInfo) -> None:
        self.is_paused = False
        self._run = run
        self._holds = bus.publisher(topics.HOLD)

    def set(self, asked: PendingRequest, paused: bool) -> None:
        """Pause or resume, and answer; refused if another program sends the frames."""
        if not self._run.options.has_camera_process:
            name = asked.request.name
            asked.refuse(
                "not_now", f"{name}: another program sends the frames: {name} its camera there"
            )
            return
        word = "paused" if paused else "running"
        again = self.is_paused == paused
        self.is_paused = paused
        self._holds.put(Hold(paused=paused))
        asked.answer(Done(text=f"was {word} already" if again else word))

    def suspend(self) -> None:
        """Pause the camera until `release`."""
        self._holds.put(Hold(paused=True))

    def release(self) -> None:
        """Resume the camera, unless a client has paused it."""
        self._holds.put(Hold(paused=self.is_paused))


class ModeSetting:
    """Writes the mode of the run, which every process reads before it changes the map.

    `has_map`: whether there is a map to localise in.
    """

    def __init__(self, bus: Bus, run: RunInfo) -> None:
        self.has_map = bool(run.options.map)
        self._mode = MapState(run.arena_dir)
        self._events = bus.publisher(topics.EVENT)

    @property
    def now(self) -> Mode:
        """The current mode."""
        return "localise-only" if self._mode.localise_only else "mapping"

    def set(self, asked: PendingRequest) -> None:
        """Set the mode, and answer; localise-only is refused while there is no map."""
        wanted: SetMode = asked.message
        if wanted.mode == self.now:
            asked.answer(Done(text=f"was {wanted.mode} already"))
        elif wanted.mode == "localise-only" and not self.has_map:
            asked.refuse("not_now", "set-mode: there is no map yet: expected its first version")
        else:
            self._mode.localise_only = wanted.mode == "localise-only"
            text = f"mode set to {wanted.mode} by a client"
            self._events.put(Event.now("control", "info", text))
            asked.answer(Done(text=wanted.mode))
