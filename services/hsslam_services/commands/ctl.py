"""`hsslam-ctl`: controls a running service, on this machine or another."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import tum_text
from hsslam_proto import requests as rpc
from hsslam_proto.mesh.codec import mesh_arrays
from hsslam_proto.mesh.messages import Mesh
from hsslam_proto.message import Message
from hsslam_proto.point_codec import answers_of, question_message
from hsslam_proto.request_messages import (
    Ask,
    Done,
    Locate,
    Located,
    PointAnswers,
    SavedMap,
    SaveMap,
    SetMode,
    Status,
    TrajectoryRows,
)
from hsslam_services.bus.ask import (
    NoAnswerError,
    NoServiceError,
    NotDoneError,
    UnfinishedError,
    ask,
)
from hsslam_services.commands.cli import exit_code, parse_options
from hsslam_services.commands.ctl_options import CtlOptions
from hsslam_services.commands.output_files import default_mesh_file, print_written
from hsslam_services.commands.point_table import print_answers
from hsslam_services.governor.levels import LEVELS
from hsslam_services.requests.mesh_and_trajectory import trajectory_of
from hsslam_services.run.find_run import running_runs
from hsslam_services.run.run_info import RunInfo
from hsslam_services.security.access import WORKER_LINK

_PROG = "hsslam-ctl"
_DEFAULT_ROBOT = "robot"
_LONGEST_S = 120.0  # in which an unfinished request is sent again


def print_status(status: Status) -> None:
    """Print the status as a table."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in _rows(status):
        table.add_row(name, value)
    Console(emoji=False, highlight=False, markup=False).print(table)


def _rows(status: Status) -> list[tuple[str, str]]:
    resets = f", reset {status.map_epoch} x" if status.map_epoch else ""
    processes = "  ".join(f"{name}:{state}" for name, state in status.processes.items())
    restarts = ", ".join(f"{name} {count} x" for name, count in status.restarts.items())
    return [
        ("state", f"{status.state}, {status.mode}"),
        ("run", f"{status.run_id}, {status.source}, preset {status.preset}, pace {status.pace}"),
        ("time", f"{status.seconds:.0f} s"),
        (
            "frames",
            f"{status.frames_sent} sent, {status.frames_tracked} tracked, "
            f"{status.frames_lost} lost, {status.frames_dropped} dropped",
        ),
        ("rate", f"{status.fps:.1f} FPS, {status.latency_ms:.0f} ms from sensor to pose"),
        ("tracking", f"{status.tracking}, quality {status.quality:.2f}"),
        (
            "map",
            f"version {status.map_version}, {status.keyframes} keyframes, "
            f"{status.ba_rounds} rounds of bundle adjustment{resets}",
        ),
        (
            "load",
            f"level {status.load_level}: {LEVELS[min(status.load_level, len(LEVELS) - 1)].in_words}",
        ),
        ("memory", f"{status.memory_mb} MB"),
        ("requests", f"{status.requests}, {status.requests_refused} refused"),
        ("messages", f"{status.messages_rejected} rejected"),
        ("processes", processes),
        ("restarts", restarts or "none"),
    ]


def main(args: Sequence[str] | None = None) -> None:
    """Run the command; exit code 0, 1 or 2, see `CtlOptions`."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _asked(given)):
        sys.exit(code)


def _asked(args: Sequence[str]) -> int:
    try:
        _ask(_options(args))
    except NotDoneError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _options(args: Sequence[str]) -> CtlOptions:
    options = parse_options(CtlOptions, _PROG, args)
    options.expect_request()
    return options


def _ask(options: CtlOptions) -> None:
    endpoint, robot = _whom(options)
    request = next(request for request in rpc.REQUESTS if request.name == options.request)
    message: Message = Ask()
    if request is rpc.SAVE:
        message = SaveMap(name=options.name, replace=options.replace)
    if request is rpc.QUERY:
        message = question_message(np.array([options.numbers()]))
    if request is rpc.LOCATE:
        x, y, yaw_deg = options.numbers()
        message = Locate(x=x, y=y, yaw_deg=yaw_deg)
    if request is rpc.SET_MODE:
        message = msgspec.convert({"mode": options.name}, SetMode)
    _show(_answer(endpoint, robot, request, message, options), options)


def _answer(
    endpoint: str, robot: str, request: rpc.Request, message: Message, options: CtlOptions
) -> Message:
    """Send the request, and send it again while the service reports it unfinished.

    A query changes nothing, so it is also sent again after a timeout.
    """
    end_s = time.monotonic() + (options.timeout_s or _LONGEST_S)
    while True:
        try:
            return ask(
                endpoint, robot, request, message, options.timeout_s, security=options.security
            )
        except (UnfinishedError, NoAnswerError) as error:
            waited = isinstance(error, NoAnswerError)
            if waited and (request is not rpc.QUERY or options.timeout_s is not None):
                raise
            if time.monotonic() > end_s:
                raise
            print(error, file=sys.stderr, flush=True)


def _whom(options: CtlOptions) -> tuple[str, str]:
    """Endpoint and robot of the service that the options select."""
    if options.connect:
        return options.connect, options.robot or _DEFAULT_ROBOT
    if options.run is not None:
        run = RunInfo.read(options.run)
        if run.endpoint.startswith(WORKER_LINK) and not Path(run.arena_dir).exists():
            raise NoServiceError(f"no service: the run of {options.run} has ended")
        return run.endpoint, options.robot or run.robot
    runs = {
        place: run
        for place, run in running_runs().items()
        if run is None or options.robot in ("", run.robot)
    }
    if not runs:
        of_robot = f" of robot {options.robot!r}" if options.robot else ""
        raise NoServiceError(f"no service: no run{of_robot} on this machine; see --connect")
    if len(runs) > 1:
        found = ", ".join(f"--run {place}" for place in runs)
        raise UserError(f"{len(runs)} runs on this machine: expected one of {found}")
    ((place, run),) = runs.items()
    if run is None:
        raise NoServiceError(
            f"no service: the run of {place} is starting, or is of another version"
        )
    return run.endpoint, run.robot


def _show(answer: Message, options: CtlOptions) -> None:
    match answer:
        case Status() | Located() | SavedMap() | Done() if options.json:
            print(msgspec.json.format(msgspec.json.encode(answer)).decode())
        case Status():
            print_status(answer)
        case Mesh():
            _write_mesh(answer, options.out or default_mesh_file())
        case TrajectoryRows():
            text = tum_text(trajectory_of(answer))
            if options.out is None:
                print(text, end="")
            else:
                _write(options.out, text.encode())
                print_written(options.out, f"{answer.count} poses")
        case PointAnswers():
            print_answers(np.array([options.numbers()]), answers_of(answer), as_json=options.json)
        case Located():
            print(
                f"found at {answer.x:.2f} {answer.y:.2f} {answer.yaw_deg:.0f}, up by {answer.up_by}"
            )
        case SavedMap():
            size_mb = answer.nbytes / 2**20
            print(f"{answer.path}: {answer.keyframes} keyframes, {size_mb:.1f} MiB")
        case Done():
            print(answer.text)


def _write_mesh(mesh: Mesh, path: Path) -> None:
    import trimesh

    vertices, faces, colors = mesh_arrays(mesh)
    triangles = trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
    data = triangles.export(file_type="ply")
    assert isinstance(data, bytes)
    _write(path, data)
    print_written(path, f"{mesh.face_count} triangles of map version {mesh.map_version}")


def _write(path: Path, data: bytes) -> None:
    try:
        write_durably(path, data)
    except OSError as error:
        raise UserError(f"--out {path}: {error.strerror}: expected a file to write") from None


if __name__ == "__main__":
    main()
