"""Runs Python code in a process under a real quota of core time."""

import subprocess
import sys

import pytest

from hsslam_bench.runs.cpu_quota import NoQuotaError, cpu_quota


def printed_under_quota(code: str, cores: float) -> str:
    """What `code` prints in a process with one core and a quota of `cores`; it starts after the quota is set.

    Skips the test if this machine allows no control group.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", f"input()\n{code}"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        with cpu_quota(process.pid, cores, 1):
            printed, _ = process.communicate("\n", timeout=60)
    except NoQuotaError as error:
        pytest.skip(str(error))
    finally:
        process.kill()
        process.wait()
    return printed
