"""The list of times beside a plain folder of images."""

import re
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import parse_stamp_ns
from hsslam_node.sources.files.name_stamp import long_stamp_ns

_NAMES = ("times.txt", "times.csv", "timestamps.txt", "timestamps.csv")


def read_times(folder: Path, files: list[Path]) -> dict[Path, int] | None:
    """Stamps in ns of these files, from `times.txt`, `times.csv`, `timestamps.txt` or `timestamps.csv`.

    A line is a stamp, or a stamp and a file in either order, separated by blanks, commas or semicolons;
    without files the lines are in the files' order. Stamps are seconds, or numbers of 13, 16 or 19
    digits before the point (ms, us, ns). Comments (#) and a first line of titles are left out. None: there
    is no list.

    Raises:
        UserError: a line that cannot be read, or not one line a file.
    """
    path = next((folder / name for name in _NAMES if (folder / name).exists()), None)
    if path is None:
        return None
    rows = _read_rows(path)
    names = {name for name, _ in rows if name}
    if not names:
        if len(rows) != len(files):
            raise UserError(
                f"{path}: {len(rows)} stamps: expected {len(files)}, one a colour image"
            )
        return {file: stamp for file, (_, stamp) in zip(files, rows, strict=True)}
    by_name = {Path(name).name: stamp for name, stamp in rows}
    found = {file: by_name[file.name] for file in files if file.name in by_name}
    if not found:
        raise UserError(f"{path}: names no image of {files[0].parent}, as {files[0].name}")
    return found


def _read_rows(path: Path) -> list[tuple[str, int]]:
    """(file or nothing, stamp in ns) of every line."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError):
        raise UserError(f"{path}: cannot be read: expected lines 'stamp' or 'stamp file'") from None
    rows, has_titles = [], False
    for number, line in enumerate(lines, 1):
        words = re.split(r"[,;\s]+", line.strip().strip(",;"))
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        stamps = [stamp for word in words if (stamp := listed_stamp_ns(word)) is not None]
        names = [word for word in words if re.search(r"\.[A-Za-z]\w*$", word)]
        if not (stamps or names or rows or has_titles):
            has_titles = True
            continue
        if not stamps:
            raise UserError(f"{path}:{number}: {line.strip()!r}: expected 'stamp' or 'stamp file'")
        if len(stamps) > 1:
            raise UserError(
                f"{path}:{number}: {line.strip()!r}: {len(stamps)} numbers, which may all be times: expected "
                "'stamp' or 'stamp file'"
            )
        if stamps[0] < 0:
            raise UserError(f"{path}:{number}: {line.strip()!r}: expected a time from 0 on")
        rows.append((names[0] if names else "", stamps[0]))
    return rows


def listed_stamp_ns(word: str) -> int | None:
    """Seconds, or a number of 13, 16 or 19 digits before the point, if any (ms, us, ns), in ns; None: no
    time."""
    if re.fullmatch(r"[0-9]+(\.[0-9]+)?", word) and (stamp := long_stamp_ns(word)) is not None:
        return stamp
    try:
        return parse_stamp_ns(word)
    except ValueError:
        return None
