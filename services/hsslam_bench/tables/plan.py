"""Plans the runs of a table: finds their sequences, and lists the sequences that are not on disk."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import msgspec

from hsslam_bench.tables.options import TableOptions, data_folder, parsed_overrides, with_overrides
from hsslam_bench.tables.paper_tables import TUM, PaperRow, PaperTable, TableName
from hsslam_bench.tables.published.scene_settings import settings_of
from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.presets import PRESETS, PresetName
from hsslam_node.sources.download.tum_archive import TumArchive
from hsslam_node.sources.options.source import SourceOptions

_COLLECTIONS = ("", "Replica", "replica", "TUM", "tum", "ScanNet", "scannet", "scans")
_OWN = {"house": "replica", "livingroom": "tum", "kitchen": "tum"}  # kinds of the test sequences
_SEE = "see docs/sequences.md"


def find_sequence(data: Path, name: str) -> str | None:
    """The `--source` of a sequence, as room0, fr1/desk, scene0000_00, house or room; None: not on disk.

    Searches the folder, its subfolders Replica, TUM, ScanNet and scans, and for TUM the folder of downloads.
    `room` is a built-in scene.
    """
    if name == "room":
        return "synth:room"
    for kind, path in _candidates(name):
        for collection in _COLLECTIONS:
            place = data / collection / path
            if place.exists():
                return f"{kind}:{place.absolute()}"
    fetched = TumArchive.named(name)
    return None if fetched is None or not fetched.path.is_dir() else f"tum:{fetched.path}"


def expected_place(data: Path, name: str) -> str:
    """The path to name in a message if a sequence is not on disk."""
    return str(data / next(_candidates(name))[1])


def _candidates(name: str) -> Iterator[tuple[str, str]]:
    """Kind of source and path, for each layout in which archives unpack."""
    if name in _OWN:
        yield _OWN[name], name
    elif (archive := TumArchive.named(name)) is not None:
        yield "tum", archive.folder_name
        yield "tum", name
    elif name.startswith("scene"):
        yield "scannet", f"{name}/{name}.sens"
        yield "scannet", f"{name}.sens"
        yield "scannet", name
    else:
        yield "replica", name  # archive of NICE-SLAM
        yield "replica", f"{name[:-1]}_{name[-1]}/imap/00"  # archive of vMAP


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """One configuration on one sequence with one seed: all that the process of a run needs."""

    table: TableName
    row: str
    sequence: str
    source: str  # as for --source
    seed: int
    protocol: str  # in words; `config` has the preset with its changes
    config: SlamConfig
    frames: SourceOptions
    box: tuple[float, ...] = ()  # bound of the map, in the truth's world, m; empty: as configured
    device: Literal["auto", "cpu", "cuda"] = "cpu"

    @property
    def name(self) -> str:
        """Name for people; runs with other options have the same name."""
        return f"{self.row}-{self.sequence.replace('/', '-')}-seed{self.seed}"

    @property
    def key(self) -> str:
        """Equal for jobs that do the same, wherever the data lies."""
        same = msgspec.structs.replace(self, source=self.source.rpartition("/")[2])
        return hashlib.sha256(msgspec.json.encode(same)).hexdigest()[:16]


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a job. New fields have defaults."""

    key: str
    row: str
    sequence: str
    seed: int
    protocol: str
    commit: str  # with a trailing + if files were changed
    time: str = ""  # UTC
    values: dict[str, float | None] = {}  # by metric
    details: dict[str, Any] = {}  # the evaluation's report, the model's parts, frames
    error: str = ""  # last line of output if it failed
    scored_by: str = ""  # commit of a later evaluation of the same trajectories and mesh

    def answers(self, job: Job) -> bool:
        """Whether row, sequence, seed and protocol are those of the job; the commit may differ."""
        mine = (self.row, self.sequence, self.seed, self.protocol)
        return mine == (job.row, job.sequence, job.seed, job.protocol)


def folder_name(run: Job | RunResult) -> str:
    """Name of the folder with the files of a run; runs with other options have another name."""
    return f"{run.row}-{run.sequence.replace('/', '-')}-seed{run.seed}-{run.key}"


@dataclass(frozen=True)
class Plan:
    """The runs, seed by seed, so that the first results are a whole table of few seeds."""

    rows: tuple[PaperRow, ...]
    jobs: tuple[Job, ...]
    skipped: tuple[str, ...]  # one line each


def plan_table(table: PaperTable, options: TableOptions) -> Plan:
    """Plan the runs of the chosen rows; with `--fetch` download public sequences first.

    Raises:
        UserError: an unknown row or parameter, a bad value, or a failed download.
    """
    rows = tuple(titled(row, options.preset) for row in _rows(table, options.rows))
    given = parsed_overrides(options.set)
    with_overrides(PRESETS[options.preset], given)  # raises early
    frames = SourceOptions(noise=options.noise, stride=options.stride, frames=options.frames)
    if options.sequences and not table.sequences:
        raise UserError(f"--sequences: the rows of {table.name} are sequences: expected --rows")
    places = {row.name: _named(options.sequences) or table.sequences or (row.name,) for row in rows}
    if options.fetch:
        _fetch(data_folder(options.data), {name for names in places.values() for name in names})
    skipped: dict[str, str] = {}
    jobs = []
    for seed in options.seeds:
        for row in rows:
            for sequence in places[row.name]:
                source = find_sequence(data_folder(options.data), sequence)
                if source is None and not options.show:
                    place = expected_place(data_folder(options.data), sequence)
                    reason = f"{place} is not on disk; {_SEE}"
                    skipped[sequence] = f"skipped {sequence}: {reason}"
                    continue
                settings = settings_of(options.preset, sequence)
                base = with_overrides(PRESETS[options.preset], {**settings.overrides, **given})
                jobs.append(
                    Job(
                        table=table.name,
                        row=row.name,
                        sequence=sequence,
                        source=source or "",
                        seed=seed,
                        protocol=f"{options.protocol}{settings.protocol}",
                        config=with_overrides(base, row.overrides),
                        frames=replace(frames, seed=seed),
                        box=settings.box,
                        device=options.device,
                    )
                )
    return Plan(rows, tuple(jobs), tuple(skipped.values()))


def titled(row: PaperRow, preset: PresetName) -> PaperRow:
    """The row with the title of what runs: preset `realtime` is not the paper's method."""
    if row.name == "full" and preset == "realtime":
        return replace(row, title=f"preset {preset}")
    return row


def _named(sequences: tuple[str, ...]) -> tuple[str, ...]:
    """The names, with `tum` replaced by the sequences of the paper's TUM table."""
    of_tum = tuple(row.name for row in TUM.rows)
    return tuple(n for name in sequences for n in (of_tum if name == TUM.name else (name,)))


def _fetch(data: Path, names: set[str]) -> None:
    """Download the public sequences that are not on disk, one after the other."""
    for name in sorted(names):
        archive = TumArchive.named(name)
        if archive is not None and find_sequence(data, name) is None:
            archive.fetch()


def _rows(table: PaperTable, names: tuple[str, ...]) -> tuple[PaperRow, ...]:
    known = {row.name: row for row in table.rows}
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known, cutoff=0.4)
            raise UserError(f"--rows {name}: expected some of {', '.join(known)}{hint}")
    return tuple(row for row in table.rows if not names or row.name in names)
