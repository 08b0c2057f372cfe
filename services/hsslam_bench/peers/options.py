"""The options of `hsslam-bench peers`: one frozen dataclass, and the sequences that they name."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from hsslam_bench.options import expect_folder, expect_json
from hsslam_bench.peers.systems.catalogue import SEQUENCES
from hsslam_bench.tables.options import data_folder
from hsslam_bench.tables.plan import expected_place, find_sequence
from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions

_NOISE = "-kinect"


@dataclass(frozen=True)
class PeersOptions:
    """Runs other systems on the same sequences; scores them and your own results with the same code.

    Examples:
      hsslam-bench peers
      hsslam-bench peers --sequences house --peers hs-slam open3d-slam --frames 100
      hsslam-bench peers --no-run --source tum:fr1/desk --result orb-slam3=CameraTrajectory.txt
      hsslam-bench peers --results others

    --result takes a trajectory (camera to world, OpenCV axes, m) in TUM format, or a line of 16 numbers for
    each frame, and a mesh (m) in the same world. --results takes a folder of such files: SEQUENCE/NAME.txt
    and SEQUENCE/NAME.ply.

    Exit codes: 0 if the table is measured, 1 if a run failed, nothing was measured or the command is
    interrupted, 2 if the input is bad.

    Raises:
        UserError: options that exclude each other, a folder that is missing, or an --out that is no .json.
    """

    VALUES: ClassVar = {
        "data": "FOLDER",
        "sequences": "NAME...",
        "peers": "NAME...",
        "source": "SOURCE",
        "result": "NAME=FILES...",
        "results": "FOLDER",
        "out": "FILE",
    }

    sequences: tuple[str, ...] = SEQUENCES
    """Sequences of --data; house-kinect is house with the noise of a Kinect."""
    data: Path | None = None
    """Folder of the sequences (none: $HSSLAM_DATA, $HSSLAM_TEST_DATA, else ../shared/data)."""
    source: str = ""
    """A source instead of the sequences: synth:room, tum:FOLDER, replica:FOLDER."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to --source."""
    frames: int | None = None
    """Use at most N frames of each sequence (none: all)."""
    peers: tuple[str, ...] = ()
    """Peers to run (none: all)."""
    run: bool = True
    """Run the peers, besides scoring results."""
    result: tuple[str, ...] = ()
    """Your results to score: NAME=trajectory.txt, NAME=trajectory.txt,mesh.ply or NAME=FOLDER with these."""
    results: Path | None = None
    """Folder of your results to score: SEQUENCE/NAME.txt, SEQUENCE/NAME.ply."""
    out: Path = Path("runs/peers.json")
    """Result file, JSON; beside it go the table (.md) and a folder of the peers' trajectories and meshes."""

    def __post_init__(self) -> None:
        if self.noise != "none" and not self.source:
            raise UserError(
                f"--noise {self.noise}: expected with --source; for a sequence write house-kinect"
            )
        if self.source and self.results is not None:
            raise UserError(
                f"--results {self.results}: has a folder a sequence: expected --result with --source"
            )
        if self.result and not self.source and len(self.sequences) != 1:
            raise UserError("--result: expected with --source, or with one sequence in --sequences")
        if not (self.run or self.result or self.results):
            raise UserError("nothing to score: expected --result or --results with --no-run")
        expect_folder("--data", self.data)
        expect_folder("--results", self.results)
        expect_json(self.out)

    @property
    def sources(self) -> "list[PeerSequence]":
        """The sequences of the options, on disk or not."""
        if self.source:
            options = SourceOptions(noise=self.noise, frames=self.frames)
            name = self.source + (_NOISE if self.noise != "none" else "")
            return [PeerSequence(name, self.source, options)]
        return [self._sequence(name) for name in self.sequences]

    def _sequence(self, name: str) -> "PeerSequence":
        place = name.removesuffix(_NOISE)
        noise = "kinect" if name.endswith(_NOISE) else "none"
        options = SourceOptions(noise=noise, frames=self.frames)
        folder = data_folder(self.data)
        return PeerSequence(
            name, find_sequence(folder, place), options, expected_place(folder, place)
        )


@dataclass(frozen=True)
class PeerSequence:
    """A sequence as the table names it."""

    name: str
    source: str | None  # as for --source; None: not on disk
    options: SourceOptions
    place: str = ""  # expected folder

    @property
    def arguments(self) -> Sequence[str]:
        """Arguments of `peer_run`."""
        frames = () if self.options.frames is None else ("--frames", str(self.options.frames))
        return ("--noise", self.options.noise, *frames)
