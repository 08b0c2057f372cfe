"""What a user can ask of `hsslam-bench ablation|replica|tum|scannet`.

Changes to a configuration by name: `field.plane_channels` = 16.
"""

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec

from hsslam_bench.tables.paper_tables import TWICE, Override
from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError, did_you_mean
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


def with_overrides(config: SlamConfig, overrides: Mapping[str, Override]) -> SlamConfig:
    """The configuration with `{"group.field": value}` changed; `TWICE` doubles the value there is.

    Raises:
        UserError: no such parameter (the nearest is suggested), or a value it cannot have.
    """
    changed: dict[str, dict[str, Any]] = {}
    for name, value in overrides.items():
        group, field = _known(config, name)
        old = getattr(getattr(config, group), field.name)
        new = 2 * old if value == TWICE else value
        try:
            changed.setdefault(group, {})[field.name] = msgspec.convert(
                new, type(old), strict=not isinstance(new, str)
            )
        except msgspec.ValidationError:
            raise UserError(f"{name} = {value}: expected {_kind(old)}, as {old}") from None
    groups = {g: dataclasses.replace(getattr(config, g), **new) for g, new in changed.items()}
    return dataclasses.replace(config, **groups)


def parsed_overrides(texts: tuple[str, ...]) -> dict[str, Override]:
    """`("mapper.rays=500",)` as a mapping; values stay text until the parameter's type is known.

    Raises:
        UserError: no `=` in it.
    """
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise UserError(f"--set {text}: expected GROUP.FIELD=VALUE, as mapper.rays=500")
        pairs[name] = value
    return pairs


def _known(config: SlamConfig, name: str) -> tuple[str, dataclasses.Field]:
    known = {
        f"{group.name}.{field.name}": (group.name, field)
        for group in dataclasses.fields(config)
        for field in dataclasses.fields(getattr(config, group.name))
    }
    plain = name.replace("-", "_")
    if plain not in known:
        hint = did_you_mean(plain, known)
        raise UserError(f"{name}: expected a parameter, as mapper.rays{hint}")
    return known[plain]


def _kind(value: object) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number"}.get(
        type(value), "a word"
    )
