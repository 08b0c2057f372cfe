"""Faults by other users and clients: forged heartbeats, foreign folders, a subscriber that stops."""

import contextlib
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.faults.strange_frames import NO_SHARED_MEMORY
from hsslam_bench.runs.live_run import SMALL_ROOM, LiveRun
from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_proto.run_messages import Health
from hsslam_services.bus.bus import Bus

_FORGED_S, _WATCH_S = 6.0, 6.0
_MOST_MORE_MS = 50.0
_HUNG_MS = 10**7
_OTHER_USER_ID = 65534  # Linux gives no files to this user
_SUBSCRIBER = """
import sys, time
from hsslam_proto.topics import TOPICS
from hsslam_services.bus.bus import Bus
bus = Bus(sys.argv[1], "robot", "slow")
subscriptions = [bus.subscribe(topic, 64) for topic in TOPICS]
print("ready", flush=True)
while True:
    time.sleep(1)
"""


def heartbeats_are_forged(experiment: Experiment) -> Finding:
    """A client forges heartbeats of a tracker that hangs; expect that the tracker lives."""
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(30)
    pid = run.pid_of("tracker")
    if pid is None:
        raise CouldNotTellError("the tracker is not running")
    sent = 0
    with (
        contextlib.suppress(UserError),  # the service refuses the connection
        Bus(run.endpoint, "robot", "stranger", settings=NO_SHARED_MEMORY) as bus,
    ):
        publisher = bus.publisher(topics.HEALTH)
        deadline = time.monotonic() + _FORGED_S
        while time.monotonic() < deadline and run.pid_of("tracker") == pid:
            publisher.put(
                Health(process="tracker", pid=pid, state="running", rss_bytes=1, idle_ms=_HUNG_MS)
            )
            sent += 1
            time.sleep(0.02)
    if sent == 0:
        raise CouldNotTellError("no forged heartbeat was sent: the client cannot connect")
    lives = run.pid_of("tracker") == pid
    return Finding(not lives, f"{sent} forged heartbeats sent; the tracker lives: {lives}")


def foreign_folders_in_shared_memory(experiment: Experiment) -> Finding:
    """Links and folders of another user in /dev/shm; expect that the run neither follows nor removes them."""
    victim = experiment.folder / "victim"
    (victim / "kept").mkdir(parents=True)
    (victim / "owner.lock").touch()
    root, pid = Path("/dev/shm"), os.getpid()
    link, folder = root / f"hsslam-link-{pid}", root / f"hsslam-foreign-{pid}"
    try:
        link.symlink_to(victim)
        folder.mkdir()
        (folder / "owner.lock").symlink_to(victim / "kept")
        with contextlib.suppress(PermissionError):  # only root can give it away
            os.chown(folder, _OTHER_USER_ID, _OTHER_USER_ID)
        run = experiment.serve(*SMALL_ROOM, "--frames", "30")
        code = run.finish()
        is_whole = (victim / "kept").is_dir() and (victim / "owner.lock").exists()
        is_there = link.is_symlink() and folder.is_dir()
    finally:
        link.unlink(missing_ok=True)
        shutil.rmtree(folder, ignore_errors=True)
    return Finding(
        code != 0 or not is_whole or not is_there,
        f"exit code {code}; files behind the link whole: {is_whole}; link and folder left alone: "
        f"{is_there}",
    )


def subscriber_does_not_read(experiment: Experiment) -> Finding:
    """Stop a client of all topics (SIGSTOP); expect no pose more than 50 ms later than before."""
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(60)
    before_ms = _latencies_ms(run, _WATCH_S)
    slow = experiment.start(sys.executable, "-P", "-c", _SUBSCRIBER, run.endpoint, stdout=-1)
    assert slow.stdout is not None
    if b"ready" not in slow.stdout.readline():
        raise CouldNotTellError("the client of all topics has ended: it cannot subscribe")
    slow.send_signal(signal.SIGSTOP)
    during_ms = _latencies_ms(run, 2 * _WATCH_S)
    if slow.poll() is not None:
        raise CouldNotTellError(f"the client of all topics has ended with code {slow.returncode}")
    slow.kill()
    if not len(before_ms):
        raise CouldNotTellError("no poses without the subscriber")
    worst_before = float(before_ms.max())
    worst = float(during_ms.max()) if len(during_ms) else float("inf")
    return Finding(
        worst > worst_before + _MOST_MORE_MS,
        f"longest latency of a pose {worst_before:.0f} ms before and {worst:.0f} ms while a client of all "
        f"topics stands still ({len(before_ms)} and {len(during_ms)} poses)",
    )


def _latencies_ms(run: LiveRun, seconds: float) -> np.ndarray:
    """Latencies [N] of the poses of the next seconds, from sensor stamp to arrival."""
    run.new_poses()
    return np.array(run.latencies_ms(seconds))
