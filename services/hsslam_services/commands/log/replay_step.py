"""Replays to a running service frame by frame: sends a frame when the service is done with the last."""

import time
from collections import Counter
from collections.abc import Callable, Iterable

import msgspec

from hsslam_node.errors import UserError
from hsslam_proto import messages, run_messages
from hsslam_proto.frame_codec import restamped
from hsslam_proto.frame_order import FrameOrder, Place, new_publisher, replayed_publisher
from hsslam_proto.topics import FRAME, MAP, POSE, STEP
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.log_lag import LogLag
from hsslam_services.bus.peers import Peers
from hsslam_services.bus.publisher import Publisher
from hsslam_services.log.reading.reader import Logged

_SERVICE = ("tracker", "mapper", "global_ba")
_POLL_S = 0.05
_LOG_PATIENCE_S = 2.0
_RESEND_S = 30.0
_PATIENCE_S = 300.0
_NO_STEP_S = 3.0  # after a map version or a lost pose; in lockstep the step comes earlier


class StepByStep:
    """Sends frames and waits for the answer to each: the step `done` in lockstep, else the pose.

    `say` gets a line if the service is not in lockstep.
    """

    def __init__(
        self, bus: Bus, say: Callable[[str], None], patience_s: float = _PATIENCE_S
    ) -> None:
        self._bus = bus
        self._say = say
        self._patience_s = patience_s
        self._give_up_s = time.monotonic() + patience_s
        self._poses = bus.subscribe(POSE, 256, history=False)
        self._steps = bus.subscribe(STEP, 256)
        self._maps = bus.subscribe(MAP, 16, history=False)
        self._peers = Peers(bus)
        self._publisher = new_publisher()
        self._in_lockstep: bool | None = None  # unknown before the first answer
        self._lag = LogLag(has_recorder=False)

    def should_stop(self) -> bool:
        """Whether the time for an answer has passed."""
        return time.monotonic() > self._give_up_s

    def replay(self, logged: Iterable[Logged]) -> Counter[str]:
        """Publish all messages; a frame that is logged twice goes out once. Returns counts by topic.

        Raises:
            UserError: no service answers.
        """
        self._peers.wait(_SERVICE, (), self)
        if self.should_stop():
            raise UserError("--step: no service: expected hsslam-serve --source zenoh:")
        publishers = {}
        sent: Counter[str] = Counter()
        order, shifts = FrameOrder(), _Shifts()
        for entry in logged:
            if entry.topic not in publishers:
                publishers[entry.topic] = self._bus.publisher(entry.topic, block=True)
            if entry.topic is FRAME:
                message = entry.message()
                assert isinstance(message, messages.Frame)
                place = order.place(message.publisher, message.index, message.stamp_ns)
                if place.kind == "old":
                    continue
                order.take(place)
                index = shifts.index_without_jump(place)
                message = msgspec.structs.replace(message, index=index)
                again = replayed_publisher(place.publisher, self._publisher)
                self._send_until_answered(publishers[FRAME], message, again)
            else:
                publishers[entry.topic].put_payload(entry.payload)
            sent[entry.topic.name] += 1
        self._wait_for_log()
        return sent

    def _wait_for_log(self) -> None:
        """Wait until the recorder has all frames: frames on their way are lost when this process ends."""
        give_up_s = time.monotonic() + _LOG_PATIENCE_S
        while not self._lag.is_over() and time.monotonic() < give_up_s:
            self._bus.wait(_POLL_S)
            for step in self._steps.drain():
                self._lag.hear(step)

    def _send_until_answered(
        self, frames: Publisher, message: messages.Frame, publisher: int
    ) -> None:
        self._give_up_s = time.monotonic() + self._patience_s
        answer = _Answer(publisher, message.index)
        frames.put(restamped(message, publisher))
        self._lag.sent(publisher, message.index)
        sent_s = time.monotonic()
        while not self._is_answered(answer) or self._lag.must_wait():
            if self.should_stop():
                raise UserError(
                    f"frame {message.index}: no answer in {self._patience_s:g} s: expected a "
                    "service with --source zenoh:"
                )
            has_restarted = self._peers.restarted()
            if has_restarted:
                self._lag.forget()
            is_late = time.monotonic() - sent_s > _RESEND_S
            if not answer.is_done and (has_restarted or is_late):
                frames.put(restamped(message, publisher))
                sent_s = time.monotonic()

    def _is_answered(self, answer: "_Answer") -> bool:
        self._bus.wait(_POLL_S)
        steps = self._steps.drain()
        for step in steps:
            self._lag.hear(step)
        answer.hear(self._poses.drain(), steps, self._maps.drain())
        if answer.is_done:
            self._in_lockstep = True
        elif self._in_lockstep is None and answer.lacks_step():
            self._in_lockstep = False
            self._say("the service is not in lockstep: the replay waits only for its poses")
        return answer.is_done or (self._in_lockstep is False and answer.has_pose)


class _Shifts:
    """What is added to the indices of each camera, as the service would refuse a jump."""

    def __init__(self) -> None:
        self._newest: dict[int, int] = {}  # as sent, by publisher
        self._shift: dict[int, int] = {}

    def index_without_jump(self, place: Place) -> int:
        """The index to send for a new frame: behind a jump, that after the camera's last."""
        camera = place.publisher
        if place.kind == "absurd":
            self._shift[camera] = self._newest[camera] + 1 - place.index
        self._newest[camera] = place.index + self._shift.get(camera, 0)
        return self._newest[camera]


class _Answer:
    """The messages about one frame so far."""

    def __init__(self, publisher: int, index: int) -> None:
        self._name = publisher, index
        self._step_is_due_s = float("inf")
        self._heard_step = False
        self.has_pose = False
        self.is_done = False

    def hear(
        self,
        poses: list[messages.Pose],
        steps: list[run_messages.Step],
        maps: list[messages.MapVersion],
    ) -> None:
        """Take in new messages."""
        mine = [pose for pose in poses if (pose.publisher, pose.index) == self._name]
        self.has_pose |= bool(mine)
        self._heard_step |= bool(steps)
        done = [step for step in steps if step.stage == "done"]
        self.is_done |= any((step.publisher, step.index) == self._name for step in done)
        if any(pose.status == "lost" for pose in mine) or (self.has_pose and maps):
            self._step_is_due_s = min(self._step_is_due_s, time.monotonic() + _NO_STEP_S)

    def lacks_step(self) -> bool:
        """Whether a service in lockstep would have sent a step by now, but none came."""
        return not self._heard_step and time.monotonic() > self._step_is_due_s
