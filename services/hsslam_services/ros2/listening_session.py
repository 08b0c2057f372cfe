"""The zenoh session of a ROS camera: a client of the router of the ROS nodes, or that router itself."""

import time
from collections.abc import Callable

import zenoh

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.sources.options.topics import ROS_ROUTER
from hsslam_services.bus.zenoh_session import INTRODUCES_PEERS, open_client, open_router

_CONNECT_S, _PAUSE_S = 1.0, 0.1  # for a router to answer; between two tries


def open_listening_session(
    router: str, timeout_s: float, should_stop: Callable[[], bool]
) -> zenoh.Session | None:
    """A session with the ROS nodes, whose router may start later; None if `should_stop` first.

    `router`: its endpoint (--ros2.connect); empty: the usual one, or this session if none runs there.

    Raises:
        UserError: no router within `timeout_s` (--ros2.timeout-s).
    """
    deadline = time.monotonic() + timeout_s
    while not should_stop():
        try:
            return _session(router)
        except OutOfMemoryError:
            raise
        except UserError as error:
            if time.monotonic() > deadline:
                text = f"{error}: tried for {timeout_s:g} s (--ros2.timeout-s)"
                raise UserError(text) from None
        time.sleep(_PAUSE_S)
    return None


def _session(router: str) -> zenoh.Session:
    if router:
        return open_client(router, _CONNECT_S)
    try:
        return open_router(ROS_ROUTER, settings=INTRODUCES_PEERS)
    except UserError:
        return open_client(ROS_ROUTER, _CONNECT_S)
