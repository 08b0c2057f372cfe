"""A ROS bag on disk: its topics and their messages, not decoded."""

import contextlib
import struct
import weakref
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hsslam_node.errors import STORAGE_FAILS, UserError
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.reports import Report, Reports
from hsslam_node.user_path import user_path
from hsslam_services.camera.bags.realsense_image import image_without_unit
from hsslam_services.camera.ros2_messages import IMAGE, CdrMessages
from hsslam_services.ros2.static_transforms import TOPIC, StaticTransforms

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Ros1Reader
    from rosbags.rosbag2 import Reader as Ros2Reader

_STAMP_AT = 4  # byte after the header of CDR, or after the sequence number of ROS 1
_STAMP_BYTES = 8
_LONGEST_REASON = 200
_WHOLE = "expected a whole bag of ROS 1 or ROS 2"
_EXPECTED = (  # by a part of the reason that rosbags gives
    ("File end magic", f"{_WHOLE}: mcap recover FILE -o NEW.mcap repairs one that is cut off"),
    ("Profile is not ros2", "expected messages of ROS 2, or the .bag of a recording of ROS 1"),
    (
        "format '.active'",
        "expected a .bag: rosbag reindex, then rename a recording that was cut off",
    ),
    ("is not indexed", f"{_WHOLE}: rosbag reindex repairs a file that is cut off"),
    ("index looks damaged", f"{_WHOLE}: rosbag reindex repairs a file that is cut off"),
    ("No space left on device", "expected room in $TMPDIR, where compressed files are unpacked"),
    ("format '.zst", "expected the folder with metadata.yaml, or the file as zstd -d unpacks it"),
)


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag."""

    name: str
    type_name: str  # such as sensor_msgs/msg/Image, for ROS 1 too
    message_count: int

    def __str__(self) -> str:
        kind = self.type_name.rpartition("/")[2]
        return (
            f"{self.name} ({kind})" if self.message_count else f"{self.name} ({kind}, no messages)"
        )


@dataclass(frozen=True)
class BagMessage:
    """An encoded message that begins with a header."""

    topic: str
    type_name: str
    stamp_ns: int
    payload: bytes

    @property
    def nbytes(self) -> int:
        """Bytes of the payload."""
        return len(self.payload)

    @property
    def content(self) -> bytes:
        """The payload without the beginning and the stamp of its header."""
        return self.payload[_STAMP_AT + _STAMP_BYTES :]


class BagFile:
    """A folder with `metadata.yaml`, a `.mcap` or `.db3` of ROS 2, or a `.bag` of ROS 1.

    The package rosbags reads it, chunk by chunk. The message definitions in the bag are ignored. A bag whose
    files are compressed is unpacked into $TMPDIR until this object is deleted.

    Raises:
        UserError: rosbags is not installed, or the bag is missing or damaged.
    """

    def __init__(self, place: str) -> None:
        self.name = f"bag:{place}"
        self._path = user_path(place)
        self._is_ros1 = self._path.suffix.lower() == ".bag" and not self._path.is_dir()
        self._has_stamps: dict[str, bool] = {}  # by topic, as far as known
        self.decode = CdrMessages(f"source {self.name}", self._is_ros1)
        if not self._path.exists():
            raise UserError(
                f"source {self.name}: no such file: expected a folder with metadata.yaml, a .mcap, a .db3 "
                "or a .bag"
            )
        if self._path.is_dir() and not (self._path / "metadata.yaml").exists():
            raise UserError(
                f"source {self.name}: no metadata.yaml in it: expected a bag of ROS 2 (ros2 bag reindex "
                "writes the file), or its .mcap or .db3"
            )
        self._unpacked: Ros1Reader | Ros2Reader | None = None
        with self._reported(), contextlib.ExitStack() as stack:
            reader = stack.enter_context(self._open())
            self.topics = tuple(
                BagTopic(name, str(topic.msgtype), topic.msgcount)
                for name, topic in sorted(reader.topics.items())
            )
            if getattr(reader, "compression_mode", None) == "file":
                self._unpacked = reader  # it unpacks all files into $TMPDIR when it opens
                weakref.finalize(self, stack.pop_all().close)

    def messages(self, topics: Collection[str]) -> Generator[BagMessage, None, None]:
        """The messages of these topics in the order of recording.

        If all headers of a topic have the same stamp, such as 0, its messages get their times of recording.
        So does a message that is too short for a header.

        Raises:
            UserError: the bag is damaged.
        """
        with self._reported():
            unstamped = self._without_stamps(topics)
            for topic, type_name, recorded_ns, payload in self._payloads(topics):
                stamp_ns = None if topic in unstamped else self._stamp_ns(payload)
                yield BagMessage(
                    topic, type_name, recorded_ns if stamp_ns is None else stamp_ns, payload
                )

    def type_of(self, topic: str) -> str:
        """The type of a topic; empty if the bag lacks it."""
        return next((t.type_name for t in self.topics if t.name == topic), "")

    def first_payload(self, topic: str) -> bytes | None:
        """The first message of a topic, whose type may have no header; None if there is none.

        Raises:
            UserError: the bag is damaged.
        """
        with self._reported(), contextlib.closing(self._payloads((topic,))) as payloads:
            return next((payload for *_, payload in payloads), None)

    def static_transforms(self, reports: Reports) -> StaticTransforms:
        """All transforms of `/tf_static`; empty if the bag lacks this topic. Others are reported.

        Raises:
            UserError: the bag is damaged.
        """
        found = StaticTransforms()
        with self._reported():
            for _, type_name, _, payload in self._payloads((TOPIC,)):
                try:
                    found.take(self.decode.transforms(payload, type_name))
                except (BadImageError, UserError) as error:
                    reports.add(Report.unusable(TOPIC, error))
        return found

    def _without_stamps(self, topics: Collection[str]) -> set[str]:
        """The topics whose headers all have one stamp; reads until all other topics have shown two.

        The only message of a topic lacks a stamp if it is 0.
        """
        counts = {t.name: t.message_count for t in self.topics if t.name in topics}
        unknown = [name for name in counts if name not in self._has_stamps and counts[name]]
        firsts: dict[str, int] = {}
        left = set(unknown)
        with contextlib.closing(self._payloads(unknown)) as payloads:
            for topic, _, _, payload in payloads if unknown else ():
                stamp_ns = self._stamp_ns(payload)
                if stamp_ns is None or topic not in left:
                    continue
                first_ns = firsts.setdefault(topic, stamp_ns if counts[topic] > 1 else 0)
                if stamp_ns != first_ns:
                    left.remove(topic)
                if not left:
                    break
        self._has_stamps |= {topic: topic not in left for topic in unknown}
        return {topic for topic in topics if not self._has_stamps.get(topic, True)}

    def _payloads(
        self, topics: Collection[str]
    ) -> Generator[tuple[str, str, int, bytes], None, None]:
        """Topic, type, time of recording (ns) and bytes of each message of these topics."""
        with self._opened() as reader:
            wanted = [connection for connection in reader.connections if connection.topic in topics]
            if not wanted:
                return
            for connection, recorded_ns, payload in reader.messages(wanted):
                if self._is_ros1 and connection.msgtype == IMAGE:
                    payload = image_without_unit(payload)
                yield connection.topic, connection.msgtype, recorded_ns, payload

    def _opened(self) -> contextlib.AbstractContextManager["Ros1Reader | Ros2Reader"]:
        return self._open() if self._unpacked is None else contextlib.nullcontext(self._unpacked)

    def _open(self) -> "Ros1Reader | Ros2Reader":
        from rosbags.rosbag1 import Reader as Ros1Reader
        from rosbags.rosbag2 import Reader as Ros2Reader

        return Ros1Reader(self._path) if self._is_ros1 else Ros2Reader(self._path)

    def _stamp_ns(self, payload: bytes) -> int | None:
        """Stamp of the header, ns, without decoding the message; None if the message is too short."""
        if len(payload) < _STAMP_AT + _STAMP_BYTES:
            return None
        is_big_endian = not self._is_ros1 and payload[1:2] == b"\0"
        order = ">" if is_big_endian else "<"
        seconds, nanoseconds = struct.unpack_from(f"{order}iI", payload, _STAMP_AT)
        return seconds * 1_000_000_000 + nanoseconds

    @contextlib.contextmanager
    def _reported(self) -> Iterator[None]:
        """Turn each error of rosbags into a `UserError`: damaged bytes raise many kinds of errors.

        A lack of memory and a disk that fails are raised as they are: they may pass.
        """
        try:
            yield
        except (UserError, MemoryError):
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.errno in STORAGE_FAILS:
                raise
            reason = " ".join(str(error).split())[:_LONGEST_REASON] or type(error).__name__
            expected = next((text for part, text in _EXPECTED if part in reason), _WHOLE)
            raise UserError(
                f"source {self.name}: cannot be read: {reason.rstrip('.')}: {expected}"
            ) from None
