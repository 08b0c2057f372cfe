"""Requests about places in the map: the mesher answers them; apart from those that the supervisor answers."""

from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import QUERY
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.requests.waiting_requests import WaitingRequests


class PassedOnQueries:
    """Passes questions on to the mesher, which has the map and time for it, one after the other."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._waiting = WaitingRequests("queries", self._answer)

    def ask(self, asked: PendingRequest) -> None:
        """Answer as soon as the mesher has; never blocks."""
        self._waiting.add(asked)

    def _answer(self, asked: PendingRequest) -> None:
        answer = self._bus.pass_on(QUERY, asked.message)
        if isinstance(answer, Refusal):
            asked.refuse(answer.reason, answer.text)
        else:
            asked.answer(answer)
