"""Why a run ends: the user, the source, or a failure; apart from the loop, which only acts on it."""

from collections.abc import Collection
from typing import NamedTuple

from hsslam_services.launch.child import Child


class StopReason(NamedTuple):
    """Why a run ends; `is_failure`: neither the source nor the user has ended it."""

    text: str
    is_failure: bool = False


def of_processes(
    children: Collection[Child], pace: str, *, has_source_ended: bool
) -> StopReason | None:
    """The reason by the state of processes and source; None while the run goes on.

    `has_source_ended`: the camera, ours or another, has sent its last frame.
    """
    for child in children:
        if child.state == "failed" and child.spec.is_needed(pace):
            return StopReason(f"{child.spec.name} cannot be kept running", True)
    sources = [child for child in children if child.spec.reads_source]
    if any(child.state == "failed" for child in sources):
        return StopReason("the source cannot be read", True)
    if has_source_ended or any(child.state == "ended" for child in sources):
        return StopReason("end of source")
    return None


def user_error(children: Collection[Child], pace: str) -> str:
    """The error of a needed process that has refused its input; "" if there is none."""
    for child in children:
        if child.user_error and child.spec.can_refuse(pace):
            return child.user_error
    return ""
