"""Camera trajectories and their text files."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation, Overflow
from pathlib import Path

import numpy as np

from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import transform
from hsslam_node.geometry.se3_batch import quaternions_from_rotations

_TITLE = "# timestamp tx ty tz qx qy qz qw\n"
_LINE = "%s" + 7 * " %.9f" + "\n"  # of the TUM format
_W_FIRST = re.compile(r"\bq\w*w\b.*\bq\w*x\b")  # columns of a quaternion, as EuRoC has them
_LARGEST_STAMP_NS = (1 << 63) - 1
_LINES = 256  # formatted at once: 2.5 x as fast as one by one


@dataclass(frozen=True)
class Trajectory:
    """Stamped camera poses, camera to world, OpenCV axes, metres.

    Raises:
        ValueError: the arrays do not fit together, stamps are not whole numbers of 64 bits (seconds, for
            example), or a pose is not finite.
    """

    stamps_ns: np.ndarray  # [N] int64
    T_world_cam: np.ndarray  # [N, 4, 4] float64

    def __post_init__(self) -> None:
        stamps_ns, poses = np.asarray(self.stamps_ns), np.asarray(self.T_world_cam)
        n = stamps_ns.size
        if stamps_ns.shape != (n,) or poses.shape != (n, 4, 4):
            raise ValueError(
                f"stamps {list(stamps_ns.shape)} and poses {list(poses.shape)}: expected [N] and [N, 4, 4]"
            )
        if n and (stamps_ns.dtype.kind not in "iu" or stamps_ns.max() > _LARGEST_STAMP_NS):
            raise ValueError(
                f"stamps_ns {stamps_ns.dtype}, up to {stamps_ns.max()}: expected whole nanoseconds, int64"
            )
        object.__setattr__(self, "stamps_ns", stamps_ns.astype(np.int64, copy=False))
        object.__setattr__(self, "T_world_cam", poses.astype(np.float64, copy=False))
        is_finite = np.isfinite(self.T_world_cam).all(axis=(1, 2))
        if not is_finite.all():
            raise ValueError(
                f"pose {np.argmin(is_finite)} of {n} is not finite: expected a transform"
            )

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def positions(self) -> np.ndarray:
        """Camera centres, [N, 3] m, world."""
        return self.T_world_cam[:, :3, 3]


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Writes `timestamp tx ty tz qx qy qz qw` lines (s, m, unit quaternion), stamps to the ns.

    The file is on the disk, whole, when this returns.
    """
    write_tum_pieces(path, [trajectory])


def write_tum_pieces(path: Path | str, pieces: Iterable[Trajectory]) -> None:
    """Writes one trajectory as `write_tum` does, piece by piece: only one is in memory."""
    with durable_file(path) as partial, partial.open("w", encoding="ascii") as file:
        file.write(_TITLE)
        for piece in pieces:
            file.writelines(_lines(piece))


def tum_text(trajectory: Trajectory) -> str:
    """The lines of `write_tum`."""
    return "".join([_TITLE, *_lines(trajectory)])


def _lines(trajectory: Trajectory) -> Iterator[str]:
    """Many lines a piece."""
    quaternions = quaternions_from_rotations(trajectory.T_world_cam[:, :3, :3])
    numbers = np.column_stack([trajectory.positions, quaternions])
    for start in range(0, len(trajectory), _LINES):
        stamps_ns = trajectory.stamps_ns[start : start + _LINES].tolist()
        table = np.empty((len(stamps_ns), 8), object)
        table[:, 0] = [format_stamp(stamp_ns) for stamp_ns in stamps_ns]
        table[:, 1:] = numbers[start : start + _LINES]
        yield _LINE * len(table) % tuple(table.ravel().tolist())


def read_tum(path: Path | str) -> Trajectory:
    """Reads a trajectory in TUM format; `#` starts a comment.

    Raises:
        UserError: the file cannot be read, a line is not eight finite numbers, or a comment names the columns
            in another order, as in EuRoC's files.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")  # some editors write a mark first
    except (OSError, UnicodeDecodeError):
        raise UserError(f"{path}: cannot be read: expected a trajectory in TUM format") from None
    stamps, poses = [], []
    for number, line in enumerate(text.splitlines(), 1):
        numbers, _, comment = line.partition("#")
        if _W_FIRST.search(comment):
            raise UserError(
                f"{path}:{number}: {comment.strip()!r}: qw is before qx: expected "
                "'timestamp tx ty tz qx qy qz qw'"
            )
        words = numbers.replace(",", " ").split()
        if not words:
            continue
        try:
            values = np.array([float(w) for w in words[1:]])
            stamps.append(parse_stamp_ns(words[0]))
        except ValueError:
            values = np.array([])
        if values.shape != (7,) or not np.isfinite(values).all() or not values[3:].any():
            raise UserError(
                f"{path}:{number}: {line.strip()!r}: expected 'timestamp tx ty tz qx qy qz qw'"
            )
        poses.append(transform(values[:3], values[3:]))
    return Trajectory(np.array(stamps, np.int64), np.array(poses).reshape(-1, 4, 4))


def by_stamp(poses: Trajectory) -> Trajectory:
    """The poses in the order of their stamps; those of one stamp keep theirs."""
    order = np.argsort(poses.stamps_ns, kind="stable")
    return Trajectory(poses.stamps_ns[order], poses.T_world_cam[order])


def read_estimate(path: Path | str) -> Trajectory:
    """Reads the poses that another program wrote, in TUM format.

    Raises:
        UserError: as of `read_tum`; or a stamp has several poses, so that it is not known which one counts.
    """
    found = read_tum(path)
    in_order = by_stamp(found)
    stamps_ns, poses = in_order.stamps_ns, in_order.T_world_cam
    differs = (poses[1:] != poses[:-1]).any(axis=(1, 2))
    twice = np.flatnonzero((stamps_ns[1:] == stamps_ns[:-1]) & differs)
    if len(twice):
        raise UserError(
            f"{path}: stamp {format_stamp(stamps_ns[twice[0]])} has several poses: expected one"
        )
    return found


def parse_stamp_ns(text: str) -> int:
    """Decimal seconds to nanoseconds, exactly (float64 seconds since 1970 have steps of 240 ns).

    Raises:
        ValueError: not a finite number, or more than int64 holds.
    """
    try:
        stamp_ns = (Decimal(text) * 1_000_000_000).to_integral_value()
        fits = -(2**63) <= stamp_ns < 2**63
    except Overflow:
        fits = False
    except InvalidOperation:  # no number, or nan
        raise ValueError(f"{text!r} is not a time in seconds") from None
    if not fits:  # and may be too long for an `int`
        raise ValueError(f"{text!r}: expected seconds that fit int64 nanoseconds")
    return int(stamp_ns)


def format_stamp(stamp_ns: int) -> str:
    """Nanoseconds as decimal seconds, exactly."""
    sign, magnitude = ("-" if stamp_ns < 0 else ""), abs(int(stamp_ns))
    return f"{sign}{magnitude // 1_000_000_000}.{magnitude % 1_000_000_000:09d}"


def associate(a_ns: np.ndarray, b_ns: np.ndarray, max_dt_ns: int) -> list[tuple[int, int]]:
    """Index pairs of two ascending lists of stamps, closest first, each used once; sorted by a.

    A pair may be exactly `max_dt_ns` apart.
    """
    low = np.searchsorted(b_ns, a_ns - max_dt_ns, side="left")
    high = np.searchsorted(b_ns, a_ns + max_dt_ns, side="right")
    candidates = [
        (abs(int(a_ns[i]) - int(b_ns[j])), i, j)
        for i in range(len(a_ns))
        for j in range(low[i], high[i])
    ]
    used_a, used_b, pairs = set(), set(), []
    for _, i, j in sorted(candidates):
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            pairs.append((i, j))
    return sorted(pairs)
