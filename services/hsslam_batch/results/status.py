"""`hsslam-batch status`: counts logs done, failed and left; in a file of its own, as it needs no table."""

import sys
from collections import Counter
from collections.abc import Sequence

from hsslam_batch.attempt.commit import all_settled
from hsslam_batch.options import StatusOptions
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.tally import Tally, frames_of
from hsslam_services.commands.cli import parse_options

_LEFT, _FAILED = 1, 3


def status_command(args: Sequence[str]) -> int:
    """Print the counts on stdout and a line for each failed log on stderr.

    Raises:
        UserError: the folder has no batch.
    """
    options = parse_options(StatusOptions, "hsslam-batch status", args)
    batch = read_batch(options.out)
    logs = read_manifest(batch.out)
    found = all_settled(batch, logs)
    rows = {log_id: outcome for log_id, outcome in found.items() if not outcome.is_left}
    counts: Counter[str] = Counter()
    frames = 0
    for log in logs:
        outcome = rows.get(log.id)
        state = "left" if outcome is None else "done" if outcome.is_done else "failed"
        counts[state] += 1
        if outcome is not None and outcome.is_done:
            frames += outcome.frames
        elif outcome is not None:
            words = f"{log.name}: {outcome.kind}: {outcome.reason}"
            print(f"{words} (attempt {outcome.attempt})", file=sys.stderr)
    states = ", ".join(f"{counts[state]} {state}" for state in ("done", "failed", "left"))
    print(f"{len(logs)} logs: {states}; {frames_of(frames, Tally(logs, rows.values()).frames)}")
    return _LEFT if counts["left"] else _FAILED if counts["failed"] else 0
