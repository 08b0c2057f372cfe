"""What a user can ask of `hsslam-ctl`: one frozen dataclass; every field is an option."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, get_args

import tyro

from hsslam_node.errors import UserError, did_you_mean
from hsslam_proto.request_messages import Mode
from hsslam_proto.requests import REQUESTS
from hsslam_services.run.maps_folder import expect_map_name

_MODES: tuple[str, ...] = get_args(Mode)
_ENDPOINT = r"(tcp|tls|quic|udp|ws)/\S+:\d{1,5}"


@dataclass(frozen=True)
class CtlOptions:
    """Asks a running service: status | mesh | trajectory | save NAME | pause | resume |
    set-mode mapping|localise-only | reset | stop.

    $ hsslam-ctl status
    $ hsslam-ctl mesh --out room.ply
    $ hsslam-ctl save kitchen
    $ hsslam-ctl stop --connect tcp/10.0.0.7:7447 --robot r2
    $ hsslam-ctl pause --connect tls/10.0.0.7:7447 --security certs/operator

    status: frames, rate, latency, tracking, processes. mesh: the newest, as a PLY file (m, world).
    trajectory: poses as refined, in TUM format (s, m, unit quaternion; camera to world). save: keeps the
    map in the maps folder of the service. pause holds the camera, resume lets it go on; set-mode
    localise-only: the map stays as it is from now on, mapping: it goes on. reset throws the map away
    and starts a new one with the next frame, in a coordinate frame of its own. stop ends the run in
    order. What is at work on this machine is found by itself.

    Exit code 0: done; 1: nobody there, refused, or no answer in time; 2: bad input. One line tells.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    request: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="REQUEST")] = ""
    """What is asked, as above."""
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[NAME]")] = ""
    """Of the map, for save: letters, digits, _ and -; the mode, for set-mode."""
    connect: str = ""
    """Where the service listens, as tcp/10.0.0.7:7447 (empty: the run on this machine)."""
    security: str = ""
    """Folder of your certificate (hsslam-certs), for --connect tls/HOST:PORT."""
    run: Path | None = None
    """Folder of the run that is meant, where several go on here."""
    robot: str = ""
    """Its name in the zenoh keys (empty: that of the run on this machine, else robot)."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """File for mesh (none: mesh.ply) or trajectory (none: printed)."""
    replace: bool = False
    """For save: a map of this name may be there already."""
    timeout_s: float | None = None
    """Wait so long for the answer, s (none: by the request, 5 to 60)."""
    json: bool = False
    """For status: print it as JSON."""

    def __post_init__(self) -> None:
        if self.connect and not re.fullmatch(_ENDPOINT, self.connect):
            raise UserError(f"--connect {self.connect}: expected an endpoint, as tcp/10.0.0.7:7447")
        if not re.fullmatch(r"[A-Za-z0-9_-]*", self.robot):
            raise UserError(f"--robot {self.robot!r}: expected letters, digits, - and _")
        if self.timeout_s is not None and not (
            math.isfinite(self.timeout_s) and self.timeout_s > 0
        ):
            raise UserError(f"--timeout-s {self.timeout_s}: expected seconds above 0")
        if self.connect and self.run:
            raise UserError(f"--run {self.run}: expected without --connect")
        if self.security and not self.connect:
            raise UserError(f"--security {self.security}: expected with --connect tls/HOST:PORT")

    def expect_request(self) -> None:
        """UserError where the request is none, or has not what it needs."""
        names = [request.name for request in REQUESTS]
        if self.request not in names:
            what = f"{self.request}: unknown request" if self.request else "nothing asked"
            raise UserError(
                f"{what}: expected {' | '.join(names)}{did_you_mean(self.request, names)}"
            )
        what = {"save": "NAME", "set-mode": "|".join(_MODES)}.get(self.request, "")
        if bool(what) != bool(self.name):
            wrong = f"{self.request} {self.name}".strip()
            raise UserError(f"{wrong}: expected {self.request} {what or 'alone'}")
        if self.request == "save":
            expect_map_name(self.name)
        if self.request == "set-mode" and self.name not in _MODES:
            expected = f"expected {' or '.join(_MODES)}{did_you_mean(self.name, _MODES)}"
            raise UserError(f"set-mode {self.name}: {expected}")
        if self.out is not None and self.request not in ("mesh", "trajectory"):
            raise UserError(f"--out {self.out}: expected with mesh or trajectory only")
        if self.out is not None and not self.out.absolute().parent.is_dir():
            raise UserError(f"--out {self.out}: expected a file in a folder that is there")
