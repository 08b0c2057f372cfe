"""Unites samples of a gyroscope and of an accelerometer that have stamps of their own."""

from collections import deque

import numpy as np

_KEPT = 512  # samples of each: a second at 400 Hz
_LONGEST_NS = 100_000_000  # between two accelerations: over a longer gap none is known
_SET_BACK_NS = 1_000_000_000  # a sample that is older by more means that the clock was set back

_Sample = tuple[int, np.ndarray]  # stamp, ns; [3]
UnitedSample = tuple[int, np.ndarray, np.ndarray]  # stamp, ns; rad/s [3]; m/s^2 [3]


class UnitedSamples:
    """Gives each sample of the gyroscope the acceleration at its stamp, linear between the two beside it.

    A sample waits for the next acceleration. It is left out if there is none before it, or if the two are
    more than 0.1 s apart. Both sensors have one clock: if one of them shows that it was set back by more than
    a second, all earlier samples are forgotten. Else a sample that is not newer than the last is left out.
    """

    def __init__(self) -> None:
        self._turn_rates: deque[_Sample] = deque(maxlen=_KEPT)  # that wait
        self._forces: deque[_Sample] = deque(maxlen=_KEPT)

    def add_turn_rate(self, stamp_ns: int, turn_rate: np.ndarray) -> list[UnitedSample]:
        """Take a sample [3] rad/s of the gyroscope; returns the samples that are complete now."""
        return self._added(self._turn_rates, (stamp_ns, turn_rate))

    def add_force(self, stamp_ns: int, force: np.ndarray) -> list[UnitedSample]:
        """Take a sample [3] m/s^2 of the accelerometer; returns the samples that are complete now."""
        return self._added(self._forces, (stamp_ns, force))

    def _added(self, samples: deque[_Sample], sample: _Sample) -> list[UnitedSample]:
        newest_ns = max(
            (of[-1][0] for of in (self._turn_rates, self._forces) if of), default=sample[0]
        )
        if newest_ns - sample[0] > _SET_BACK_NS:
            self._turn_rates.clear()
            self._forces.clear()
        if samples and sample[0] <= samples[-1][0]:
            return []
        samples.append(sample)
        return self._complete()

    def _complete(self) -> list[UnitedSample]:
        out = []
        while self._turn_rates and self._forces:
            stamp_ns, turn_rate = self._turn_rates[0]
            if stamp_ns > self._forces[-1][0]:
                break
            self._turn_rates.popleft()
            if (force := self._force_at(stamp_ns)) is not None:
                out.append((stamp_ns, turn_rate, force))
        return out

    def _force_at(self, stamp_ns: int) -> np.ndarray | None:
        after_ns, after = self._forces[-1]
        for before_ns, before in reversed(self._forces):
            if before_ns == stamp_ns:
                return before
            if before_ns < stamp_ns:
                span_ns = after_ns - before_ns
                share = (stamp_ns - before_ns) / span_ns
                return before + share * (after - before) if span_ns <= _LONGEST_NS else None
            after_ns, after = before_ns, before
        return None
