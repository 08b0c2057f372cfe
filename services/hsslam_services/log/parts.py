"""Names of the files of a log; apart as writer, readers and recovery share them."""

import re
from pathlib import Path

_PART = re.compile(r"run(?:\.(\d+))?\.mcap")
_DAMAGED = re.compile(r"(.+)\.damaged(?:-\d+)?(\.mcap)")


def parts(run_dir: Path) -> list[Path]:
    """The parts of a run's log, in order: run.mcap, run.1.mcap, ...; the oldest may be removed."""
    found = [path for path in run_dir.glob("run*.mcap") if is_part(path.name)]
    return sorted(found, key=part_number)


def is_part(name: str) -> bool:
    """Whether this is the name of a part of a log."""
    return _PART.fullmatch(name) is not None


def for_damaged(path: Path) -> Path:
    """The path beside a damaged log that its original takes when it is recovered: NAME.damaged.mcap."""
    name, number = f"{path.stem}.damaged{path.suffix}", 1
    while path.with_name(name).exists():
        number += 1
        name = f"{path.stem}.damaged-{number}{path.suffix}"
    return path.with_name(name)


def recovered_from(name: str) -> str | None:
    """The name of the log that was recovered from a damaged original of this name; None: it is none."""
    match = _DAMAGED.fullmatch(name)
    return match and "".join(match.groups())


def next_part(run_dir: Path) -> Path:
    """The path of the next part of a run's log."""
    existing = parts(run_dir)
    if not existing:
        return run_dir / "run.mcap"
    return run_dir / f"run.{part_number(existing[-1]) + 1}.mcap"


def part_number(path: Path) -> int:
    """0 for run.mcap, 1 for run.1.mcap, ..."""
    match = _PART.fullmatch(path.name)
    return int(match.group(1) or 0) if match else 0


def removed_before(existing: list[Path]) -> int:
    """How many parts of a log have been removed, also by earlier recorders; `existing`: its parts."""
    return part_number(existing[-1]) + 1 - len(existing) if existing else 0


def remove_oldest(run_dir: Path, keep_bytes: int) -> list[Path]:
    """Remove the oldest parts, but never the newest, until the log fits `keep_bytes`; returns the removed.

    The rerun file of a part (run.1.rrd of run.1.mcap) counts and is removed with it.

    Raises:
        OSError: a part cannot be removed.
    """
    existing = parts(run_dir)
    total_bytes = sum(map(_part_bytes, existing))
    removed: list[Path] = []
    for path in existing[:-1]:
        if total_bytes <= keep_bytes:
            break
        total_bytes -= _part_bytes(path)
        path.with_suffix(".rrd").unlink(missing_ok=True)
        path.unlink()
        removed.append(path)
    return removed


def _part_bytes(path: Path) -> int:
    rrd = path.with_suffix(".rrd")
    return path.stat().st_size + (rrd.stat().st_size if rrd.exists() else 0)
