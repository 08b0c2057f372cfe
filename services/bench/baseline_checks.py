"""Tracking by rendering: the parents' presets on our kernels, and the paper's own."""

import json
import math
from typing import Any

from hsslam_node.presets import PRESETS
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import NotMeasured, Session

_BASELINES = ("eslam", "co-slam")
_OURS = "realtime"
_SEQUENCE, _FRAMES = "house", 100
_SPEED_UP = 20.0
_PAPER_FRAMES = 40  # seven seconds each on one core


def baseline_checks() -> list[Check]:
    """Speed and accuracy beside each of the presets; those of preset paper have no bound."""
    return [*(check for preset in _BASELINES for check in _against(preset)), _paper()]


def _against(preset: str) -> list[Check]:
    def speed(session: Session) -> Measured:
        ours, theirs = _found(session, _OURS), _found(session, preset)
        ratio = ours["fps"] / theirs["fps"]
        return Measured(
            f"{ours['fps']:.1f} against {theirs['fps']:.2f} frames a second: {ratio:.0f} x",
            ratio >= _SPEED_UP,
            {_OURS: ours, preset: theirs, "ratio": ratio},
            ratio,
            "higher",
        )

    def accuracy(session: Session) -> Measured:
        ours, theirs = _found(session, _OURS), _found(session, preset)
        errors = [math.inf if e is None else e for e in (ours["rmse_m"], theirs["rmse_m"])]
        return Measured(
            f"{100 * errors[0]:.2f} against {100 * errors[1]:.2f} cm; "
            f"lost {ours['lost']} and {theirs['lost']}",
            errors[0] <= errors[1],
            {_OURS: ours, preset: theirs},
            errors[0],
            "lower",
        )

    of = f"{_SEQUENCE}, first {_FRAMES} frames, one thread: preset {_OURS} against {preset}"
    return [
        Check(f"baselines:{preset}:fps", f"{of}: speed", f"{_SPEED_UP:g} x", speed),
        Check(f"baselines:{preset}:ate", f"{of}: ATE RMSE, final", "no worse", accuracy),
    ]


def _paper() -> Check:
    def measure(session: Session) -> Measured:
        found = _found(session, "paper", _PAPER_FRAMES)
        return Measured(
            f"{found['fps']:.2f} frames a second, ATE RMSE {100 * found['rmse_m']:.2f} cm, "
            f"lost {found['lost']}",
            None,
            found,
            found["fps"],
            "higher",
        )

    frames = f"{_SEQUENCE}, first {_PAPER_FRAMES} frames"
    return Check("paper", f"{frames}, one thread: preset paper, speed and accuracy", "", measure)


def _found(session: Session, preset: str, frames: int = _FRAMES) -> dict[str, Any]:
    if preset not in PRESETS:
        raise NotMeasured(f"there is no preset {preset}")
    source = session.source(_SEQUENCE)
    module = f"{__package__}.preset_speed"
    return json.loads(session.python(module, preset, source, str(frames)))
