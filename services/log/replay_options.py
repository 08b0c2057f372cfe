"""What a user can ask of `hsslam-replay`: one frozen dataclass; every field is an option."""

import math
from dataclasses import dataclass
from typing import Annotated

import tyro

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class ReplayOptions:
    """Publishes a log again: the same payloads on the same zenoh keys, in the order of the log.

    $ hsslam-replay run.mcap --rate 2
    $ hsslam-replay run.mcap --step --connect tcp/127.0.0.1:7447

    Without --connect it is the router itself, for viewers and tools that connect to it. With --connect
    and --step it feeds a service (hsslam-serve --source zenoh: --pace lockstep) frame by frame, each when
    the last is done with, so that a lossless log gives the same poses each time.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    log: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = ""
    """The log, or a run folder with all its parts."""
    rate: float = 1.0
    """How many times as fast as it was recorded."""
    step: bool = False
    """Frames one by one, each when the service has tracked the last (and mapped it, in lockstep)."""
    only: tuple[str, ...] = ()
    """Keys below hsslam/ROBOT/ that are published, such as in/** or out/** (none: all but those of sys;
    with --step: in/**)."""
    connect: str = ""
    """Router to connect to, as tcp/HOST:PORT (empty: be the router)."""
    security: str = ""
    """Folder of your certificate (hsslam-certs), for --connect tls/HOST:PORT."""
    zenoh_port: int = 7447
    """TCP port to listen on as the router."""
    bind: str = "127.0.0.1"
    """Address to listen on as the router."""
    delay: float = 2.0
    """Seconds before the first message, for others to connect."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate) and self.rate > 0):
            raise UserError(f"--rate {self.rate:g}: expected a number above 0")
        if not (math.isfinite(self.delay) and self.delay >= 0):
            raise UserError(f"--delay {self.delay:g}: expected seconds, 0 or more")
        if not 1 <= self.zenoh_port <= 65535:
            raise UserError(f"--zenoh-port {self.zenoh_port}: expected 1 to 65535")
        if self.security and not self.connect:
            raise UserError(f"--security {self.security}: expected with --connect tls/HOST:PORT")
        if self.step and not self.connect:
            raise UserError("--step: waits for a service: expected --connect tcp/HOST:PORT")
        if self.step and self.rate != 1.0:
            raise UserError("--rate: expected without --step, which goes as fast as it is answered")
