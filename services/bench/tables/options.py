"""What a user can ask of `hsslam-bench ablation|replica|tum|scannet`."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hsslam_node.errors import UserError
from hsslam_node.presets import PresetName


def _data() -> Path:
    for name in ("HSSLAM_DATA", "HSSLAM_TEST_DATA"):
        if os.environ.get(name):
            return Path(os.environ[name])
    return Path("../shared/data")


@dataclass(frozen=True)
class TableOptions:
    """Measure a table of the paper: mean and standard deviation over the seeds beside its numbers.

    What is not on disk is skipped and told. Results that the file has for this commit and
    configuration are not measured again. Exit code 0: done; 1: a run failed, or interrupted; 2: bad
    input.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    data: Path = field(default_factory=_data)
    """Folder of the sequences."""
    preset: PresetName = "paper"
    """Configuration that the rows change; eslam and co-slam are the methods it is compared with."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds of everything random."""
    rows: tuple[str, ...] = ()
    """Rows of the table, as full A B, or room0 room1 (none: all)."""
    sequences: tuple[str, ...] = ()
    """For the ablation: sequences of every row, as house, room0, fr1/desk or room, which is built in
    (none: house)."""
    frames: int | None = None
    """Use at most so many frames of each sequence (none: all)."""
    stride: int = 1
    """Use every n-th frame."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to exact sequences."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """Where the scene model is computed."""
    set: tuple[str, ...] = ()
    """Changes to the preset for all rows, as mapper.rays=500 (none: the preset as it is)."""
    out: Path | None = None
    """Result file; beside it the table as .md and a folder of the runs (none: runs/tables/TABLE.json)."""
    show: bool = False
    """Run nothing: the table of what the file has, of whatever commit."""
    rescore: bool = False
    """Run nothing: score the trajectories and meshes of the runs that the file has again."""
    docs: tuple[Path, ...] = ()
    """Documents that get the table, between their lines <!-- table:TABLE --> and <!-- table:end -->."""

    def __post_init__(self) -> None:
        if not self.seeds or any(seed < 0 for seed in self.seeds):
            raise UserError(f"--seeds {' '.join(map(str, self.seeds))}: expected numbers from 0")
        if self.show and self.rescore:
            raise UserError("--show --rescore: expected one of them")

    @property
    def protocol(self) -> str:
        """What was done to every sequence, in words."""
        parts = [f"preset {self.preset}", *self.set, f"{self.frames or 'all'} frames"]
        if self.stride > 1:
            parts.append(f"one in {self.stride}")
        return "; ".join((*parts, f"noise {self.noise}"))
