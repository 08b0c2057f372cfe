"""The table of sources in a markdown file: `python docs/site/source_table.py [--check] FILE`

Rewrites what lies between the markers; --check only reports whether that is needed.
"""

import argparse
import sys
from pathlib import Path

from hsslam_services.run.source_table import ALL_SOURCES

_BEGIN, _END = "<!-- sources: begin -->", "<!-- sources: end -->"


def source_table() -> str:
    """All sources: what a user types, and what it is."""
    rows = [
        f"| {', '.join(f'`{example}`' for example in row.examples)} | {row.about} |"
        for row in ALL_SOURCES
    ]
    return "\n".join(["| source | what it is |", "|---|---|", *rows])


def main() -> int:
    """Exit code 1 if --check finds an old table, 2 if the file has no place for it."""
    parser = argparse.ArgumentParser(prog="source_table", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("--check", action="store_true", help="change nothing, report an old table")
    arguments = parser.parse_args()
    old = arguments.file.read_text()
    head, begin, rest = old.partition(_BEGIN)
    _, end, tail = rest.partition(_END)
    if not (begin and end):
        print(f"error: {arguments.file}: expected {_BEGIN} and {_END}", file=sys.stderr)
        return 2
    new = f"{head}{begin}\n{source_table()}\n{end}{tail}"
    if new != old and arguments.check:
        print(f"{arguments.file}: old: run python docs/site/source_table.py {arguments.file}")
        return 1
    arguments.file.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main())
