"""Read the poses of a log into pandas, and print how the run went, second by second.

    python examples/read_log.py runs/room

It needs mcap, msgpack and pandas, not hsslam. docs/wire.md has the fields of all messages. If the end of the
log is missing, as after a crash, `hsslam-log recover runs/room` repairs it.
"""

import struct
import sys
from pathlib import Path

import msgpack
import pandas as pd
from mcap.exceptions import McapError
from mcap.reader import make_reader

_TOPIC = "/out/pose"  # after hsslam/ROBOT
_SLOWEST = 3


def read_poses(run: Path) -> pd.DataFrame:
    """A row for each pose, in the order of the log, indexed by the time of the frame."""
    rows = []
    for part in sorted(run.glob("run*.mcap"), key=lambda path: (len(path.name), path.name)):
        with part.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                if channel.topic.endswith(_TOPIC):
                    rows.append(msgpack.unpackb(message.data))
    if not rows:
        raise SystemExit(f"error: {run}: expected a run folder with poses in run.mcap")
    poses = pd.DataFrame(rows)
    return poses.set_index(pd.to_datetime(poses["stamp_ns"], unit="ns"))


def by_second(poses: pd.DataFrame) -> pd.DataFrame:
    """Poses, lost frames and the largest latency of each second."""
    seconds = poses.resample("1s")
    return pd.DataFrame(
        {
            "poses": seconds.size(),
            "lost": seconds["status"].apply(lambda status: int((status == "lost").sum())),
            "latency_ms": seconds["latency_ms"].max(),
        }
    )


def main(run: Path) -> None:
    """Print the share of tracked frames, latencies, and the slowest seconds."""
    try:
        poses = read_poses(run)
    except (OSError, McapError, struct.error) as error:
        raise SystemExit(f"error: {run}: {error}") from None
    poses["latency_ms"] = (poses["publish_ns"] - poses["stamp_ns"]) / 1e6
    tracked = (poses["status"] != "lost").mean()
    middle, late = poses["latency_ms"].quantile([0.5, 0.99])
    print(
        f"{len(poses)} poses, {tracked:.1%} tracked, latency p50 {middle:.0f} ms, p99 {late:.0f} ms"
    )
    print(by_second(poses).nlargest(_SLOWEST, "latency_ms").round(1))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python examples/read_log.py RUN")
    main(Path(sys.argv[1]))
