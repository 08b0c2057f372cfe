"""Commands that are interrupted while they are imported."""

import subprocess
import sys

import pytest

_INTERRUPTED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
from hsslam_services.commands import start
class Import:  # catches what is raised in it, as that of a compiled module may do
    def find_spec(self, name, *_):
        if name == "hsslam_node":
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                pass
sys.meta_path.insert(0, Import())
sys.exit(getattr(start, sys.argv.pop(1))())
"""


@pytest.mark.parametrize("command", ["ctl", "evaluate", "log"])
def test_an_early_interruption_is_one_line(command):
    run = [sys.executable, "-c", _INTERRUPTED, command]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "interrupted\n")
