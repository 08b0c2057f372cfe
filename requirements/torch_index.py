"""PyTorch's own index, apart because installer and locks both need it: the hashes of its CPU wheels."""

import re
from urllib.parse import unquote

CPU_INDEX = "https://download.pytorch.org/whl/cpu"
PYTHONS = ("311", "312", "313", "314")
MACHINES = ("x86_64", "aarch64")
_LINK = re.compile(r'href="[^"]*/([^"/#]+\.whl)#sha256=([0-9a-f]{64})"')


def cpu_wheels(page: str, version: str) -> list[str]:
    """The SHA-256 of torch's CPU wheels, sorted, for each Python and machine that we install on.

    Raises ValueError if the page, the index's HTML, lacks one.
    """
    found = {unquote(name): digest for name, digest in _LINK.findall(page)}
    names = [
        f"torch-{version}+cpu-cp{python}-cp{python}-manylinux_2_28_{machine}.whl"
        for python in PYTHONS
        for machine in MACHINES
    ]
    missing = [name for name in names if name not in found]
    if missing:
        raise ValueError(f"it lacks {', '.join(missing)}")
    return sorted(found[name] for name in names)
