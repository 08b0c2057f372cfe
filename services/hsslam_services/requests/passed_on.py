"""Requests that mesher or tracker answer; apart from those that the supervisor answers."""

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

    def ask(self, asked: PendingRequest) -> None:
        """Answer when that process has answered; never blocks."""
        self._waiting.add(asked)

    def _answer(self, asked: PendingRequest) -> None:
        answer = self._bus.pass_on(self._request, asked.message)
        if isinstance(answer, Refusal):
            asked.refuse(answer.reason, answer.text)
        else:
            asked.answer(answer)
