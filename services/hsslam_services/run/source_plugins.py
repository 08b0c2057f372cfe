"""Sources of other installed packages: entry points of the group `hsslam.sources`.

The name of an entry point is the kind of the source; its value is the import path of the `SourceRow`. A
broken entry point becomes a row with the reason in `fault`, so other sources go on working. If two packages
have one kind, the first that works has it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from hsslam_node.errors import one_line
from hsslam_node.sources.source_row import SourceRow

GROUP = "hsslam.sources"


def plugin_rows(own: Sequence[SourceRow]) -> tuple[SourceRow, ...]:
    """The rows of all installed packages, sorted by kind; the kinds of `own` are taken.

    Of one kind, the row that works comes first, as look-ups take the first one.
    """
    taken = {row.kind for row in own}
    rows = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value)):
        row = _row(point, taken)
        rows.append(row)
        if not row.fault:
            taken.add(row.kind)
    return tuple(sorted(rows, key=lambda row: (row.kind, bool(row.fault))))


def _row(point: EntryPoint, taken: set[str]) -> SourceRow:
    package = point.dist.name if point.dist else point.module
    try:
        row = point.load()
    except (Exception, SystemExit) as error:  # foreign code may raise anything
        return _broken(point, package, one_line(error))
    if not isinstance(row, SourceRow):
        return _broken(point, package, f"{point.value} is {type(row).__name__}: expected SourceRow")
    if row.kind != point.name:
        return _broken(
            point, package, f"{point.value} has kind {row.kind!r}: expected {point.name!r}"
        )
    if row.kind in taken:
        return _broken(point, package, f"kind {row.kind!r} is taken: expected another")
    if not _has_examples(row):
        return _broken(
            point, package, f"examples {row.examples!r}: expected sources of kind {row.kind}"
        )
    return replace(row, package=package, looks_like=_never_raising(row.looks_like))


def _has_examples(row: SourceRow) -> bool:
    """Whether the row has examples, in a tuple, and all are sources of its kind."""
    return (
        isinstance(row.examples, tuple)
        and bool(row.examples)
        and all(isinstance(example, str) and row.matches(example) for example in row.examples)
    )


def _broken(point: EntryPoint, package: str, reason: str) -> SourceRow:
    return SourceRow(
        kind=point.name,
        examples=(f"{point.name}:",),
        brief=f"does not work: package {package}: {reason}",
        about=f"does not work: {reason}",
        opener=point.value,
        package=package,
        fault=reason,
    )


def _never_raising(looks_like: Callable[[Path], bool]) -> Callable[[Path], bool]:
    def asked(path: Path) -> bool:
        try:
            return bool(looks_like(path))
        except Exception:  # used only for suggestions
            return False

    return asked
