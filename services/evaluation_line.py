"""What the comparison with ground truth found, in one line for people."""

from collections.abc import Mapping
from typing import Any


def evaluation_line(found: Mapping[str, Any]) -> str:
    """ATE of each trajectory in cm and, where the true mesh is known, distance in cm and completion in %.

    `found`: as `evaluate_run` returns it; what is not known is None there.
    """
    ates_m = {name: ate.get("rmse_m") for name, ate in found.get("ate", {}).items()}
    known = [f"{name} {1e2 * ate_m:.2f} cm" for name, ate_m in ates_m.items() if ate_m is not None]
    line = f"ATE: {', '.join(known)}" if known else "ATE: no poses to compare"
    mesh = found.get("mesh", {})
    off_m, complete = mesh.get("accuracy_mean_m"), mesh.get("completion_ratio_5cm")
    if off_m is not None and complete is not None:
        line += f"; mesh: {1e2 * off_m:.2f} cm off, {1e2 * complete:.1f} % complete within 5 cm"
    return line
