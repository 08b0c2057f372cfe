"""Clears the folder of running attempts; alone because an attempt of an earlier run may still live."""

import contextlib
import secrets
import shutil

from hsslam_batch.attempt.claim import LOCK
from hsslam_batch.plan.batch import FETCHED, Batch

_TOKEN_BYTES = 4


def clear_work(batch: Batch, *, but_fetched: bool = False) -> None:
    """Remove what attempts have left, as those of a run that was killed; `but_fetched`: except downloaded
    parts of logs, from which the next attempts continue, and the file that attempts lock.

    Each folder first gets another name: an attempt that still lives finds its run folder whole or not at all,
    and does not take a part of it for its result. What cannot be removed stays.
    """
    removed = batch.work / f".removed.{secrets.token_hex(_TOKEN_BYTES)}"
    with contextlib.suppress(OSError):
        kept = (FETCHED, LOCK) if but_fetched else ()
        found = [p for p in batch.work.iterdir() if not p.name.endswith(kept)]
        removed.mkdir()
        for path in found:
            with contextlib.suppress(OSError):
                path.rename(removed / path.name)
        shutil.rmtree(removed, ignore_errors=True)
        batch.work.rmdir()
