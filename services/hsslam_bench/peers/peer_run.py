"""Runs one peer on one sequence, in a process of its own as its library may crash; prints JSON.

`python -m hsslam_bench.peers.peer_run PEER SOURCE FOLDER [--noise kinect] [--frames N]` writes trajectory.txt
and mesh.ply to FOLDER. It uses one numeric thread.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from hsslam_bench.peers.score import Values, score
from hsslam_bench.peers.systems.catalogue import PEERS
from hsslam_bench.peers.systems.peer import Estimate, Peer
from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import write_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source_row import imported

TRAJECTORY, MESH = "trajectory.txt", "mesh.ply"
_QUICK_FRAMES = 20


def main() -> None:
    """Exit code 0: done; 2: failed, with one line on stderr."""
    parser = argparse.ArgumentParser(prog="peer_run", description=__doc__)
    parser.add_argument("peer")
    parser.add_argument("source")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--frames", type=int)
    parser.add_argument("--quick", action="store_true", help="a few frames")
    arguments = parser.parse_args()
    frames = _QUICK_FRAMES if arguments.quick else arguments.frames
    try:
        options = SourceOptions(noise=arguments.noise, frames=frames)
        values = peer_run(find_peer(arguments.peer), arguments.source, options, arguments.folder)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(json.dumps(values, allow_nan=False))


def find_peer(name: str) -> Peer:
    """The peer of this name.

    Raises:
        UserError: there is no such peer; the message suggests the nearest name.
    """
    known = {peer.name: peer for peer in PEERS}
    if name not in known:
        hint = did_you_mean(name, known, cutoff=0.4)
        raise UserError(f"--peers {name}: expected some of {', '.join(known)}{hint}")
    return known[name]


def peer_run(peer: Peer, source: str, options: SourceOptions, folder: Path) -> Values:
    """Run a peer; returns scores, and frames per second of processor time without reading (`fps`).

    Raises:
        UserError: the source is not readable, the peer cannot run here, or the folder is not writable.
    """
    peer.expect()
    frames = _TimedFrames(source, options)
    track: Callable[[Iterable[Frame]], Estimate] = imported(peer.estimate)
    if peer.prepare:
        imported(peer.prepare)()
    start = time.process_time()
    estimate = track(frames)
    seconds = time.process_time() - start - frames.reading_s
    mesh = estimate.mesh if estimate.mesh is not None and len(estimate.mesh.faces) else None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_tum(folder / TRAJECTORY, estimate.trajectory)
        if mesh is not None:
            mesh.export(folder / MESH)
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}: expected a folder to write") from None
    values = score(source, options, estimate.trajectory, mesh)
    return {**values, "fps": frames.count / seconds if seconds > 0 else None}


class _TimedFrames:
    """The readable frames of a source, and the time to read them."""

    def __init__(self, source: str, options: SourceOptions) -> None:
        self._source = open_source(source, options)
        self.count = 0
        self.reading_s = 0.0  # of processor time

    def __iter__(self) -> Iterator[Frame]:
        frames = iter(self._source.frames())
        while True:
            start = time.process_time()
            frame = next(frames, None)
            self.reading_s += time.process_time() - start
            if frame is None:
                return
            if isinstance(frame, Frame):
                self.count += 1
                yield frame


if __name__ == "__main__":
    main()
