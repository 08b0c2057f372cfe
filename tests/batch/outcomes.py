"""Outcomes of attempts, and a planned batch, for tests that run nothing."""

from pathlib import Path
from typing import Any

from hsslam_batch.attempt.outcome import Kind, Outcome
from hsslam_batch.plan.batch import Batch, planned_batch, write_batch
from hsslam_batch.plan.log import Log, write_manifest
from hsslam_services.run.options import ServeOptions


def planned(
    out: Path, frames: tuple[int, ...] = (100, 200, 0), seed: int = 0, url: str = ""
) -> Batch:
    """A batch of logs with these numbers of frames, named log0, log1, ..., with ids id0, id1, ..."""
    out.mkdir(parents=True, exist_ok=True)
    logs = [
        Log(k, f"id{k}", f"log{k}", "mcap", f"/logs/log{k}", 1000, "1", n)
        for k, n in enumerate(frames)
    ]
    write_manifest(out, logs)
    batch, text = planned_batch(out, ServeOptions(seed=seed), "/logs", url)
    write_batch(batch, text)
    return batch


def outcome(batch: Batch, index: int, kind: Kind = "done", **fields: Any) -> Outcome:
    """What came of a log of this batch."""
    names = {"id": f"id{index}", "name": f"log{index}", "attempt": 1}
    return Outcome(configuration=batch.about.configuration, kind=kind, **(names | fields))


def run_folder(batch: Batch, index: int, text: str = "a pose") -> Path:
    """A run folder as an attempt leaves it, with some of the files."""
    folder = batch.work / f"id{index}.1" / "run"
    folder.mkdir(parents=True)
    for name in ("trajectory.txt", "mesh.ply", "run.rrd", "run.1.rrd", "summary.json"):
        (folder / name).write_text(text)
    return folder
