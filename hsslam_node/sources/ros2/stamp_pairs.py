"""Pairs colour and depth that come one by one, by their stamps."""

import math
from collections import deque
from itertools import pairwise
from statistics import median
from typing import Generic, Protocol, TypeVar

from hsslam_node.sensor_watch import STEP_BACK_S

_LEAST_LIMIT_NS = 20_000_000  # as for TUM; above half of the time between images at 30 Hz
_OF_STEP = 0.6  # half of a step, and some jitter
_KEPT = 16
_KEPT_NS, _KEPT_BYTES = 10**9, 2**26  # what may wait beyond those
_STEPS = 16  # images whose distances in time give the usual one
_STEP_BACK_NS = int(1e9 * STEP_BACK_S)


class Stamped(Protocol):
    """An image, decoded or not."""

    @property
    def stamp_ns(self) -> int: ...

    @property
    def nbytes(self) -> int: ...


T = TypeVar("T", bound=Stamped)


class StampPairs(Generic[T]):
    """Returns a pair as soon as an image has a counterpart within `limit_ns` that is at most half the
    time between two images away: no nearer one can come. Images older than a returned pair are dropped, also
    if they come after it, so pairs come in order; only a step back of more than 1 s begins anew. Of each
    kind the newest `kept` images wait for their counterpart, and more, up to 1 s, if they fit into 64 MiB.

    max_dt_ns: the limit. None: 20 ms, or more if images come more rarely than at 30 Hz, so that those of a
    camera without a common trigger have a counterpart, but not that of the image before or after.

    For the operator: `nearest_ns` is the least distance of two images that are too far apart; since the last
    pair, `unpaired_nearest_ns` is this distance, and `unpaired` the numbers of colour and depth images.
    """

    def __init__(self, max_dt_ns: int | None, kept: int = _KEPT) -> None:
        self._max_dt_ns = max_dt_ns
        self._kept = kept
        self._color: deque[T] = deque()
        self._depth: deque[T] = deque()
        self._color_steps, self._depth_steps = _Steps(), _Steps()
        self._paired_ns: tuple[float, float] = (-math.inf, -math.inf)  # stamps of the last pair
        self._late = 0
        self.nearest_ns: int | None = None
        self.unpaired_nearest_ns: int | None = None
        self.unpaired = (0, 0)

    def add_color(self, image: T) -> tuple[T, T] | None:
        """(this colour image, its depth image), if it has come."""
        self._forget_before_step_back(image.stamp_ns, self._color_steps)
        self._color_steps.add(image.stamp_ns)
        self.unpaired = (self.unpaired[0] + 1, self.unpaired[1])
        if self._is_late(image.stamp_ns, self._paired_ns[0]):
            return None
        depth = self._counterpart(image, self._color, self._depth, self._depth_steps)
        return None if depth is None else self._pair(image, depth)

    def add_depth(self, image: T) -> tuple[T, T] | None:
        """(its colour image, this depth image), if it has come."""
        self._forget_before_step_back(image.stamp_ns, self._depth_steps)
        self._depth_steps.add(image.stamp_ns)
        self.unpaired = (self.unpaired[0], self.unpaired[1] + 1)
        if self._is_late(image.stamp_ns, self._paired_ns[1]):
            return None
        color = self._counterpart(image, self._depth, self._color, self._color_steps)
        return None if color is None else self._pair(color, image)

    @property
    def limit_ns(self) -> int:
        """The largest time between the images of a pair, ns."""
        if self._max_dt_ns is not None:
            return self._max_dt_ns
        step_ns = min(self._color_steps.short_ns, self._depth_steps.short_ns)
        return (
            _LEAST_LIMIT_NS
            if math.isinf(step_ns)
            else max(_LEAST_LIMIT_NS, round(_OF_STEP * step_ns))
        )

    def take_late(self) -> int:
        """Images since the last call that came after a pair of newer ones, and were dropped."""
        late, self._late = self._late, 0
        return late

    def _is_late(self, stamp_ns: int, paired_ns: float) -> bool:
        is_late = paired_ns - _STEP_BACK_NS <= stamp_ns < paired_ns
        self._late += is_late
        return is_late

    def _pair(self, color: T, depth: T) -> tuple[T, T]:
        self._paired_ns = color.stamp_ns, depth.stamp_ns
        self.unpaired, self.unpaired_nearest_ns = (0, 0), None
        return color, depth

    def _forget_before_step_back(self, stamp_ns: int, steps: "_Steps") -> None:
        """Forget images from before a clock was set back, or a simulation began again, else they would pair
        with later ones."""
        if stamp_ns < steps.last_ns - _STEP_BACK_NS:
            for images, own in ((self._color, self._color_steps), (self._depth, self._depth_steps)):
                if own.last_ns > stamp_ns + _STEP_BACK_NS:
                    images.clear()
                    own.clear()

    def _counterpart(self, image: T, same: deque[T], others: deque[T], steps: "_Steps") -> T | None:
        found = min(others, key=lambda o: abs(o.stamp_ns - image.stamp_ns), default=None)
        if found is None or abs(found.stamp_ns - image.stamp_ns) > self.limit_ns:
            if found is not None:
                apart_ns = abs(found.stamp_ns - image.stamp_ns)
                self.nearest_ns = min(apart_ns, self.nearest_ns or apart_ns)
                self.unpaired_nearest_ns = min(apart_ns, self.unpaired_nearest_ns or apart_ns)
            self._keep(image, same)
            return None
        if 2 * abs(found.stamp_ns - image.stamp_ns) > steps.usual_ns:
            self._keep(image, same)  # its counterpart may be on its way
            return None
        _forget_until(others, found.stamp_ns)
        _forget_until(same, image.stamp_ns)
        return found

    def _keep(self, image: T, images: deque[T]) -> None:
        images.append(image)
        while len(images) > self._kept and _is_too_much(images):
            images.popleft()


def _is_too_much(images: deque[T]) -> bool:
    """Whether they span more than 1 s, or have more than 64 MiB."""
    stamps = [image.stamp_ns for image in images]
    return max(stamps) - min(stamps) > _KEPT_NS or sum(i.nbytes for i in images) > _KEPT_BYTES


def _forget_until(images: deque[T], stamp_ns: int) -> None:
    kept = [image for image in images if image.stamp_ns > stamp_ns]
    images.clear()
    images.extend(kept)


class _Steps:
    """The times between the last images of a topic."""

    def __init__(self) -> None:
        self._stamps_ns: deque[int] = deque(maxlen=_STEPS)

    def add(self, stamp_ns: int) -> None:
        self._stamps_ns.append(stamp_ns)

    def clear(self) -> None:
        self._stamps_ns.clear()

    @property
    def last_ns(self) -> float:
        """The last stamp; minus infinity before the first."""
        return self._stamps_ns[-1] if self._stamps_ns else -math.inf

    @property
    def usual_ns(self) -> float:
        """The median time, as images may be missing or late; infinite before two have come."""
        steps = self._steps_ns()
        return median(steps) if steps else math.inf

    @property
    def short_ns(self) -> float:
        """As `usual_ns`, of the lower quartile: also if half of the images are lost, the time of one step."""
        steps = self._steps_ns()
        return sorted(steps)[len(steps) // 4] if steps else math.inf

    def _steps_ns(self) -> list[int]:
        return [abs(b - a) for a, b in pairwise(self._stamps_ns) if a != b]
