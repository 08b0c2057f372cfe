import threading
import time

import pytest
import zenoh

from hsslam_proto.request_messages import Ask
from hsslam_proto.requests import PAUSE, STATUS
from hsslam_services.bus.ask import NoAnswerError, NoServiceError, RefusedError, ask
from hsslam_services.bus.bus import Bus, free_endpoint
from hsslam_services.bus.zenoh_session import open_client


def test_no_router_is_no_service():
    with pytest.raises(NoServiceError, match=r"no service: .*expected a router"):
        ask(free_endpoint(), "r", STATUS, Ask(), connect_s=0.3)


def test_no_run_of_that_robot_is_no_service(endpoint):
    start = time.monotonic()
    with pytest.raises(NoServiceError, match="no service: no run of robot 'r2'"):
        ask(endpoint, "r2", STATUS, Ask())
    assert time.monotonic() - start < STATUS.takes_s  # told at once, not by a timeout


def test_a_refusal_is_told(endpoint):
    with Bus(endpoint, "r", "supervisor") as bus:
        queue = bus.requests()
        _until_known(endpoint)
        service = threading.Thread(target=_refuse_one, args=(queue,))
        service.start()
        with pytest.raises(RefusedError, match="refused: pause: not now"):
            ask(endpoint, "r", PAUSE, Ask())
        service.join()


def test_no_answer_in_time_is_a_timeout(endpoint):
    with open_client(endpoint) as service:
        ring = zenoh.handlers.RingChannel(4)
        queryable = service.declare_queryable("hsslam/r/rpc/**", ring)
        with open_client(endpoint) as client:
            while not queryable.try_recv():
                client.get("hsslam/r/rpc/x", timeout=0.2)
                time.sleep(0.02)
        with pytest.raises(NoAnswerError, match=r"timeout: no answer to pause within 0\.3 s"):
            ask(endpoint, "r", PAUSE, Ask(), timeout_s=0.3)
        queryable.undeclare()


def test_an_answer_of_another_type_is_not_understood(endpoint):
    with open_client(endpoint) as service:

        def answer(query: zenoh.Query) -> None:
            query.reply(query.key_expr, b"\x80", encoding=zenoh.Encoding("zenoh/bytes"))

        queryable = service.declare_queryable("hsslam/r/rpc/**", answer)
        _until_known(endpoint)
        with pytest.raises(RefusedError, match="cannot decode the answer"):
            ask(endpoint, "r", PAUSE, Ask())
        queryable.undeclare()


def _refuse_one(queue) -> None:
    while (asked := queue.poll()) is None:
        time.sleep(0.01)
    asked.refuse("not_now", "pause: not now")


def _until_known(endpoint) -> None:
    with open_client(endpoint) as client:
        while not list(client.get("hsslam/r/rpc/x")):
            time.sleep(0.02)
