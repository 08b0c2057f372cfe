"""Figures of a real-time run: frames tracked, latency, accuracy, mapping iterations."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hsslam_bench.checks.accuracy import ate_m, scored
from hsslam_bench.checks.check import Measured
from hsslam_bench.runs.serve_run import ServeRun
from hsslam_bench.runs.viewers import LOOKED_SHARE, looked_share

_LIGHT_POINTS = 640 * 12  # of one light iteration


def tracked(run: ServeRun, least: float) -> Measured:
    """Share of the frames after the first with a pose; a slow source or an idle viewer fails the row."""
    frames = run.summary["frames"]
    after_first = max(frames["in"] - 1, 1)
    share = (frames["tracked"] - 1) / after_first
    shifts = run.summary["processes"]["camera"]["counters"].get("clock_shifts", 0)
    notes = [f"{frames['tracked'] - 1} of {after_first}, {frames['lost']} lost"]
    if skipped := frames.get("skipped", 0):
        notes.append(f"{skipped} left out by a slow source")
    looked = _looked_share(run)
    if run.viewer_bytes is not None:
        notes.append(f"viewer took {run.viewer_bytes / 1e6:.1f} MB in {looked:.0%} of the seconds")
    slow = f"; the source was too slow: clock moved {shifts} x" if shifts else ""
    return Measured(
        f"{share:.1%} ({', '.join(notes)}){slow}",
        share >= least and shifts == 0 and looked >= LOOKED_SHARE,
        {
            "share": share,
            **frames,
            "clock_shifts": shifts,
            "viewer_bytes": run.viewer_bytes,
            "viewer_seconds_share": looked,
        },
        share,
        "higher",
    )


def _looked_share(run: ServeRun) -> float:
    """Share of the seconds with poses in which the viewer received data; 1 without a viewer."""
    window = run.log.tracking_ns
    if run.viewer_bytes is None or window is None:
        return float(run.viewer_bytes is None)
    return looked_share(run.outside["viewer_seconds"], *window)


def latency(run: ServeRun, percentile: str, bound_ms: float) -> Measured:
    """Time from sensor stamp to published pose, without the first; `percentile` ("p99") has the bound."""
    found = run.summary.get("latency_ms")
    if not found:
        return Measured("no pose after the first", False)
    text = " / ".join(f"{found[p]:.0f}" for p in ("p50", "p95", "p99"))
    ms = found[percentile]
    return Measured(f"p50 / p95 / p99: {text} ms", ms <= bound_ms, found, ms, "lower")


def accuracy(run: ServeRun, lockstep: ServeRun, factor: float, margin_m: float = 0.0) -> Measured:
    """ATE of a real-time run against that of the lockstep run."""
    ours_m, lockstep_m = ate_m(run), ate_m(lockstep)
    bound_m = factor * lockstep_m + margin_m
    n, expected = scored(run)
    return Measured(
        f"{100 * ours_m:.2f} cm, {n}/{expected} scored; "
        f"lockstep {100 * lockstep_m:.2f}: bound {100 * bound_m:.2f} cm",
        ours_m <= bound_m,
        {"rmse_m": ours_m, "lockstep_rmse_m": lockstep_m, "scored": [n, expected]},
        ours_m,
        "lower",
    )


def messages_expected(summary: Mapping[str, Any]) -> dict[str, int]:
    """Number of messages of a complete log, from the summary; a frame that was sent twice counts twice."""
    frames, camera = summary["frames"], summary["processes"]["camera"]["counters"]
    return {
        "in/frame": frames["in"] - frames.get("skipped", 0) + camera.get("resent", 0),
        "out/pose": frames["tracked"] + frames["lost"],
    }


def iterations(run: ServeRun, least_hz: float) -> Measured:
    """Mapping iterations a second, from the first pose on the map to the last pose."""
    window = run.log.tracking_ns
    if window is None or len(run.log.mapped) < 2:
        return Measured("no iterations in the log", False)
    times, counts = np.array(run.log.mapped, float).T
    begin, end = np.interp(np.array(window, float), times, counts)
    rate_hz = float(end - begin) / ((window[1] - window[0]) / 1e9)
    slam = run.summary["options"]["slam"]
    rays = slam["mapper"]["rays"]
    samples = slam["sampling"]["free_samples"] + slam["sampling"]["surface_samples"]
    light_hz = rate_hz * rays * samples / _LIGHT_POINTS
    return Measured(
        f"{rate_hz:.1f} a second of {rays} x {samples} points: as many points as {light_hz:.1f} of "
        "640 x 12",
        light_hz >= least_hz,
        {"iterations_hz": rate_hz, "light_hz": light_hz},
        light_hz,
        "higher",
    )
