"""The outcome of one attempt at a log: a row of the results, and whether the log may be tried again."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal

import msgspec

Kind = Literal[
    "done", "bad input", "crash", "timeout", "memory", "out of memory", "lost", "unavailable"
]


class Outcome(msgspec.Struct, frozen=True):
    """One attempt; the last attempt at a log is its row in `runs.parquet`. None: not known.

    `reason`: one line if it failed. `kind`: `bad input` (exit code 2), `crash` (another code or a signal),
    `timeout`, `memory` (it used more than the limit), `out of memory` (its machine had none left),
    `lost` (its machine or worker died), `unavailable` (a store or a disk failed, so that the log could not be
    fetched or its result not written).
    """

    id: str
    name: str
    configuration: str
    attempt: int
    kind: Kind
    reason: str = ""
    exit_code: int | None = None
    node: str = ""
    code: str = ""
    retries: int = 0  # most attempts after the first, of the command that made this one
    started_ns: int = 0  # wall clock
    fetch_s: float = 0.0  # to fetch the log, if it is in a store
    wall_s: float = 0.0  # of the run
    core_s: float = 0.0  # user and system time of all processes
    memory_mb: int = 0  # peak of all processes together (PSS)
    nbytes: int = 0  # of the run folder
    log_s: float = 0.0  # from the first frame to the last, sensor clock
    frames: int = 0
    tracked: int = 0
    lost: int = 0
    keyframes: int | None = None
    ate_m: float | None = None  # RMSE of the final trajectory, if there is a ground truth
    mesh_faces: int | None = None
    mesh_accuracy_m: float | None = None  # mean distance from the true mesh, if there is one
    mesh_completion: float | None = None  # share of the true mesh within 5 cm of it

    @property
    def is_done(self) -> bool:
        """Whether the results count."""
        return self.kind == "done"

    @property
    def failure(self) -> str:
        """Why the attempt failed, in one line."""
        return f"{self.name}: {self.kind}: {self.reason}"

    @property
    def is_left(self) -> bool:
        """Whether the command that made this attempt makes a further one, or the next `run` does: a store
        that failed says nothing about the log."""
        return self.kind == "unavailable" or may_try_again(self, self.retries)


class Frames(msgspec.Struct, frozen=True, tag="frames"):
    """Progress of an attempt, as a line of JSON."""

    frames: int


class Ended(msgspec.Struct, frozen=True, tag="ended"):
    """The end of an attempt, as a line of JSON."""

    outcome: Outcome


class Refused(msgspec.Struct, frozen=True, tag="refused"):
    """No attempt was made, as code or log differ from the plan; a line of JSON."""

    reason: str


class Unavailable(msgspec.Struct, frozen=True, tag="unavailable"):
    """The attempt has no outcome, as the folder or the store of the batch fails; a line of JSON."""

    reason: str


Line = Frames | Ended | Refused | Unavailable
"""What `hsslam-batch work --json` prints."""


def may_try_again(outcome: Outcome, retries: int) -> bool:
    """Whether a failed log gets one more attempt; `retries`: most attempts after the first.

    Bad input and a run above its limit of memory fail again, so they get none; a time-out gets one.
    """
    most = {
        "crash": retries,
        "out of memory": retries,
        "lost": retries,
        "unavailable": retries,
        "timeout": min(1, retries),
    }
    return outcome.attempt <= most.get(outcome.kind, 0)


NOT_EVALUATED = "not evaluated: "
"""Beginning of the reason of a log that is done, but has no scores."""
ENDS: Mapping[str, int] = MappingProxyType({"done": 0, "bad input": 2})
"""Exit code of `hsslam-batch work` by kind; all others 3."""


def encoded(outcome: Outcome) -> bytes:
    """The row as the content of a JSON file."""
    return msgspec.json.format(msgspec.json.encode(outcome))


def figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an outcome that `summary.json` of a run has."""
    frames, evaluation = summary.get("frames", {}), summary.get("evaluation", {})
    return {
        "log_s": summary.get("sensor_s", 0.0),
        "frames": frames.get("in", 0),
        "tracked": frames.get("tracked", 0),
        "lost": frames.get("lost", 0),
        "keyframes": summary.get("keyframes"),
        "ate_m": evaluation.get("ate", {}).get("final", {}).get("rmse_m"),
        "mesh_faces": summary.get("mesh", {}).get("faces"),
        "mesh_accuracy_m": evaluation.get("mesh", {}).get("accuracy_mean_m"),
        "mesh_completion": evaluation.get("mesh", {}).get("completion_ratio_5cm"),
    }
