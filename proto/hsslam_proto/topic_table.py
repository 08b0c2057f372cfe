"""The topic table as markdown: `python -m hsslam_proto.topic_table [--check] FILE...`

Rewrites what lies between the markers in each file; --check only tells whether that is needed.
"""

import argparse
import sys
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_proto.codec import encoding_of
from hsslam_proto.topics import TOPICS, Topic

BEGIN, END = "<!-- topics:begin -->", "<!-- topics:end -->"
_HEAD = ("key `hsslam/<robot>/`", "message", "from", "rate", "QoS", "kept", "limit", "log", "view")


def topic_table() -> str:
    """Markdown of all topics, then the fields of each message."""
    lines = topic_rows()
    example = encoding_of(TOPICS[0])
    lines += ["", f"Encoding of each message: as in `{example}`. Fields:", ""]
    lines += [f"- `{topic.message.__name__}`: {_fields(topic)}" for topic in TOPICS]
    return "\n".join(lines)


def topic_rows() -> list[str]:
    """The lines of the table alone."""
    rows = [_HEAD, ("---",) * len(_HEAD), *map(_row, TOPICS)]
    return [f"| {' | '.join(row)} |" for row in rows]


def with_topic_table(text: str, name: str) -> str:
    """The document with its table renewed.

    Raises:
        UserError: the markers are not there.
    """
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise UserError(f"{name}: expected the lines {BEGIN} and {END}")
    return f"{head}{begin}\n{topic_table()}\n{end}{tail}"


def main() -> int:
    """Command line; exit code 1 if --check finds an old table, 2 on bad input."""
    parser = argparse.ArgumentParser(prog="topic_table", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--check", action="store_true", help="change nothing, tell what is old")
    arguments = parser.parse_args()
    status = 0
    for path in arguments.files:
        try:
            old = path.read_text()
            new = with_topic_table(old, str(path))
        except (UserError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        if new == old:
            continue
        if arguments.check:
            print(f"{path}: topic table is old: run python -m hsslam_proto.topic_table {path}")
            status = 1
        else:
            path.write_text(new)
    return status


def _row(topic: Topic) -> tuple[str, ...]:
    return (
        f"`{topic.name}`",
        f"`{topic.message.__name__}`",
        topic.publisher,
        topic.rate,
        topic.qos.upper(),
        str(topic.history or "-"),
        size_text(topic.size_limit_bytes),
        "yes" if topic.logged else "-",
        "yes" if topic.drawn else "-",
    )


def _fields(topic: Topic) -> str:
    return ", ".join(f"`{field}`" for field in topic.message.__struct_fields__)


def size_text(nbytes: int) -> str:
    """A limit in KiB or MiB."""
    return f"{nbytes // 2**20} MiB" if nbytes >= 2**20 else f"{nbytes // 2**10} KiB"


if __name__ == "__main__":
    sys.exit(main())
