"""The router of a run: a socket for processes of this user, and an optional port for other programs."""

import ipaddress
from pathlib import Path
from typing import NamedTuple

import zenoh

from hsslam_services.bus.zenoh_session import INTRODUCES_PEERS, open_router, shared_memory_of_run
from hsslam_services.run.options import ServeOptions
from hsslam_services.security.access import WORKER_LINK, access_control
from hsslam_services.security.certificate_validity import CertificateValidity
from hsslam_services.security.credentials import Credentials
from hsslam_services.supervisor.descriptors import most_sessions

_QUEUE = "transport/link/tx/queue"
_OVERWRITTEN = {
    "link_protocols": ["tcp", "tls"],
    "flows": ["egress"],
    "overwrite": {"congestion_control": "drop"},
}
_OUTSIDERS = (
    {"id": "news", "messages": ["put", "delete"], "key_exprs": ["**", "**/@adv/**"]},
    {"id": "history", "messages": ["query"], "key_exprs": ["**/@adv/**"]},  # and the replies
)
# A client that reads too slowly delays the others by a few ms once, and then misses messages. It can ask for
# those with a history again. Answers to its requests still wait for it.
_BRIEF_WAITS: dict[str, object] = {
    "qos/network": [{**rule, **_OVERWRITTEN} for rule in _OUTSIDERS],
    f"{_QUEUE}/congestion_control/drop/wait_before_drop": 1_000,  # us
    f"{_QUEUE}/congestion_control/drop/max_wait_before_drop_fragments": 10_000,  # us
}


class RunRouter(NamedTuple):
    """The open router, its endpoint for processes of this run, and notices for the user: text, level."""

    session: zenoh.Session
    endpoint: str
    notices: tuple[tuple[str, str], ...]
    certificate_validity: CertificateValidity | None


def open_run_router(options: ServeOptions, arena_dir: Path) -> RunRouter:
    """Open a socket in the arena's folder for processes of this user, and a TCP port if an option needs one.

    Without `security` the port accepts every client, with it only certificates of its CA (mTLS).

    Raises:
        UserError: the port is taken, or the certificate cannot be used.
        OutOfMemoryError: /dev/shm is full.
    """
    inside = f"{WORKER_LINK}/{arena_dir}/router.sock"
    settings = {**_BRIEF_WAITS, **shared_memory_of_run(options.has_camera_process, False)}
    settings["transport/unicast/max_sessions"] = most_sessions()
    settings["access_control"] = access_control(
        options.robot, bool(options.security), options.ros_domain, options.has_camera_process
    )
    if options.ros_domain is not None:
        settings |= INTRODUCES_PEERS
    notices: list[tuple[str, str]] = []
    outside, certificate_validity, warning = (), None, ""
    if options.security:
        credentials = Credentials.read(options.security)
        credentials.expect_router()
        certificate_validity = credentials.validity
        settings |= credentials.listening()
        outside = (f"tls/{options.outside_place}",)
        text = f"zenoh: {outside[0]}, for certificates of the CA of {credentials.folder}"
        notices.append((text, "info"))
        warning = credentials.exposure()
    elif options.outside_place:
        outside = (f"tcp/{options.outside_place}",)
        warning = exposure(options.bind or "127.0.0.1")
    if warning:
        notices.append((warning, "warning"))
    session = open_router(*outside, inside, settings=settings, expected=_wanted_port(options))
    return RunRouter(session, inside, tuple(notices), certificate_validity)


def _wanted_port(options: ServeOptions) -> str:
    """The advice in the error of a taken port."""
    if not options.has_usual_port:
        return "a free port"
    is_of_ros = options.ros_domain is not None and not options.ros2.connect
    beside = "; if rmw_zenohd has 7447, the run then connects to it" if is_of_ros else ""
    return f"a free port, as --zenoh-port 7448{beside}"


def exposure(bind: str) -> str:
    """The warning about listening at `bind` without security; empty for loopback."""
    try:
        is_loopback = ipaddress.ip_address(bind).is_loopback
    except ValueError:
        is_loopback = bind == "localhost"
    if is_loopback:
        return ""
    return (
        f"--bind {bind} without --security: every machine that reaches this port can watch the run, send "
        "false frames and stop it; hsslam-certs makes certificates"
    )
