"""Which signals a process handles, as its kernel sees it; tests of the service and of batches share it."""

from pathlib import Path


def catches(pid: int, number: int) -> bool:
    """Whether the process has a handler of this signal."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)
