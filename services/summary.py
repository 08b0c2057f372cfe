"""summary.json: what a run did, in numbers. Saver, evaluator and supervisor each add their part."""

import importlib.metadata
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from hsslam_node.services.run_info import RunInfo, write_atomically

if TYPE_CHECKING:
    from hsslam_node.services.child import Child
    from hsslam_node.services.run_state import RunState

_FILE = "summary.json"
_RECORDER_FILE = "recorder.json"  # what the recorder says of its log
_LOST = 2  # status in the pose log
_PACKAGES = ("hsslam-node", "torch", "numpy", "numba", "opencv-python-headless", "eclipse-zenoh")


def update_summary(run_dir: Path, section: Mapping[str, Any]) -> None:
    """Merge a section into the file; nested mappings are merged key by key."""
    merged = _merged(read_summary(run_dir), section)
    encoded = msgspec.json.encode(merged, enc_hook=_plain)
    write_atomically(run_dir / _FILE, msgspec.json.format(encoded))


def read_summary(run_dir: Path) -> dict[str, Any]:
    """The summary so far; empty if there is none."""
    return _read_json(run_dir / _FILE)


def pose_section(rows: np.ndarray) -> dict[str, Any]:
    """Frames, rate and latency out of the pose log, [N] of POSE_ROW.

    Rate and latency leave out the first pose: the sensor clock starts when its map is there.
    """
    lost = int((rows["status"] == _LOST).sum())
    section: dict[str, Any] = {"frames": {"tracked": len(rows) - lost, "lost": lost}}
    after = rows[1:]
    if len(rows):
        section["first_pose_ns"] = int(rows["publish_ns"][0])
    if len(after) > 1:
        seconds = (after["publish_ns"][-1] - after["publish_ns"][0]) / 1e9
        latency_ms = (after["publish_ns"] - after["stamp_ns"]) / 1e6
        section["wall_fps"] = (len(after) - 1) / max(seconds, 1e-9)
        p50, p95, p99 = np.percentile(latency_ms, (50, 95, 99))
        section["latency_ms"] = {"p50": float(p50), "p95": float(p95), "p99": float(p99)}
    return section


def process_section(
    run: RunInfo, children: Mapping[str, "Child"], state: "RunState", stop_reason: str, end_ns: int
) -> dict[str, Any]:
    """What the supervisor knows: frames in, processes, stage times, configuration, versions."""
    end = state.source_end
    frames: dict[str, int] = {}
    if end is not None:
        known = read_summary(run.path).get("frames", {})  # from the pose log, by the saver
        answered = known.get("tracked", state.tracked) + known.get("lost", state.lost)
        frames = {"in": end.frame_count, "bad": end.bad_frame_count}
        frames["dropped"] = max(end.frame_count - answered, 0)
    return {
        "run_id": run.run_id,
        "source": run.options.source,
        "stop_reason": stop_reason,
        "seed": run.options.seed,
        "seconds": (end_ns - run.started_ns) / 1e9,
        "started_ns": run.started_ns,
        "frames": frames,
        "map": {
            "versions": state.map.version if state.map else 0,
            "iterations": state.map.iterations if state.map else 0,
        },
        "ba_rounds": state.ba_rounds,
        "log": _read_json(run.path / _RECORDER_FILE),
        "processes": {name: _process(child) for name, child in children.items()},
        "options": msgspec.to_builtins(run.options),
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _PACKAGES},
        },
    }


def _process(child: "Child") -> dict[str, Any]:
    health = child.health
    return {
        "state": child.state,
        "restarts": child.restarts,
        "peak_rss_bytes": child.peak_rss_bytes,
        "stage_ms": dict(health.stage_ms) if health else {},
        "counters": dict(health.counters) if health else {},
    }


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(type(value).__name__)


def _read_json(path: Path) -> dict[str, Any]:
    return msgspec.json.decode(path.read_bytes()) if path.exists() else {}


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(old)
    for key, value in new.items():
        is_nested = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if is_nested else value
    return merged
