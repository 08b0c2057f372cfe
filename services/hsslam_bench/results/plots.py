"""Plots of result files: core time by process, latency, growth."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hsslam_bench.results.report import Report
from hsslam_bench.runs.run_log import LoggedPose
from hsslam_bench.runs.usage import Sample, core_ms_per_frame
from hsslam_node.errors import UserError

_LIVE = ("viewer-", "sixty-", "realtime-")  # name prefixes of the runs in stages.png, latency.png
_COLD = "-cold"
_FRAMES, _ROOMS = "growth-", "m"
_WINDOW_FRAMES = 150  # the time of a frame is the mean over these
_BUDGET_MS = {30: 66.7, 60: 33.3}  # of two cores
_P99_BOUND_MS = 66.0
_MIB = 2**20
_DPI = 110
_COLORS = {  # one for each process in all pictures
    "tracker": "#d62728",
    "camera": "#ff7f0e",
    "mapper": "#1f77b4",
    "global_ba": "#17becf",
    "mesher": "#2ca02c",
    "recorder": "#9467bd",
    "viewer": "#e377c2",
    "supervisor": "#7f7f7f",
    "fork_server": "#bcbd22",
}
_OTHER_COLOR = "#c7c7c7"


def draw(reports: Sequence[Report], folder: Path) -> list[Path]:
    """Write those of stages.png, latency.png and growth.png for which there are runs; returns the files.

    Raises:
        UserError: the results have no run to draw, or the folder is not writable.
    """
    matplotlib.use("Agg")
    runs = {run["name"]: run for found in reports for run in found.runs}
    live = {name: r for name, r in runs.items() if name.startswith(_LIVE) and _COLD not in name}
    growing = {name: run for name, run in runs.items() if name.startswith(_FRAMES)}
    pictures: list[tuple[str, Mapping[str, Any], Callable[[Mapping[str, Any]], Figure]]] = [
        ("stages", {n: r for n, r in live.items() if r.get("core_ms")}, _stages),
        ("latency", {n: r for n, r in live.items() if _poses(r)}, _latency),
        ("growth", {n: r for n, r in growing.items() if _samples(r)}, _growth),
    ]
    if not any(chosen for _, chosen, _ in pictures):
        raise UserError("plots: no run with core times or poses in these files: expected some")
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, chosen, picture in pictures:
            if chosen:
                written.append(folder / f"{name}.png")
                picture(chosen).savefig(written[-1], dpi=_DPI)
    except OSError as error:
        raise UserError(f"--to {folder}: {error.strerror}: expected a folder to write") from None
    return written


def _stages(runs: Mapping[str, Any]) -> Figure:
    """Stacked bars: core time of each process, ms a frame."""
    figure = Figure((8.5, 1.4 + 0.55 * len(runs)), layout="constrained")
    axes = figure.subplots()
    names = list(runs)
    left = np.zeros(len(names))
    for process in _processes(run["core_ms"] for run in runs.values()):
        widths = np.array([run["core_ms"].get(process, 0.0) for run in runs.values()])
        color = _COLORS.get(process, _OTHER_COLOR)
        axes.barh(names, widths, left=left, label=process, color=color)
        left += widths
    rates = sorted({60 if name.startswith("sixty") else 30 for name in names})
    for rate_hz, style in zip(rates, ("--", ":"), strict=False):
        label = f"two cores at {rate_hz} Hz"
        axes.axvline(_BUDGET_MS[rate_hz], color="black", linestyle=style, label=label)
    axes.invert_yaxis()
    axes.set_xlabel("core time, ms a frame")
    figure.legend(loc="outside upper center", ncols=5, fontsize=8)
    return figure


def _latency(runs: Mapping[str, Any]) -> Figure:
    """Share of the poses that were published within each latency (ms) after the sensor's stamp."""
    figure = Figure((8.5, 4.0), layout="constrained")
    axes = figure.subplots()
    longest = _P99_BOUND_MS
    for name, run in runs.items():
        latencies = np.sort([pose.latency_ms for pose in _poses(run)[1:]])
        share = np.arange(1, len(latencies) + 1) / len(latencies)
        axes.step(latencies, 100 * share, where="post", label=name)
        longest = max(longest, float(np.quantile(latencies, 0.995)))
    axes.axvline(_P99_BOUND_MS, color="black", linestyle="--", label=f"{_P99_BOUND_MS:g} ms")
    axes.axhline(99, color="grey", linewidth=0.8, linestyle=":")
    axes.set(xlabel="sensor stamp to published pose, ms", ylabel="share of the poses, %")
    axes.set(xlim=(0, 1.05 * longest), ylim=(0, 101))
    axes.legend(fontsize=8)
    return figure


def _growth(runs: Mapping[str, Any]) -> Figure:
    """Core time and memory along the longest run; disk against frames, and room sizes, of all runs."""
    by_frames = {n: r for n, r in runs.items() if not n.endswith(_ROOMS)}
    by_room = {n: r for n, r in runs.items() if n.endswith(_ROOMS)}
    figure = Figure((10, 7), layout="constrained")
    (time, memory), (disk, rooms) = figure.subplots(2, 2)
    if by_frames:
        longest = max(by_frames.values(), key=lambda run: len(_poses(run)))
        _draw_core_time(time, longest)
        _draw_memory(memory, longest)
        _draw_disk(disk, by_frames)
    if by_room:
        _draw_rooms(rooms, by_room)
    return figure


def _draw_core_time(axes: Axes, run: Mapping[str, Any]) -> None:
    samples = _samples(run)
    poses = [pose for pose in _poses(run) if pose.status == "tracked"]
    step = max(min(_WINDOW_FRAMES, len(poses) // 4), 1)
    ends = poses[::step]
    middles = [(a.index + b.index) / 2 for a, b in itertools.pairwise(ends)]
    used = [
        core_ms_per_frame(samples, (a.publish_ns, b.publish_ns), b.index - a.index)
        for a, b in itertools.pairwise(ends)
    ]
    names = _processes(used)
    rows = [[ms.get(name, 0.0) for ms in used] for name in names]
    colors = [_COLORS.get(name, _OTHER_COLOR) for name in names]
    if used:
        axes.stackplot(middles, rows, labels=names, colors=colors)
    axes.set(xlabel="frame", ylabel="core time, ms a frame", title=run["name"])
    axes.set_ylim(0, 1.35 * max((sum(ms.values()) for ms in used), default=1.0))
    axes.legend(fontsize=7, ncols=4, loc="upper center")


def _draw_memory(axes: Axes, run: Mapping[str, Any]) -> None:
    poses = _poses(run)
    while_tracking = (poses[0].publish_ns, poses[-1].publish_ns) if poses else (0, 0)
    looks = [sample for sample in _samples(run) if sample.pss_bytes]
    samples = [s for s in looks if while_tracking[0] <= s.time_ns <= while_tracking[1]]
    if not samples:
        return
    at = np.interp(
        [sample.time_ns for sample in samples],
        [pose.publish_ns for pose in poses],
        [pose.index for pose in poses],
    )
    names = _processes(sample.pss_bytes for sample in samples)
    rows = [[sample.pss_bytes.get(name, 0) / _MIB for sample in samples] for name in names]
    colors = [_COLORS.get(name, _OTHER_COLOR) for name in names]
    axes.stackplot(at, rows, labels=names, colors=colors)
    axes.set(xlabel="frame", ylabel="memory (PSS), MiB", title=run["name"])
    axes.legend(fontsize=7, ncols=3, loc="lower right")


def _draw_disk(axes: Axes, runs: Mapping[str, Any]) -> None:
    ordered = sorted(runs.values(), key=lambda run: run["summary"]["frames"]["in"])
    frames = [run["summary"]["frames"]["in"] for run in ordered]
    for file in ("run.mcap", "run.rrd", "map.safetensors", "mesh.ply"):
        sizes = [run["disk_bytes"].get(file, 0) / _MIB for run in ordered]
        axes.plot(frames, sizes, marker="o", label=file)
    shared = [max((s.shared_bytes for s in _samples(run)), default=0) / _MIB for run in ordered]
    axes.plot(frames, shared, marker="s", linestyle="--", label="/dev/shm")
    axes.set(xlabel="frames", ylabel="MiB", title="disk and shared memory")
    axes.legend(fontsize=7)


def _draw_rooms(axes: Axes, runs: Mapping[str, Any]) -> None:
    ordered = sorted(runs.values(), key=_room_m)
    sides = [f"{_room_m(run):g} m" for run in ordered]
    bottom = np.zeros(len(ordered))
    for name in _processes(run["core_ms"] for run in ordered):
        heights = np.array([run["core_ms"].get(name, 0.0) for run in ordered])
        axes.bar(sides, heights, bottom=bottom, color=_COLORS.get(name, _OTHER_COLOR))
        bottom += heights
    axes.set(xlabel="side of the room", ylabel="core time, ms a frame", title="size of the room")


def _room_m(run: Mapping[str, Any]) -> float:
    return float(run["name"].removeprefix(_FRAMES).removesuffix(_ROOMS))


def _processes(each: Any) -> list[str]:
    """Names in the order of the legend; those without a colour of their own come last."""
    found = {name: None for names in each for name in names}
    return [n for n in _COLORS if n in found] + [n for n in found if n not in _COLORS]


def _poses(run: Mapping[str, Any]) -> list[LoggedPose]:
    return [LoggedPose(*fields) for fields in run.get("log", {}).get("poses", ())]


def _samples(run: Mapping[str, Any]) -> list[Sample]:
    return msgspec.convert(run.get("usage", []), list[Sample])
