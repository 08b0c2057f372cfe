"""Accuracy of the poses of several runs, as most rows judge it."""

from dataclasses import dataclass
from statistics import fmean
from typing import Any

from hsslam_node.services.bench.serve_run import ServeRun


@dataclass(frozen=True)
class Accuracy:
    """ATE RMSE of the final trajectory by run, and what of the truth it is over."""

    errors_m: list[float]
    counts: list[tuple[int, int]]  # frames scored, frames that have a true pose
    lost: int

    @classmethod
    def of(cls, runs: list[ServeRun]) -> "Accuracy":
        """Read off the summaries of the runs."""
        lost = sum(run.summary["frames"].get("lost", 0) for run in runs)
        return cls([ate_m(run) for run in runs], [scored(run) for run in runs], lost)

    @property
    def mean_m(self) -> float:
        """Mean of the runs."""
        return fmean(self.errors_m)

    @property
    def complete(self) -> bool:
        """Whether every frame is scored and none was lost."""
        return self.lost == 0 and all(n == expected and n > 0 for n, expected in self.counts)

    def each_cm(self, digits: int = 2) -> str:
        """The runs one by one."""
        return ", ".join(f"{100 * e:.{digits}f}" for e in self.errors_m)

    def values(self, bound_m: float) -> dict[str, Any]:
        """What the result file keeps."""
        return {
            "rmse_m": self.errors_m, "scored": self.counts, "lost": self.lost, "bound_m": bound_m
        }  # fmt: skip


def ate_m(run: ServeRun) -> float:
    """ATE RMSE of the final trajectory, m; infinite where there is none."""
    value = _final(run).get("rmse_m")
    return float("inf") if value is None else float(value)


def scored(run: ServeRun) -> tuple[int, int]:
    """Frames that the ATE is over, and frames that have a true pose."""
    final = _final(run)
    return final.get("scored", 0), final.get("expected", 0)


def _final(run: ServeRun) -> dict[str, Any]:
    return run.summary.get("evaluation", {}).get("ate", {}).get("final", {})
