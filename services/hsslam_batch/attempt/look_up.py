"""Reads the row of a log from a store, in a process of its own: fsspec runs a thread, a watcher must not.

python -m hsslam_batch.attempt.look_up OUT INDEX PATIENCE_S
"""

import subprocess
import sys

import msgspec

from hsslam_batch.attempt.commit import settled
from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.plan.batch import Batch, UnavailableError
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import mirrored_batch, read_batch
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import exit_code

_BAD_INPUT, _UNAVAILABLE = 2, 3


def main() -> int:
    """Copy the plan to this machine and print the row of a log, or null; exit code 3 if the store fails."""
    out, index, patience_s = sys.argv[1:]
    return exit_code(lambda: _look_up(out, int(index), float(patience_s)), hears_signals=False)


def look_up(out: str, index: int, patience_s: float) -> tuple[Batch, Outcome | None]:
    """The batch of a URL, with its plan on this machine, and the row of a log (None: no row or no such log).

    `patience_s`: how long to wait for a store that fails.

    Raises:
        UserError: the URL has no batch.
        UnavailableError: the store fails, or the process that asks it is killed.
    """
    command = [sys.executable, "-P", "-m", "hsslam_batch.attempt.look_up"]
    command += [out, str(index), str(patience_s)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode:
        words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        refusal = UserError if done.returncode == _BAD_INPUT else UnavailableError
        raise refusal(words[-1].removeprefix("error: "))
    return mirrored_batch(out, patience_s), msgspec.json.decode(done.stdout, type=Outcome | None)


def _look_up(out: str, index: int, patience_s: float) -> int:
    try:
        batch = read_batch(out, patience_s)
        logs = read_manifest(batch.out)[index : index + 1]
        with batch.expect_writable():
            found = [settled(batch, log.id) for log in logs]
    except UnavailableError as error:
        print(f"error: {error}", file=sys.stderr)
        return _UNAVAILABLE
    print(msgspec.json.encode(found[0] if found else None).decode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
