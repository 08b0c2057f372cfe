"""What a user can ask of `hsslam-certs`: one frozen dataclass; every field is an option."""

import re
from dataclasses import dataclass
from typing import Annotated

import tyro

from hsslam_node.errors import UserError

_HOST = r"[A-Za-z0-9]([A-Za-z0-9.:-]{0,252}[A-Za-z0-9])?|::1?"


@dataclass(frozen=True)
class CertsOptions:
    """Makes throw-away certificates for a service that is reached from other machines.

    $ hsslam-certs certs --host 10.0.0.7 robot.local
    $ hsslam-serve --bind 0.0.0.0 --security certs/router
    $ hsslam-ctl status --connect tls/10.0.0.7:7447 --security certs/operator

    DIR gets a folder for the CA, one for the router, and one for each role: camera, viewer, operator. Each
    is complete: copy it to the machine that needs it, and no other. Keys can be read by their owner alone.

    Exit code 0: made; 2: bad input, told in one line.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    folder: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")] = ""
    """New folder for the certificates."""
    host: tuple[str, ...] = ()
    """Names and addresses by which clients reach the router, beside this machine's name and loopback."""
    days: int = 90
    """How long all of them are valid, days."""

    def __post_init__(self) -> None:
        for host in self.host:
            if not re.fullmatch(_HOST, host):
                raise UserError(f"--host {host}: expected names or addresses")
        if not 1 <= self.days <= 3650:
            raise UserError(f"--days {self.days}: expected 1 to 3650")
