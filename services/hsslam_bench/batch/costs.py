"""Measures the costs of sequences in a batch, one at a time; prints JSON.

`python -m hsslam_bench.batch.costs SOURCE...` runs `hsslam-batch` on the folders of these sources, in one
slot and with defaults otherwise.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hsslam_batch.results.costs import costs
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.planned import batch_command, plan
from hsslam_bench.runs.sequences import QUICK_FRAMES


def main() -> None:
    parser = argparse.ArgumentParser(prog="batch.costs", description=__doc__)
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_FRAMES} frames of each")
    arguments = parser.parse_args()
    places = [Path(source.partition(":")[2]) for source in arguments.sources]
    options = ("--frames", str(QUICK_FRAMES)) if arguments.quick else ()
    with tempfile.TemporaryDirectory() as folder:
        found = [costs_of(place, Path(folder) / place.name, *options) for place in places]
    print(json.dumps(dict(zip((place.name for place in places), found, strict=True))))


def costs_of(log: Path, out: Path, *options: str) -> dict[str, Any]:
    """Time, memory and disk that one log takes; `options`: of hsslam-serve."""
    batch = plan(log, out, *options)
    command = batch_command("run", str(out), "--parallel", "1", "--memory", "4")
    subprocess.run(command, check=True, stdout=sys.stderr)
    rows = read_runs(batch.out)
    (cost,) = costs(rows)
    return {
        "frames": cost.frames,
        "seconds of log": cost.log_s,
        "core s a minute": cost.core_s_a_minute,
        "s a minute": cost.wall_s_a_minute,
        "core ms a frame": cost.core_ms_a_frame,
        "peak memory, MB": rows[0]["memory_mb"],
        "results, MB": rows[0]["nbytes"] / 1e6,
    }


if __name__ == "__main__":
    main()
