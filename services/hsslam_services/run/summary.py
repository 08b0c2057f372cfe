"""summary.json: figures of a run. Only the supervisor writes it."""

import importlib.metadata
import platform
import subprocess
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hsslam_node.durable_file import write_durably
from hsslam_services.governor.known_latencies import KnownLatencies
from hsslam_services.run.process_result import python_number

SUMMARY_FILE, _DAMAGED_FILE = "summary.json", "summary.damaged.json"
_LOST, _DEAD_RECKONED = 2, 3  # status in the pose log
_PACKAGES = ("hsslam-node", "torch", "numpy", "numba", "opencv-python-headless", "eclipse-zenoh")


def update_summary(
    run_dir: Path, section: Mapping[str, Any], replaced: Collection[str] = ()
) -> None:
    """Merge a section into the file; nested mappings are merged key by key, but those named in `replaced`.

    A file that is damaged, as by an editor or a full disk, is kept as summary.damaged.json.
    """
    known = _read(run_dir / SUMMARY_FILE)
    if known is None:
        (run_dir / SUMMARY_FILE).replace(run_dir / _DAMAGED_FILE)
    kept = {key: value for key, value in (known or {}).items() if key not in replaced}
    merged = _merged(kept, section)
    encoded = msgspec.json.encode(merged, enc_hook=python_number)
    write_durably(run_dir / SUMMARY_FILE, msgspec.json.format(encoded))


def read_summary(run_dir: Path) -> dict[str, Any]:
    """The summary so far; empty if there is none, or if it is damaged."""
    return _read(run_dir / SUMMARY_FILE) or {}


def pose_section(slabs: Iterable[np.ndarray]) -> dict[str, Any]:
    """Section of frame counts, rate, latency, and duration by the source's stamps, from slabs [n] of POSE_ROW
    of the pose log.

    Rate and latency leave out the first pose: the sensor clock starts when its map exists. The rate is
    missing if the wall clock was set back during the run. Latencies are those of status and metrics, without
    steps of a clock.
    """
    section: dict[str, Any] = {}
    counts = np.zeros(4, np.int64)  # of each status
    source_ns: list[int] = []  # the least and the largest of each slab
    edges_ns: list[int] = []  # when the first and the last of each slab were published
    known = KnownLatencies()
    latencies_ms: list[np.ndarray] = []
    is_set_back = False
    for rows in filter(len, slabs):
        counts += np.bincount(rows["status"], minlength=len(counts))
        source_ns += [int(rows["source_stamp_ns"].min()), int(rows["source_stamp_ns"].max())]
        is_first = "first_pose_ns" not in section
        after = rows[1:] if is_first else rows
        section.setdefault("first_pose_ns", int(rows["publish_ns"][0]))
        publish_ns = after["publish_ns"]
        edges_ns += publish_ns[:1].tolist() + publish_ns[-1:].tolist()
        is_set_back |= bool((np.diff(publish_ns) < 0).any())
        latencies_ms.append(_latencies_ms(rows, known)[is_first:])
    frames, lost = int(counts.sum()), int(counts[_LOST])
    section["frames"] = {"tracked": frames - lost, "lost": lost}
    if dead_reckoned := int(counts[_DEAD_RECKONED]):  # of those tracked
        section["frames"]["dead_reckoned"] = dead_reckoned
    if source_ns:
        section["sensor_s"] = (max(source_ns) - min(source_ns)) / 1e9
    if frames > 2:
        if not is_set_back and np.diff(edges_ns).min() >= 0:
            section["wall_fps"] = (frames - 2) / max((edges_ns[-1] - edges_ns[0]) / 1e9, 1e-9)
        known_ms = np.concatenate(latencies_ms)
        known_ms = known_ms[np.isfinite(known_ms)]
        if len(known_ms):
            p50, p95, p99 = np.percentile(known_ms, (50, 95, 99))
            section["latency_ms"] = {"p50": float(p50), "p95": float(p95), "p99": float(p99)}
    return section


def _latencies_ms(rows: np.ndarray, known: KnownLatencies) -> np.ndarray:
    """Of the next rows [n] of POSE_ROW, [n]; nan: a clock was set."""
    columns = ("stamp_ns", "publish_ns", "publish_monotonic_ns")
    found = [
        known.of(stamp_ns, publish_ns, 1e-9 * at_ns)
        for stamp_ns, publish_ns, at_ns in zip(*(rows[c].tolist() for c in columns), strict=True)
    ]
    return np.array([np.nan if ms is None else ms for ms in found])


def _read(path: Path) -> dict[str, Any] | None:
    """The JSON object in a file; empty if there is no such file, None if it has anything else."""
    if not path.exists():
        return {}
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except msgspec.MsgspecError:
        return None


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(old)
    for key, value in new.items():
        is_nested = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if is_nested else value
    return merged


def evaluation_line(found: Mapping[str, Any], frames: Mapping[str, int]) -> str:
    """ATE of each trajectory in cm and, if the true mesh is known, distance in cm and completion in %.

    Args:
        found: result of `evaluate_run`; unknown values are None.
        frames: how many were tracked and lost; lost ones have no pose, so the ATE leaves them out.
    """
    ates_m = {name: ate.get("rmse_m") for name, ate in found.get("ate", {}).items()}
    known = [f"{name} {1e2 * ate_m:.2f} cm" for name, ate_m in ates_m.items() if ate_m is not None]
    lost = frames.get("lost", 0)
    of = f" of the {frames['tracked']} tracked frames ({lost} lost)" if lost else ""
    line = f"ATE{of}: {', '.join(known)}" if known else "ATE: no poses to compare"
    mesh = found.get("mesh", {})
    off_m, complete = mesh.get("accuracy_mean_m"), mesh.get("completion_ratio_5cm")
    if off_m is not None and complete is not None:
        line += f"; mesh: {1e2 * off_m:.2f} cm off, {1e2 * complete:.1f} % complete within 5 cm"
    return line


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that may change a result."""
    return {
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in _PACKAGES},
    }


def source_commit() -> str:
    """Commit of the source tree, with + if it has changes; empty outside of a checkout."""
    return commit_of(Path(__file__))


def names_code(commit: str) -> bool:
    """Whether a commit, as `source_commit` gives it, names the code: not with changed files (a trailing +),
    which may have changed again, and not outside of a checkout ("")."""
    return bool(commit) and not commit.endswith("+")


def commit_of(file: Path) -> str:
    """Commit of the repository that tracks `file`, with + if it has changes; empty if none tracks it."""
    try:
        _git(file.parent, "ls-files", "--error-unmatch", file.name)
        commit = _git(file.parent, "rev-parse", "--short=12", "HEAD")
        changed = _git(file.parent, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return ""
    return commit + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
