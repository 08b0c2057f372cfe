"""The options of `hsslam-bench ablation|replica|tum|scannet`.

Changes to a configuration by name: `field.plane_channels` = 16.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import msgspec

from hsslam_bench.tables.paper_tables import TWICE, Override
from hsslam_node.config import SlamConfig
from hsslam_node.environment import BENCH_DATA, DATA
from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.presets import PresetName


def data_folder(given: Path | None) -> Path:
    """The folder of the sequences: the given one, that of the environment, or the default."""
    if given is not None:
        return given
    return Path(DATA.value() or BENCH_DATA.value() or "../shared/data")


@dataclass(frozen=True)
class TableOptions:
    """Measures a table of the paper: mean and standard deviation over the seeds, beside the paper's numbers.

    Examples:
      hsslam-bench tum --fetch --preset realtime
      hsslam-bench ablation --sequences tum --fetch --rows full D --seeds 0

    Sequences that are not on disk are skipped and reported. Results in the file for this commit and
    configuration are not measured again.

    Exit codes: 0 if the table is measured, 1 if a run failed or the command is interrupted, 2 if the input is
    bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    VALUES: ClassVar = {
        "data": "FOLDER",
        "rows": "NAME...",
        "sequences": "NAME...",
        "set": "GROUP.FIELD=VALUE...",
    }

    data: Path | None = None
    """Folder of the sequences (none: $HSSLAM_DATA, $HSSLAM_TEST_DATA, else ../shared/data)."""
    preset: PresetName = "paper"
    """Configuration that the rows change; eslam and co-slam are the methods of comparison."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds of all random numbers."""
    rows: tuple[str, ...] = ()
    """Rows of the table, such as full A B, or room0 room1 (none: all)."""
    sequences: tuple[str, ...] = ()
    """For the ablation: sequences of every row, such as house, room0, fr1/desk, room; tum: the three of the
    table of TUM (none: house)."""
    fetch: bool = False
    """Fetch sequences of TUM RGB-D that are not on disk (several GB), to $HSSLAM_DATA, else to the cache."""
    frames: int | None = None
    """Use at most N frames of each sequence (none: all)."""
    stride: int = 1
    """Use every N-th frame."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to sequences without noise."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """Where the map is computed; auto: an NVIDIA GPU if one works."""
    set: tuple[str, ...] = ()
    """Changes to the preset for all rows, such as mapper.rays=500."""
    out: Path | None = None
    """Result file, JSON, beside the table (.md) and a folder of the runs (none: runs/tables/TABLE.json)."""
    show: bool = False
    """Run nothing: show the table of the results in the file, of any commit."""
    rescore: bool = False
    """Run nothing: score the trajectories and meshes of the runs in the file again."""
    docs: tuple[Path, ...] = ()
    """Documents to write the table into, between <!-- table:TABLE --> and <!-- table:end -->."""

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
        if self.device != "cpu":
            parts.append(f"device {self.device}")
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
