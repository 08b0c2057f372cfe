"""Runs the tests that failed in the last run again, by themselves; alone because only `make test` uses it."""

import json
import subprocess
import sys
from pathlib import Path

from tests.repository import ROOT


def run_again(folder: Path) -> int:
    """Returns pytest's exit code; 1 if no test failed, or something that is no test."""
    names = folder / ".pytest_cache/v/cache/lastfailed"
    # sorted: pytest finds no fixtures of a folder to which it comes back
    failed = sorted(json.loads(names.read_text())) if names.exists() else []
    if not failed or not all("::" in name for name in failed):
        print("no test to run again: the run itself failed", file=sys.stderr)
        return 1
    command = (sys.executable, "-m", "pytest", "--verbose", "--verbose", "--maxfail", "1", *failed)
    return subprocess.run(command, cwd=folder, check=False).returncode


if __name__ == "__main__":
    sys.exit(run_again(ROOT))
