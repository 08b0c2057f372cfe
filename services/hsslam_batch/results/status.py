"""`hsslam-batch status`: counts logs done, failed and left; in a file of its own, as it needs no table."""

import sys
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
    for log in logs:
        outcome = rows.get(log.id)
        if outcome is not None and not outcome.is_done:
            print(f"{outcome.failure} (attempt {outcome.attempt})", file=sys.stderr)
    tally = Tally(logs, rows.values())
    frames = sum(outcome.frames for outcome in rows.values() if outcome.is_done)
    states = f"{tally.done} done, {tally.failed} failed, {tally.left} left"
    print(f"{len(logs)} logs: {states}; {frames_of(frames, tally.frames)}")
    return _LEFT if tally.left else _FAILED if tally.failed else 0
