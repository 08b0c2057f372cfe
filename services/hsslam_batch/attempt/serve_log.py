"""One attempt at one log: fetch it if it is in a store, run it in its own folder, judge and commit it."""

import contextlib
import dataclasses
import platform
import secrets
import select
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from hsslam_batch.attempt.claim import held_claim, remove_ended
from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.attempt.fetch import REFUSED, fetched_place
from hsslam_batch.attempt.judgement import (
    judged,
    judged_frames,
    judged_with_kills,
    kind_of_error,
    last_words,
    selected_frames,
    summary_of,
)
from hsslam_batch.attempt.local_log import expect_unchanged
from hsslam_batch.attempt.outcome import NOT_EVALUATED, Outcome, figures, may_try_again
from hsslam_batch.attempt.room import SmallDiskError, room_for
from hsslam_batch.attempt.watched_process import End, Limits, watch
from hsslam_batch.plan.batch import FETCHED, Batch, UnavailableError
from hsslam_batch.plan.find_logs import on_this_machine
from hsslam_batch.plan.folder_size import folder_nbytes
from hsslam_batch.plan.listing import ClosedError
from hsslam_batch.plan.log import Log
from hsslam_batch.plan.remote_listing import is_url
from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import remove_arena
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.run_info import RunInfo

_NOT_RUN = End(code=2, why="", wall_s=0.0, core_s=0.0, memory_mb=0)
_UNAVAILABLE = dataclasses.replace(_NOT_RUN, code=1)
_LOOK_S = 5.0  # for room
_NOT_FETCHED = 1
_FETCH_CODES = {
    _NOT_FETCHED: "the log could not be fetched",
    REFUSED: "the store does not give the log",
}


class CancelledError(Exception):
    """A signal or a closed stdin ended the attempt; it leaves no result."""


@dataclass(frozen=True)
class Terms:
    """The settings of an attempt. `scratch`: folder for fetched logs (None: below the batch).

    `retries`: most attempts after the first; they resume a fetch that failed. `limits`: fetch and run share
    the time.
    """

    attempt: int = 1
    retries: int = 0
    limits: Limits = dataclasses.field(default_factory=Limits)
    scratch: Path | None = None
    fetch_gb: float = 100.0


@dataclass(frozen=True)
class Place:
    """The folders of an attempt while it runs."""

    folder: Path
    fetched: Path  # where the log is fetched to

    @property
    def run_dir(self) -> Path:
        return self.folder / "run"

    @property
    def output(self) -> Path:
        """What the command printed."""
        return self.folder / "output.txt"


def place_of(batch: Batch, log: Log, terms: Terms) -> Place:
    """The folders of an attempt, which has its folder for itself: two may run at once, as if a job is queued
    again. All attempts at a log fetch into one folder, which no other batch uses."""
    fetched = (terms.scratch or batch.work) / f"{batch.key}.{log.id}{FETCHED}"
    return Place(batch.work / f"{log.id}.{terms.attempt}.{secrets.token_hex(4)}", fetched)


def serve_log(
    batch: Batch,
    log: Log,
    terms: Terms,
    cancel_fds: Sequence[int] = (),
    on_frames: Callable[[int], None] = lambda frames: None,
) -> Outcome:
    """Run a log and commit the outcome; `on_frames` gets the number of frames that are done.

    First removes what killed attempts have left on this machine, except what was fetched of this log.

    Raises:
        CancelledError: one of `cancel_fds` became readable before the end.
        OSError: the folder of the batch cannot be written.
    """
    place = place_of(batch, log, terms)
    for folder in {*batch.works(), place.fetched.parent}:
        remove_ended(folder, but=place.fetched)
    with held_claim(place.folder):
        try:
            with contextlib.ExitStack() as at_end:
                started_ns = time.time_ns()
                outcome = _attempt(batch, log, terms, place, cancel_fds, on_frames, at_end)
                outcome = msgspec.structs.replace(outcome, started_ns=started_ns)
            if outcome.is_done:
                commit(batch, outcome, place.run_dir)
            else:
                settle_failed(batch, outcome)
            return outcome
        finally:
            shutil.rmtree(place.folder, ignore_errors=True)


def _attempt(
    batch: Batch,
    log: Log,
    terms: Terms,
    place: Place,
    cancel_fds: Sequence[int],
    on_frames: Callable[[int], None],
    at_end: contextlib.ExitStack,
) -> Outcome:
    """Fetch and run the log; `at_end` gets the callbacks that remove temporary files."""
    here, fetch_s = log, 0.0
    if is_url(log.place):
        too_large = log.nbytes > 1e9 * terms.fetch_gb  # the fetch refuses it
        nbytes = 0 if too_large else log.nbytes + log.beside_nbytes
        try:
            room = at_end.enter_context(room_for(nbytes, place.fetched, lambda: _pause(cancel_fds)))
        except OSError as error:
            reason = f"{error.filename}: {error.strerror}: expected a folder with room (--scratch)"
            kind = "crash" if isinstance(error, SmallDiskError) else "unavailable"
            return _outcome(batch, log, terms, _UNAVAILABLE, kind=kind, reason=reason)
        command = fetch_command(batch, log, place.fetched, terms.fetch_gb)
        room.is_kept = terms.attempt <= terms.retries  # if it is cancelled
        end = _watched(command, place, terms.limits, cancel_fds)
        fetch_s = end.wall_s
        kind, reason = judged(end, terms.limits, last_words(place.output), _FETCH_CODES)
        if kind == "crash" and end.code == _NOT_FETCHED:
            kind = "unavailable"
        kind, reason = judged_with_kills(kind, reason, end, place.output)
        if kind != "done":
            outcome = _outcome(batch, log, terms, end, kind=kind, reason=reason, fetch_s=fetch_s)
            room.is_kept = may_try_again(outcome, terms.retries)
            return outcome
        room.is_kept = False
        here = on_this_machine(log, str(fetched_place(place.fetched, log)))
    else:
        try:
            is_here = expect_unchanged(log, batch.out)
        except UnavailableError as error:
            reason = str(error)
            return _outcome(batch, log, terms, _UNAVAILABLE, kind="unavailable", reason=reason)
        except UserError as error:  # on another node this user may be allowed to read it
            kind = "crash" if isinstance(error, ClosedError) else "bad input"
            return _outcome(batch, log, terms, _NOT_RUN, kind=kind, reason=str(error))
        if not is_here:  # it may be on other nodes
            reason = f"{log.place}: not on {platform.node()}: expected the logs there on each node"
            return _outcome(batch, log, terms, _NOT_RUN, kind="crash", reason=reason)
    run_dir = place.run_dir
    at_end.callback(_remove_arena, run_dir)
    command = serve_command(batch, here, run_dir)
    limits = terms.limits.after(fetch_s)
    end = _watched(command, place, limits, cancel_fds, lambda: on_frames(_frames_so_far(run_dir)))
    kind, reason = judged(end, terms.limits, last_words(place.output))
    summary = summary_of(run_dir)
    if kind == "done":
        try:
            expected = selected_frames(summary, batch, here.source)
        except UserError as error:
            kind = kind_of_error(str(error))
            reason = f"the log cannot be read after the run: {error}"
        else:
            kind, reason = judged_frames(summary, expected)
            if kind == "done" and (why := summary.get("not_evaluated")):
                reason = f"{NOT_EVALUATED}{why}"
    kind, reason = judged_with_kills(kind, reason, end, place.output)
    found = figures(summary) | {"nbytes": folder_nbytes(run_dir)}
    return _outcome(batch, log, terms, end, kind=kind, reason=reason, fetch_s=fetch_s, **found)


def serve_command(batch: Batch, log: Log, run_dir: Path) -> list[str]:
    """The command line that runs a log of this machine."""
    serve = [sys.executable, "-P", "-m", "hsslam_services.commands.serve"]
    return [*serve, "--config", str(batch.config), "--source", log.source, "--out", str(run_dir)]


def fetch_command(batch: Batch, log: Log, folder: Path, most_gb: float) -> list[str]:
    """The command line that fetches a log into a folder of this machine."""
    fetch = [sys.executable, "-P", "-m", "hsslam_batch.attempt.fetch"]
    words = (batch.out, log.index, folder, most_gb, batch.patience_s)
    return [*fetch, *map(str, words)]


def _watched(
    command: Sequence[str],
    place: Place,
    limits: Limits,
    cancel_fds: Sequence[int],
    look: Callable[[], None] = lambda: None,
) -> End:
    end = watch(command, place.output, limits, cancel_fds, look)
    if end.why == "cancelled":
        raise CancelledError
    return end


def _pause(cancel_fds: Sequence[int]) -> None:
    if select.select(cancel_fds, [], [], _LOOK_S)[0]:
        raise CancelledError


def _outcome(batch: Batch, log: Log, terms: Terms, end: End, **found) -> Outcome:
    return Outcome(
        id=log.id,
        name=log.name,
        configuration=batch.about.configuration,
        attempt=terms.attempt,
        retries=terms.retries,
        exit_code=end.code,
        node=platform.node(),
        code=batch.about.code,
        wall_s=end.wall_s,
        core_s=end.core_s,
        memory_mb=end.memory_mb,
        **found,
    )


def _frames_so_far(run_dir: Path) -> int:
    """Number of frames that the camera has sent; in lockstep the other workers are at most one behind."""
    with contextlib.suppress(OSError, UserError):
        return CameraProgress.read(Path(RunInfo.read(run_dir).arena_dir)).sent
    return 0


def _remove_arena(run_dir: Path) -> None:
    """Remove the shared memory of a run that has crashed."""
    with contextlib.suppress(UserError):
        if arena := RunInfo.read(run_dir).arena_dir:
            remove_arena(Path(arena))
