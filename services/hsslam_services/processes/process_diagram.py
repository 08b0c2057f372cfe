"""The topics and arrays of each process, read from the docstring of its file, and their diagram."""

import ast
from dataclasses import dataclass
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_proto.topics import EVENT, HEALTH, TOPICS

ARENA_ARRAYS = {  # group, as in a header: prefixes of its arrays
    "keyframes": ("keyframe",),
    "map": ("params", "adam_", "gradient", "published", "field_"),
    "map_state": ("map_state",),
    "load_level": ("load_level",),
    "pose_log": ("pose_",),
}
_EVERY_TOPIC = "every logged topic"
_OF_ALL = (EVENT.name, HEALTH.name)  # a process publishes these through its `Worker`
_FIELDS = ("Subscribes", "Publishes", "Arena")


@dataclass(frozen=True)
class ProcessHeader:
    """Names of the topics and the groups of shared arrays of one process."""

    name: str
    subscribes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        topics = {topic.name for topic in TOPICS}
        _expect_known(self.name, {*self.subscribes, *self.publishes} - topics, topics)
        _expect_known(self.name, {*self.reads, *self.writes} - set(ARENA_ARRAYS), set(ARENA_ARRAYS))


def process_headers() -> tuple[ProcessHeader, ...]:
    """The headers of the supervisor and of all processes of `processes/`, sorted by name.

    Raises:
        UserError: a header names a topic or an array that does not exist.
    """
    services = Path(__file__).parents[1]
    files = [services / "supervisor" / "supervisor.py"]
    own = Path(__file__).name
    files += sorted(f for f in (services / "processes").glob("[a-z]*.py") if f.name != own)
    return tuple(read_header(file) for file in files)


def read_header(file: Path) -> ProcessHeader:
    """Parse the header of one process file, without an import."""
    doc = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    found = dict.fromkeys(_FIELDS, "")
    for line in doc.splitlines():
        field, colon, value = line.partition(": ")
        if colon and field in found:
            found[field] = value
    shared = dict(part.split(" ", 1) for part in found["Arena"].split("; ") if part)
    return ProcessHeader(
        name=file.stem,
        subscribes=_topics(found["Subscribes"]),
        publishes=_topics(found["Publishes"]),
        reads=_names(shared.get("reads", "")),
        writes=_names(shared.get("writes", "")),
    )


def process_diagram() -> str:
    """The diagram as text: senders and receivers of each topic, writers and readers of each array group."""
    headers = process_headers()
    rows = [
        (f"{', '.join(senders)}", f"--{topic.name}-->", ", ".join(hears))
        for topic in TOPICS
        if topic.name not in _OF_ALL
        and (senders := [h.name for h in headers if topic.name in h.publishes])
        and (hears := [h.name for h in headers if topic.name in h.subscribes])
    ]
    rows += [
        ("every process", f"--{n}-->", ", ".join(h.name for h in headers if n in h.subscribes))
        for n in _OF_ALL
    ]
    rows += [
        (
            ", ".join(h.name for h in headers if group in h.writes),
            f"=={group}==>",
            ", ".join(h.name for h in headers if group in h.reads),
        )
        for group in ARENA_ARRAYS
    ]
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    return "\n".join(f"{a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows)


def _topics(text: str) -> tuple[str, ...]:
    if text == _EVERY_TOPIC:
        return tuple(topic.name for topic in TOPICS if topic.logged)
    return _names(text)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name for name in text.split(", ") if name)


def _expect_known(process: str, unknown: set[str], known: set[str]) -> None:
    if unknown:
        expected = ", ".join(sorted(known))
        raise UserError(f"header of {process}: {min(unknown)}: expected one of {expected}")
