import subprocess
import sys

import psutil
import pytest

from hsslam_bench.runs.cpu_quota import NoQuotaError, cpu_quota

_BUSY = """
import os, time
os.fork()
print(flush=True)
begin, spent = time.monotonic(), 0.0
while time.monotonic() - begin < 60:
    pass
"""


def test_a_process_and_its_children_get_their_share():
    process = subprocess.Popen(
        [sys.executable, "-c", f"input()\n{_BUSY}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        with cpu_quota(process.pid, 0.2, 2):
            process.stdin.write(b"\n")
            process.stdin.flush()
            process.stdout.readline()
            both = [psutil.Process(process.pid), *psutil.Process(process.pid).children()]
            before_s = sum(sum(p.cpu_times()[:2]) for p in both)
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(2.0)
            spent_s = sum(sum(p.cpu_times()[:2]) for p in both) - before_s
            for one in reversed(both):
                one.kill()
            process.wait()
    except NoQuotaError as error:
        pytest.skip(str(error))
    finally:
        process.kill()
        process.wait()
    assert spent_s < 0.2 * 2.0 + 0.3  # alone they would take up to two cores
