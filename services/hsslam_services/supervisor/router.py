"""The router of a run: on loopback for everybody here, or behind certificates."""

import ipaddress
from pathlib import Path
from typing import NamedTuple

import zenoh

from hsslam_services.bus.zenoh_session import open_router, shared_memory_of_run
from hsslam_services.run.options import ServeOptions
from hsslam_services.security.access import WORKER_LINK, access_control
from hsslam_services.security.credentials import Credentials


class RunRouter(NamedTuple):
    """The open router, where processes of this run find it, and what to tell the user: text, level."""

    session: zenoh.Session
    endpoint: str
    notices: tuple[tuple[str, str], ...]


def open_run_router(options: ServeOptions, arena_dir: Path) -> RunRouter:
    """With `security`: mTLS on the port, and a socket in the arena's folder for processes of the run.

    Raises:
        UserError: the port is taken, or the certificate cannot be used.
        OutOfMemoryError: /dev/shm is full.
    """
    shared_memory = shared_memory_of_run(options.has_camera_process, sends_frames=False)
    if not options.security:
        session = open_router(f"tcp/{options.bind}:{options.zenoh_port}", settings=shared_memory)
        local = "127.0.0.1" if options.bind == "0.0.0.0" else options.bind
        endpoint = f"tcp/{local}:{options.zenoh_port}"
        warning = exposure(options.bind)
        return RunRouter(session, endpoint, ((warning, "warning"),) if warning else ())
    credentials = Credentials.read(options.security)
    credentials.expect_router()
    outside = f"tls/{options.bind}:{options.zenoh_port}"
    inside = f"{WORKER_LINK}/{arena_dir}/router.sock"
    access = {"access_control": access_control(options.robot)}
    settings = {**credentials.listening(), **access, **shared_memory}
    session = open_router(outside, inside, settings=settings)
    notice = f"zenoh: {outside}, for certificates of the CA of {credentials.folder}"
    return RunRouter(session, inside, ((notice, "info"),))


def exposure(bind: str) -> str:
    """What is wrong with listening there without security; empty for loopback."""
    try:
        is_loopback = ipaddress.ip_address(bind).is_loopback
    except ValueError:
        is_loopback = bind == "localhost"
    if is_loopback:
        return ""
    return (
        f"--bind {bind} without --security: whoever reaches this port can watch, feed false frames "
        "and stop the run; hsslam-certs makes certificates"
    )
