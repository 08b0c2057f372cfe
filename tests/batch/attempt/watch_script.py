"""Watches a command and prints how it ended; a program of its own, as it becomes parent of all orphans.

python watch_script.py OUTPUT TIMEOUT_S MEMORY_GB COMMAND...; 0: no limit. Standard input closed: cancelled.
"""

import sys
from pathlib import Path

from hsslam_batch.attempt.watched_process import Limits, watch

if __name__ == "__main__":
    output, timeout_s, memory_gb, *command = sys.argv[1:]
    limits = Limits(float(timeout_s) or None, float(memory_gb) or None)
    print("watching", flush=True)
    end = watch(command, Path(output), limits, [sys.stdin.fileno()])
    print(end.why or "ended", end.code, end.memory_mb, flush=True)
