"""Makes a run of the benchmark as a task of Ray, in a process group of its own that ends with the worker.

`python -m hsslam_bench.batch.run_task NAME FOLDER OPTIONS...` makes a run and pickles it to stdout. If its
parent dies, it sends SIGINT to its process group.
"""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from hsslam_bench.runs.serve_run import RunFailedError, ServeRun, serve
from hsslam_services.launch.parent_death import die_with_parent


def main() -> None:
    signal.signal(signal.SIGTERM, lambda *_: os.killpg(0, signal.SIGINT))
    die_with_parent(signal.SIGTERM)
    name, folder, *options = sys.argv[1:]
    sys.stdout.buffer.write(pickle.dumps(serve(name, Path(folder), options)))


def run_task(name: str, folder: str, options: Sequence[str]) -> ServeRun:
    """Make a run on the machine of this worker; `folder` has the same path there.

    Raises:
        RunFailedError: there is no result.
    """
    command = [sys.executable, "-P", "-m", "hsslam_bench.batch.run_task", name, folder, *options]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, start_new_session=True
    )
    if done.returncode:
        words = done.stderr.decode(errors="replace").strip().splitlines()
        raise RunFailedError(f"{name} ended with code {done.returncode}: {words[-1:]}")
    return pickle.loads(done.stdout)


if __name__ == "__main__":
    main()
