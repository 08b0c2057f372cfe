"""Which runs a table needs, and which of them cannot be made."""

from dataclasses import dataclass, replace

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.presets import PRESETS
from hsslam_node.services.bench.tables.job import Job
from hsslam_node.services.bench.tables.options import TableOptions
from hsslam_node.services.bench.tables.override import parsed_overrides, with_overrides
from hsslam_node.services.bench.tables.paper_tables import PaperRow, PaperTable
from hsslam_node.services.bench.tables.sequences import expected_place, find_sequence
from hsslam_node.sources.source import SourceOptions


@dataclass(frozen=True)
class Plan:
    """The runs, seed by seed: what there is early on is a whole table of few seeds."""

    rows: tuple[PaperRow, ...]
    jobs: tuple[Job, ...]
    skipped: tuple[str, ...]  # one line each


def plan_table(table: PaperTable, options: TableOptions) -> Plan:
    """The runs of the rows that were asked for.

    Raises:
        UserError: no such row or parameter, or a value that it cannot have.
    """
    rows = _rows(table, options.rows)
    base = with_overrides(PRESETS[options.preset], parsed_overrides(options.set))
    configs = {row.name: with_overrides(base, row.overrides) for row in rows}
    frames = SourceOptions(noise=options.noise, stride=options.stride, frames=options.frames)
    if options.sequences and not table.sequences:
        raise UserError(f"--sequences: the rows of {table.name} are sequences: expected --rows")
    skipped: dict[str, str] = {}
    jobs = []
    for seed in options.seeds:
        for row in rows:
            for sequence in options.sequences or table.sequences or (row.name,):
                source = find_sequence(options.data, sequence)
                if source is None and not options.show:
                    place = expected_place(options.data, sequence)
                    skipped[sequence] = f"skipped {sequence}: {place} is not on disk"
                    continue
                jobs.append(
                    Job(
                        table=table.name,
                        row=row.name,
                        sequence=sequence,
                        source=source or "",
                        seed=seed,
                        protocol=options.protocol,
                        config=configs[row.name],
                        frames=replace(frames, seed=seed),
                        device=options.device,
                    )
                )
    return Plan(rows, tuple(jobs), tuple(skipped.values()))


def _rows(table: PaperTable, names: tuple[str, ...]) -> tuple[PaperRow, ...]:
    known = {row.name: row for row in table.rows}
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known, cutoff=0.4)
            raise UserError(f"--rows {name}: expected some of {', '.join(known)}{hint}")
    return tuple(row for row in table.rows if not names or row.name in names)
