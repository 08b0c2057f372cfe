"""The options of `hsslam-ctl`: one frozen dataclass, one field an option."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, get_args

from hsslam_node.errors import UserError, did_you_mean
from hsslam_proto.request_messages import Mode
from hsslam_proto.requests import REQUESTS
from hsslam_services.commands.output_files import default_mesh_file, expect_file
from hsslam_services.run.maps_folder import expect_map_name

_MODES: tuple[str, ...] = get_args(Mode)
_ARGUMENTS = {"save": "NAME", "set-mode": "|".join(_MODES), "query": "X Y Z", "locate": "X Y YAW"}
_NUMBERS = {
    "query": "query X Y Z in metres, at most 1000000",
    "locate": "locate X Y YAW in metres and degrees, at most 1000000 and 10000",
}
_LARGEST = {"query": (1e6, 1e6, 1e6), "locate": (1e6, 1e6, 1e4)}
_ENDPOINT = r"(tcp|tls|quic|udp|ws)/\S+:\d{1,5}"


@dataclass(frozen=True)
class CtlOptions:
    """Controls a running service.

    Requests:
      status                             frames, rate, latency, tracking, processes
      mesh                               the newest mesh as a PLY file (m, world frame)
      trajectory                         refined poses in TUM format (s, m, unit quaternion; camera to world)
      query X Y Z                        distance, gradient, certainty at a point (m, world frame of the map)
      locate X Y YAW                     relocalise near a pose on the floor of the map (m, degrees)
      save NAME                          save the map in the maps folder of the service
      pause, resume                      stop and restart the camera
      set-mode mapping|localise-only     change the map, or only track the camera in it
      reset                              discard the map; the next frame starts a new one, in a new frame
      stop                               end the run and save everything

    Examples:
      hsslam-ctl status
      hsslam-ctl mesh --out room.ply
      hsslam-ctl query 0.5 -0.2 2
      hsslam-ctl locate 1.5 -0.3 90
      hsslam-ctl stop --connect tcp/10.0.0.7:7447 --robot r2
      hsslam-ctl pause --connect tls/10.0.0.7:7447 --security certs/operator

    Without --connect and --run the command finds the run on this machine.

    Exit codes: 0 if the request is done, 1 if there is no service, it refused or it did not answer in time,
    2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("request", "arguments")
    VALUES: ClassVar = {
        "request": "REQUEST",
        "arguments": "[ARGUMENT...]",
        "connect": "ENDPOINT",
        "security": "FOLDER",
        "run": "FOLDER",
        "robot": "NAME",
    }
    ALIASES: ClassVar = {"out": "-o"}
    WORDS: ClassVar = {"request": tuple(request.name for request in REQUESTS), "arguments": _MODES}

    request: str = ""
    """One of the requests above."""
    arguments: tuple[str, ...] = ()
    """Name of a map for save (letters, digits, _ and -), mode for set-mode, numbers for query and locate."""
    connect: str = ""
    """Router of the service, as tcp/10.0.0.7:7447 (empty: the run on this machine)."""
    security: str = ""
    """Folder of your certificate from hsslam-certs, for --connect tls/HOST:PORT."""
    run: Path | None = None
    """Run folder, if several runs are active on this machine."""
    robot: str = ""
    """Name of the robot in the zenoh keys (empty: that of the run, else robot)."""
    out: Path | None = None
    """Output file of mesh (none: mesh.ply) or trajectory (none: printed)."""
    replace: bool = False
    """For save: overwrite a map of the same name."""
    timeout_s: float | None = None
    """Longest wait for the answer, s (none: 5, 15 or 60, by request; query asks again for up to 120 s)."""
    json: bool = False
    """Print the answer as JSON; not for mesh and trajectory."""

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

    @property
    def name(self) -> str:
        """Name of the map, or the mode."""
        return self.arguments[0]

    def numbers(self) -> tuple[float, ...]:
        """X Y Z of a query, m, or X Y YAW of locate, m and degrees; UserError if they are too large."""
        try:
            found = tuple(map(float, self.arguments))
        except ValueError:
            found = (math.nan,)
        largest = _LARGEST[self.request]
        if not all(abs(number) <= most for number, most in zip(found, largest, strict=False)):
            given = " ".join([self.request, *self.arguments])
            raise UserError(f"{given}: expected {_NUMBERS[self.request]}")
        return found

    def expect_request(self) -> None:
        """Raise UserError if the request is unknown, or its arguments are missing or wrong."""
        names = [request.name for request in REQUESTS]
        if self.request not in names:
            what = f"{self.request}: unknown request" if self.request else "no request"
            raise UserError(
                f"{what}: expected {' | '.join(names)}{did_you_mean(self.request, names)}"
            )
        what = _ARGUMENTS.get(self.request, "")
        if len(self.arguments) != len(what.split()):
            wrong = " ".join([self.request, *self.arguments])
            raise UserError(f"{wrong}: expected {self.request} {what or 'alone'}")
        if self.request == "save":
            expect_map_name(self.name)
        if self.request == "set-mode" and self.name not in _MODES:
            expected = f"expected {' or '.join(_MODES)}{did_you_mean(self.name, _MODES)}"
            raise UserError(f"set-mode {self.name}: {expected}")
        if self.request in _NUMBERS:
            self.numbers()
        has_file = self.request in ("mesh", "trajectory")
        if self.out is not None and not has_file:
            raise UserError(f"--out {self.out}: expected with mesh or trajectory only")
        if self.json and has_file:
            raise UserError(f"--json: expected without {self.request}, whose answer is a file")
        if self.out is None and self.request == "mesh":
            default_mesh_file()
        if self.out is not None and self.request == "mesh" and self.out.suffix != ".ply":
            raise UserError(f"--out {self.out}: expected a file .ply, the format of mesh")
        if self.out is not None:
            expect_file("--out", self.out)
