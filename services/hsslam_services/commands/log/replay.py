"""`hsslam-replay`: publishes the bus layer of a log on a zenoh router."""

import contextlib
import math
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import zenoh
from rich.console import Console
from rich.table import Table

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_proto import messages
from hsslam_proto.frame_codec import restamped
from hsslam_proto.frame_order import new_publisher, replayed_publisher
from hsslam_proto.topics import FRAME, POSE, TOPICS, Topic
from hsslam_services.bus.bus import Bus, open_router
from hsslam_services.commands.cli import exit_code, parse_options
from hsslam_services.commands.log.progress import log_progress
from hsslam_services.commands.log.replay_step import StepByStep
from hsslam_services.log.reading.arrival_order import LATEST_NS
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.reader import Logged, bus_messages

_PROG = "hsslam-replay"
_LONGEST_SLEEP_S = 0.2
_LONGEST_WAIT_S = 10.0  # of the log's time; its clock may have been set
_ALL = ("in/**", "out/**")
_INPUT = ("in/**",)
_SUPERVISOR = "supervisor"


@dataclass(frozen=True)
class ReplayOptions:
    """Publishes a log again: the same payloads on the same zenoh keys, in the order of the log.

    Examples:
      hsslam-replay run.mcap --rate 2
      hsslam-replay run.mcap --step --connect tcp/127.0.0.1:7447

    Without --connect the command is the zenoh router that viewers and tools connect to. With --connect it
    feeds a service (hsslam-serve --source zenoh:) with the frames, which carry the time of the replay. With
    --step it sends one frame at a time and waits until the service has processed it, so that a lossless log
    and --pace lockstep give the same poses each time.

    Exit codes: 0 if the log is replayed, 1 if the command is interrupted, 2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("log",)
    VALUES: ClassVar = {
        "log": "FILE",
        "only": "KEY...",
        "connect": "ENDPOINT",
        "robot": "NAME",
        "security": "FOLDER",
        "bind": "ADDRESS",
    }

    log: str = ""
    """The log, or a run folder (all parts of the log)."""
    rate: float = 1.0
    """Speed as a multiple of the recording's."""
    step: bool = False
    """Publish each frame after the service has tracked (in lockstep also mapped) the frame before."""
    only: tuple[str, ...] = ()
    """Publish only keys below hsslam/ROBOT/, such as in/** (none: all but sys/**, with --connect in/**)."""
    connect: str = ""
    """Router of the service to feed, as tcp/HOST:PORT (empty: open a router)."""
    robot: str = ""
    """Robot in the keys (empty: that of the log)."""
    security: str = ""
    """Folder of your certificate from hsslam-certs, for --connect tls/HOST:PORT."""
    zenoh_port: int = 7447
    """TCP port of the router, without --connect."""
    bind: str = "127.0.0.1"
    """Address of the router, without --connect."""
    delay: float = 2.0
    """Wait before the first message so that others can connect, s."""

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
            raise UserError("--rate: expected without --step, which waits for the service")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; exit code 0, 1 or 2, see `ReplayOptions`."""
    return exit_code(lambda: _replay(sys.argv[1:] if args is None else args))


def _replay(args: Sequence[str]) -> None:
    options = parse_options(ReplayOptions, _PROG, args)
    if not options.log:
        raise UserError(f"no log: expected FILE; see {_PROG} --help")
    names = wanted_names(options.only or (_INPUT if options.connect else _ALL))
    if options.connect:
        _expect_input(options.only, names)
    files = log_parts(user_path(options.log), _echo)
    of_log = next((logged.robot for logged in bus_messages(files, names)), None)
    if of_log is None:
        raise UserError(f"{options.log}: no messages: expected some on {', '.join(sorted(names))}")
    robot = options.robot or of_log
    with contextlib.ExitStack() as stack:
        endpoint = options.connect
        if not endpoint:
            endpoint = f"tcp/{options.bind}:{options.zenoh_port}"
            stack.callback(open_router(endpoint).close)
            _echo(f"router at {endpoint}, keys hsslam/{robot}/...")
        bus = stack.enter_context(Bus(endpoint, robot, "replay", options.security))
        if options.connect:
            _expect_robot(bus, endpoint)
        frames = bus.publisher(FRAME)
        if not options.step:
            time.sleep(options.delay)
            if options.connect and FRAME.name in names and not frames.has_subscribers():
                _echo(f"no run takes frames at {endpoint}: expected hsslam-serve --source zenoh:")
        progress = stack.enter_context(log_progress("replayed", files))
        logged = progress.over(bus_messages(files, names))
        if options.step:
            sent = StepByStep(bus, _echo).replay(logged)
        else:
            is_input = bool(options.connect) or POSE.name not in names
            sent = publish(bus, logged, options.rate, restamp=is_input)
    _show(sent)


def _expect_input(patterns: Sequence[str], names: Iterable[str]) -> None:
    """Raise UserError unless all topics are inputs: the service publishes the others itself."""
    refused = sorted(name for name in names if not name.startswith("in/"))
    if refused:
        given = f"--only {' '.join(patterns)}: {refused[0]}"
        raise UserError(f"{given} comes from the service: expected in/** with --connect")


def _expect_robot(bus: Bus, endpoint: str) -> None:
    """Raise UserError if only services of other robots run there; with none, one may still start."""
    found = bus.live_robots(_SUPERVISOR)
    if found and bus.robot not in found:
        known = ", ".join(found)
        text = f"no service of this robot at {endpoint}: expected {known}"
        raise UserError(f"--robot {bus.robot}: {text}")


def publish(bus: Bus, logged: Iterable[Logged], rate: float, restamp: bool = False) -> Counter[str]:
    """Publish each message at its time, `rate` times as fast as it was logged; returns counts by topic.

    Payloads are those of the log, byte for byte; `restamp`: frames carry the time of the replay.
    It waits at most 10 s of the log's time for a message, and not at all if the clock was set back. A message
    that the recorder wrote late, after newer ones of other topics, is sent at once.
    """
    publishers = {}
    newest_ns: dict[Topic, int] = {}
    sent: Counter[str] = Counter()
    due_s, last_ns = time.monotonic(), None
    own = new_publisher()
    for message in logged:
        gap_s = 0.0 if last_ns is None else (message.log_ns - last_ns) / 1e9
        is_late = gap_s < -1e-9 * LATEST_NS and message.log_ns >= newest_ns.get(
            message.topic, math.inf
        )
        newest_ns[message.topic] = message.log_ns
        if is_late:
            gap_s = 0.0
        else:
            last_ns = message.log_ns
        if not -1e-9 * LATEST_NS <= gap_s <= _LONGEST_WAIT_S:
            wait_s = min(max(gap_s, 0.0), _LONGEST_WAIT_S)
            _echo(
                f"a gap of {gap_s:.1f} s before a message on {message.topic.name}: "
                f"the replay waits {wait_s:g} s"
            )
            gap_s = wait_s
        due_s += gap_s / rate
        while (wait_s := due_s - time.monotonic()) > 0:
            time.sleep(min(wait_s, _LONGEST_SLEEP_S))
        if message.topic not in publishers:
            publishers[message.topic] = bus.publisher(message.topic)
        frame = message.message() if restamp and message.topic is FRAME else None
        if isinstance(frame, messages.Frame):
            publishers[FRAME].put(restamped(frame, replayed_publisher(frame.publisher, own)))
        else:
            publishers[message.topic].put_payload(message.payload, message.publish_ns)
        sent[message.topic.name] += 1
    return sent


def wanted_names(patterns: Sequence[str]) -> set[str]:
    """Names of the topics that intersect one of the zenoh key expressions.

    Raises:
        UserError: a pattern is no key expression, or matches no topic.
    """
    names: set[str] = set()
    for pattern in patterns:
        try:
            expression = zenoh.KeyExpr(pattern)
        except zenoh.ZError:
            raise UserError(f"--only {pattern}: expected keys such as in/** or out/pose") from None
        found = {t.name for t in TOPICS if expression.intersects(zenoh.KeyExpr(t.name))}
        if not found:
            known = ", ".join(topic.name for topic in TOPICS)
            raise UserError(f"--only {pattern}: no such topic: expected some of {known}")
        names |= found
    return names


def _show(sent: Counter[str]) -> None:
    table = Table("topic")
    table.add_column("messages", justify="right")
    for name, count in sorted(sent.items()):
        table.add_row(name, str(count))
    Console(emoji=False, highlight=False, markup=False).print(table)


def _echo(text: str) -> None:
    print(text, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
