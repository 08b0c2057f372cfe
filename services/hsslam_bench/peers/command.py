"""`hsslam-bench peers`: runs and scores other systems, writes their table."""

import dataclasses
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.progress import track

from hsslam_bench.peers.options import PeerSequence, PeersOptions
from hsslam_bench.peers.outside_results import (
    OutsideResult,
    parsed_result,
    read_trajectory,
    results_in,
)
from hsslam_bench.peers.peer_run import find_peer
from hsslam_bench.peers.score import score
from hsslam_bench.peers.systems.catalogue import PEERS
from hsslam_bench.peers.systems.peer import Peer
from hsslam_bench.peers.table import PeerRow, peers_markdown, peers_table
from hsslam_bench.results.report import machine
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_services.commands.cli import parse_options
from hsslam_services.launch.spawn import child_environment
from hsslam_services.run.run_info import write_atomically
from hsslam_services.run.summary import source_commit

_MODULE = "hsslam_bench.peers.peer_run"
_WIDTH = 190  # characters, without a terminal
_NOTE = (
    "exact: our protocol; lit.: the literature's protocol; acc. and comp.: means; %: within 5 cm; "
    "frames/s: of processor time, one thread."
)


def peers_command(args: Sequence[str]) -> int:
    """Measure the table; returns the exit code.

    Raises:
        UserError: a bad option, or a file that is not readable or writable.
    """
    options = parse_options(PeersOptions, "hsslam-bench peers", args)
    width = None if sys.stdout.isatty() else _WIDTH
    console = Console(emoji=False, highlight=False, markup=False, width=width)
    rows: list[PeerRow] = []
    interrupted = False
    begun = {"commit": source_commit(), "machine": machine(), "frames": options.frames}
    try:
        for row in _measured(options, console):
            rows.append(row)
            _write(options.out, begun, rows)
            if row.error or not console.is_terminal:
                console.print(f"{row.sequence} {row.peer}: {_row_text(row)}", soft_wrap=True)
    except KeyboardInterrupt:
        interrupted = True
    if not rows:
        console.print("nothing was measured: no table")
        return 1
    console.print(peers_table(rows))
    console.print(_NOTE, soft_wrap=True)
    console.print(f"results: {options.out}, {options.out.with_suffix('.md')}", soft_wrap=True)
    return int(interrupted or any(row.error for row in rows))


def _measured(options: PeersOptions, console: Console) -> Iterator[PeerRow]:
    """A row for each sequence on disk and each peer that can run, and for each given result."""
    chosen = [find_peer(name) for name in options.peers] or PEERS
    peers = [peer for peer in chosen if _can_run(peer, console)] if options.run else []
    given = [parsed_result(text) for text in options.result]
    for sequence in options.sources:
        if sequence.source is None:
            console.print(f"skipped {sequence.name}: {sequence.place} is not on disk")
            continue
        for result in given:
            _trajectory(result, sequence)  # a bad file is refused before peers run for hours
        found = options.results
        results = [*given, *(results_in(found, sequence.name) if found is not None else ())]
        for peer in track(
            peers, sequence.name, console=console, transient=True, disable=not console.is_terminal
        ):
            yield _run(peer, sequence, options.out.with_suffix(""))
        for result in results:
            yield _scored(result, sequence)


def _can_run(peer: Peer, console: Console) -> bool:
    try:
        peer.expect()
    except UserError as error:
        console.print(f"skipped {peer.name}: {error}", soft_wrap=True)
        return False
    return True


def _run(peer: Peer, sequence: PeerSequence, folder: Path) -> PeerRow:
    assert sequence.source is not None
    own = folder / f"{sequence.name.replace(':', '-').replace('/', '-')}-{peer.name}"
    command = [sys.executable, "-P", "-m", _MODULE, peer.name, sequence.source, str(own)]
    done = subprocess.run(
        [*command, *sequence.arguments],
        env=child_environment(),
        capture_output=True,
        text=True,
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        error = f"ended with code {done.returncode}: {lines[-1]}"
        return PeerRow(sequence.name, peer.title, error=error)
    values = json.loads(done.stdout.splitlines()[-1])  # libraries print as well
    return PeerRow(sequence.name, peer.title, values)


def _scored(result: OutsideResult, sequence: PeerSequence) -> PeerRow:
    assert sequence.source is not None
    try:
        trajectory = _trajectory(result, sequence)
        name = str(result.trajectory)
        values = score(sequence.source, sequence.options, trajectory, result.mesh, name)
    except UserError as error:
        return PeerRow(sequence.name, result.name, error=str(error))
    return PeerRow(sequence.name, result.name, values)


def _trajectory(result: OutsideResult, sequence: PeerSequence) -> Trajectory:
    assert sequence.source is not None
    return read_trajectory(result.trajectory, open_ground_truth(sequence.source, sequence.options))


def _row_text(row: PeerRow) -> str:
    ate_cm = row.values.get("ate_cm")
    return row.error or ("no ATE" if ate_cm is None else f"ATE {ate_cm:.3f} cm")


def _write(path: Path, begun: Mapping[str, Any], rows: Sequence[PeerRow]) -> None:
    """Write all rows so far, as JSON and as markdown."""
    found = {
        **begun,
        "settings": {peer.title: peer.settings for peer in PEERS},
        "rows": [dataclasses.asdict(row) for row in rows],
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, msgspec.json.format(msgspec.json.encode(found)))
        note = f"{_NOTE} The first {begun['frames']} frames." if begun["frames"] else _NOTE
        path.with_suffix(".md").write_text(f"{peers_markdown(rows)}\n{note}\n")
    except OSError as error:
        raise UserError(f"--out {path}: {error.strerror}: expected a file to write") from None
