"""Base class of messages, types of their fields, and checks."""

import math
from typing import Annotated, ClassVar, Literal

import msgspec
from msgspec import Meta

from hsslam_proto.frame_order import LARGEST_INDEX

Real = Annotated[float, Meta(ge=-1e30, le=1e30)]  # finite: nan and inf are no readings
Vector = tuple[Real, Real, Real]
Quaternion = tuple[Real, Real, Real, Real]
Index = Annotated[int, Meta(ge=0, le=2**63 - 1)]
FrameIndex = Annotated[int, Meta(ge=0, le=LARGEST_INDEX)]
StampNs = Annotated[int, Meta(ge=0, le=2**63 - 1)]
LARGEST_SIDE_PX = 8192
SizePx = Annotated[int, Meta(ge=1, le=LARGEST_SIDE_PX)]
LONGEST_NAME, MOST_FIGURES = 64, 256
Name = Annotated[str, Meta(max_length=LONGEST_NAME)]
Text = Annotated[str, Meta(max_length=4096)]
Ratio = Annotated[float, Meta(ge=0, le=1)]
Counters = Annotated[dict[Name, Index], Meta(max_length=MOST_FIGURES)]
Covariance = Annotated[list[Real], Meta(max_length=21)]
PoseNumbers = Annotated[list[Real], Meta(max_length=7)]
Inertial = Annotated[list[Real], Meta(max_length=8)]
Direction = Annotated[list[Real], Meta(max_length=3)]
Stamps = Annotated[list[StampNs], Meta(max_length=1024)]
Vectors = Annotated[list[Vector], Meta(max_length=1024)]
StageTimes = Annotated[dict[Name, Real], Meta(max_length=MOST_FIGURES)]
Level = Literal["info", "warning", "error"]


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base of all messages. `MAJOR` grows when an old reader would misread a new message.

    A new optional field does not change the major version: readers ignore unknown fields.
    """

    MAJOR: ClassVar[int] = 1


def expect_bytes(message: Message, name: str, nbytes: int) -> None:
    """Raise ValueError unless the bytes field `name` has `nbytes` bytes."""
    size = memoryview(getattr(message, name)).nbytes
    if size != nbytes:
        raise ValueError(f"{name} has {size} bytes: expected {nbytes}")


def expect_finite(message: Message, *names: str) -> None:
    """Raise ValueError unless these fields are finite numbers."""
    for name in names:
        value = getattr(message, name)
        if not math.isfinite(value):
            raise ValueError(f"{name} = {value}: expected a finite number")


def expect_count(message: Message, name: str, count: int) -> None:
    """Raise ValueError unless the field `name` is empty or has `count` finite numbers."""
    values = getattr(message, name)
    if len(values) not in (0, count):
        raise ValueError(f"{name} has {len(values)} numbers: expected {count} or none")
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{name} = {values}: expected finite numbers")


def expect_pose_numbers(message: Message, name: str) -> None:
    """Raise ValueError unless the field `name` is empty or a pose x, y, z, qx, qy, qz, qw."""
    expect_count(message, name, 7)
    if numbers := getattr(message, name):
        x, y, z, *q = numbers
        expect_pose((x, y, z), (q[0], q[1], q[2], q[3]))


def expect_pose(t: Vector, q: Quaternion) -> None:
    """Raise ValueError unless `t` and `q` are finite and `q` is a unit quaternion xyzw."""
    if not (all(map(math.isfinite, t)) and all(map(math.isfinite, q))):
        raise ValueError(f"pose t = {t}, q = {q}: expected finite numbers")
    norm = math.hypot(*q)
    if abs(norm - 1) > 1e-3:
        raise ValueError(f"pose q has norm {norm:.4f}: expected a unit quaternion xyzw")
