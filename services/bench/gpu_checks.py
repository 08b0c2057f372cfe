"""Speed and accuracy on an NVIDIA GPU; where there is none, the reason stands in the table."""

import json
import subprocess
import sys
from pathlib import Path

from hsslam_node.device.choose_device import choose_device
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import NotMeasured, Session

_FPS = {"paper": 20.0, "realtime": 60.0}
_FRAMES = 200
_TESTS = "tests/gpu_kernels"


def gpu_checks() -> list[Check]:
    """The bounds of the GPU path."""
    tested = "every GPU kernel against the float64 reference, random inputs, relative"
    return [
        *(_speed_check(preset, fps) for preset, fps in _FPS.items()),
        Check("gpu:kernels", tested, "1e-4", _kernels),
    ]


def _speed_check(preset: str, least: float) -> Check:
    def measure(session: Session) -> Measured:
        _expect_cuda()
        arguments = ("--device", "cuda", preset, session.source("room"), str(_FRAMES))
        found = json.loads(session.python(f"{__package__}.preset_speed", *arguments))
        error = "no" if found["rmse_m"] is None else f"{100 * found['rmse_m']:.2f} cm"
        return Measured(
            f"{found['fps']:.1f} frames a second, {error} ATE, {found['lost']} lost; "
            f"{found['device']}",
            found["fps"] >= least,
            found,
            found["fps"],
            "higher",
        )

    what = f"room 640x480, {_FRAMES} frames, one process, device cuda, preset {preset}"
    return Check(f"gpu:{preset}", f"{what}: speed", f"{least:g} frames a second", measure)


def _kernels(session: Session) -> Measured:
    """The kernels' own tests, which take CUDA where it works."""
    _expect_cuda()
    root = Path(__file__).parents[2]
    if not (root / _TESTS).is_dir():
        raise NotMeasured(f"no {_TESTS} beside the package")
    session.say(_TESTS)
    command = [sys.executable, "-m", "pytest", "-q", _TESTS]
    result = subprocess.run(command, cwd=root, capture_output=True, text=True)
    lines = result.stdout.strip().splitlines()
    return Measured(lines[-1] if lines else "no test ran", result.returncode == 0)


def _expect_cuda() -> None:
    """Raises `NotMeasured` with the reason where CUDA does not work."""
    device = choose_device("auto")
    if device.kind != "cuda":
        raise NotMeasured(device.reason)
