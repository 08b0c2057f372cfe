"""The options of `hsslam-bench ablation|replica|tum|scannet`, and changes to a configuration by name."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import msgspec

from hsslam_bench.options import expect_json
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
    """Measures a table of the paper: mean and standard deviation over the seeds, and the paper's numbers.

    Examples:
      hsslam-bench tum --fetch --preset realtime
      hsslam-bench ablation --sequences tum --fetch --rows full D --seeds 0

    The command reports and skips sequences that are not on disk. It keeps results in the file for this
    commit and configuration.

    Exit codes: 0 if the table is measured, 1 if a run failed, there is no result or the command is
    interrupted, 2 if the input is bad.

    Raises:
        UserError: an option has a bad value.
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
    """Configuration that the rows change; eslam and co-slam are the compared methods."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds of all random numbers; each run is repeated with each seed."""
    rows: tuple[str, ...] = ()
    """Rows of the table, such as full A B, or room0 room1 (none: all)."""
    sequences: tuple[str, ...] = ()
    """Sequences of every row of the ablation, such as house, room0, fr1/desk, room; tum: the three sequences
    of the TUM table (none: house)."""
    fetch: bool = False
    """Download TUM RGB-D sequences that are not on disk (several GB), to $HSSLAM_DATA, else to the cache."""
    frames: int | None = None
    """Use at most N frames of each sequence (none: all)."""
    stride: int = 1
    """Use every N-th frame."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to sequences without noise."""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """Device that computes the map; auto: an NVIDIA GPU if one works, else the CPU."""
    set: tuple[str, ...] = ()
    """Changes to the preset for all rows, such as mapper.rays=500."""
    out: Path | None = None
    """Result file, JSON; beside it go the table (.md) and the runs (none: runs/tables/TABLE.json)."""
    show: bool = False
    """Run nothing: show the table of the results in the file, from any commit."""
    rescore: bool = False
    """Run nothing: score the trajectories and meshes of the runs in the file again."""
    docs: tuple[Path, ...] = ()
    """Documents to write the table into, between <!-- table:TABLE --> and <!-- table:end -->."""

    def __post_init__(self) -> None:
        if not self.seeds or any(seed < 0 for seed in self.seeds):
            raise UserError(f"--seeds {' '.join(map(str, self.seeds))}: expected numbers from 0")
        if self.show and self.rescore:
            raise UserError("--show --rescore: expected only one of these options")
        expect_json(self.out)

    @property
    def protocol(self) -> str:
        """The options of all runs in words."""
        parts = [f"preset {self.preset}", *self.set, f"{self.frames or 'all'} frames"]
        if self.stride > 1:
            parts.append(f"one in {self.stride}")
        if self.device != "cpu":
            parts.append(f"device {self.device}")
        return "; ".join((*parts, f"noise {self.noise}"))


def with_overrides(config: SlamConfig, overrides: Mapping[str, Override]) -> SlamConfig:
    """The configuration with changes as `{"field.plane_channels": 16}`; `TWICE` doubles a value.

    Raises:
        UserError: an unknown parameter (the message suggests the nearest name), or a bad value.
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
    """Parse `("mapper.rays=500",)` to a mapping; the values stay text.

    Raises:
        UserError: a text has no `=`.
    """
    pairs: dict[str, Override] = {}
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
    kinds: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number"}
    return kinds.get(type(value), "a word")
