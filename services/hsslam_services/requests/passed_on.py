"""Requests that mesher or tracker answer; apart from those that the supervisor answers."""

import threading

from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import Request
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.requests.waiting_requests import WaitingRequests


class PassedOn:
    """Forwards requests of one kind to the process that answers them, one after the other."""

    def __init__(self, bus: Bus, request: Request) -> None:
        self._bus = bus
        self._request = request
        self._waiting = WaitingRequests(request.name, self._answer)
        self._under_way = threading.Lock()  # held from `ask` to the answer if one at a time

    def ask(self, asked: PendingRequest) -> None:
        """Answer when that process has answered; never blocks."""
        if self._request.one_at_a_time and not self._under_way.acquire(blocking=False):
            busy = self._request.busy
            asked.refuse(busy.reason, busy.text)
            return
        if not self._waiting.add(asked) and self._request.one_at_a_time:
            self._under_way.release()

    def _answer(self, asked: PendingRequest) -> None:
        try:
            answer = self._bus.pass_on(self._request, asked.message)
        finally:
            if self._request.one_at_a_time:
                self._under_way.release()
        if isinstance(answer, Refusal):
            asked.refuse(answer.reason, answer.text)
        else:
            asked.answer(answer)
