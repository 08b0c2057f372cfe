"""Rows of speed: kernels against PyTorch, a mapping iteration, tracking stages, an NVIDIA GPU."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.session import NotMeasured, Session
from hsslam_node.device.choose_device import choose_device
from hsslam_node.presets import PRESETS

BATCHES = {"light": (640, 12), "86k": (2000, 43)}  # rays, samples a ray
CHANNELS = (16, 32)
_BOUNDS = {"86k": 30.0}  # times as fast
_US_PER_POINT, _LIGHT_MS = 1.6, 15.0
_FPS = {"paper": 20.0, "realtime": 60.0}
_FRAMES = 200
_GPU_TESTS = (
    "tests/node/gpu_kernels",
    "tests/node/device",
    "tests/node/mapping/gpu",
    "tests/node/meshing/test_gpu_map_queries.py",
    "tests/node/tracking/test_gpu_rendering_objective.py",
    "tests/node/tracking/alignment/test_gpu_sdf_term.py",
)


def kernel_checks() -> list[Check]:
    """One check for each batch and width, two iterations, and two for the stages of tracking."""
    speeds = [_kernel_speed_check(batch, channels) for batch in BATCHES for channels in CHANNELS]
    tracking = [_tracking_check("tracking", "none"), _tracking_check("tracking:kinect", "kinect")]
    return [*_iteration_checks(), *speeds, *tracking]


def _iteration_checks() -> list[Check]:
    of = "one mapping iteration, forward + losses + backward + Adam, one thread"
    rays, sampling = PRESETS["realtime"].mapper.rays, PRESETS["realtime"].sampling
    free, surface = sampling.free_samples, sampling.surface_samples
    return [
        Check(
            "iteration:24k:32",
            f"{of}: 1500 x (5 + 11) points, 32 channels",
            f"{_US_PER_POINT:g} us a point",
            lambda session: _iteration(session, (1500, 5, 11, 32), us_per_point=_US_PER_POINT),
        ),
        Check(
            "iteration:light",
            f"{of}: 640 x (4 + 8) points, 16 channels",
            f"{_LIGHT_MS:g} ms",
            lambda session: _iteration(session, (640, 4, 8, 16), median_ms=_LIGHT_MS),
        ),
        Check(
            "iteration:realtime",
            f"{of}: {rays} x ({free} + {surface}) points, 16 channels",
            "",
            lambda session: _iteration(session, (rays, free, surface, 16), median_ms=None),
        ),
    ]


def _iteration(session: Session, batch: Sequence[int], **bound: float | None) -> Measured:
    """Time of an iteration; `bound`: name of the figure in the result, and its limit (None: no bound)."""
    found = session.figures("hsslam_bench.scripts.iteration_speed", *map(str, batch))
    ((name, limit),) = bound.items()
    return Measured(
        f"{found['median_ms']:.1f} ms, {found['us_per_point']:.2f} us a point "
        f"(least {found['least_ms']:.1f} ms)",
        None if limit is None else found[name] <= limit,
        found,
        found[name],
        "lower",
    )


def _kernel_speed_check(batch: str, channels: int) -> Check:
    rays, samples = BATCHES[batch]

    def measure(session: Session) -> Measured:
        arguments = (str(rays), str(samples), str(channels))
        found = session.figures("hsslam_bench.scripts.kernel_speed", *arguments)
        return Measured(
            f"{found['kernel_ms']:.1f} ms against {found['reference_ms']:.0f} ms: "
            f"{found['ratio']:.1f} x",
            None if bound is None else found["ratio"] >= bound,
            found,
            found["ratio"],
            "higher",
        )

    bound = _BOUNDS.get(batch)
    what = f"field forward + backward, {rays} x {samples} points, {channels} channels, one thread"
    return Check(
        name=f"kernels:{batch}:{channels}",
        what=f"{what}: kernel, PyTorch, ratio",
        bound="" if bound is None else f"{bound:g} x",
        measure=measure,
    )


def _tracking_check(name: str, noise: str) -> Check:
    def measure(session: Session) -> Measured:
        found = session.figures("hsslam_bench.scripts.tracking_stages", "--noise", noise)
        return Measured(", ".join(f"{stage} {ms:.2f}" for stage, ms in found.items()), None, found)

    depth = "exact depth" if noise == "none" else "Kinect noise"
    what = f"tracking of room 640x480, {depth}, one thread, alone: mean ms a frame"
    return Check(name, f"{what} (keyframe, reference, mapping iteration: a call)", "", measure)


def gpu_checks() -> list[Check]:
    """The rows of the GPU path."""
    tested = (
        "every GPU kernel against the float64 reference, random inputs, relative; "
        "its callers against the CPU"
    )
    return [
        *(_gpu_speed_check(preset, fps) for preset, fps in _FPS.items()),
        Check("gpu:kernels", tested, "1e-4", _gpu_tests),
    ]


def _gpu_speed_check(preset: str, least: float) -> Check:
    def measure(session: Session) -> Measured:
        _expect_cuda()
        arguments = ("--device", "cuda", preset, session.source("room"), str(_FRAMES))
        found = session.figures("hsslam_bench.scripts.preset_speed", *arguments)
        error = "no" if found["rmse_m"] is None else f"{100 * found['rmse_m']:.2f} cm"
        return Measured(
            f"{found['fps']:.1f} frames a second, {error} ATE, {found['lost']} lost; "
            f"{found['device']}",
            found["fps"] >= least and found["lost"] == 0,
            found,
            found["fps"],
            "higher",
        )

    what = f"room 640x480, {_FRAMES} frames, one process, device cuda, preset {preset}"
    bound = f"{least:g} frames a second"
    # 2: paper tracks with 12 steps a frame, in 1 with 8
    return Check(
        f"gpu:{preset}", f"{what}: speed", bound, measure, version=2 if preset == "paper" else 1
    )


def _gpu_tests(session: Session) -> Measured:
    """Run the tests of the code for GPUs, which use CUDA if it works."""
    _expect_cuda()
    root = Path(__file__).parents[3]
    if missing := [test for test in _GPU_TESTS if not (root / test).exists()]:
        raise NotMeasured(f"no {missing[0]} beside the package")
    session.say("tests of the code for GPUs")
    command = [sys.executable, "-m", "pytest", "--numprocesses", "auto", *_GPU_TESTS]
    result = subprocess.run(command, cwd=root, capture_output=True, text=True)
    lines = result.stdout.strip().splitlines()
    return Measured(lines[-1] if lines else "no test ran", result.returncode == 0)


def _expect_cuda() -> None:
    """Raise `NotMeasured` with the reason if CUDA does not work."""
    device = choose_device("auto")
    if device.kind != "cuda":
        raise NotMeasured(device.reason)
