"""Results that no saver can save, as they were never in the arena: fragments, and messages of the log."""

from pathlib import Path

from hsslam_services.artefacts.fragment_names import FRAGMENTS_NOT_SAVED
from hsslam_services.run.process_result import read_result
from hsslam_services.run.summary import read_summary

POSES_NOT_LOGGED = "poses not logged"  # counter of the tracker, and in its summary
# counter of the recorder: messages refused, and a disk that is not written
LOG_FAILURES = "log failures"
LOST_FOREVER = frozenset({"log", "fragments", "poses"})  # of the names in `not_saved`


def lost_results(run_dir: Path) -> dict[str, str]:
    """All of them, by name, with the reason: of a run whose supervisor did not judge them."""
    lost = {"poses": lost_poses(run_dir), "fragments": lost_fragments(run_dir)}
    if any(run_dir.glob("run*.mcap")):
        lost["log"] = unfinished_log(run_dir)
    return {name: why for name, why in lost.items() if why}


def lost_poses(run_dir: Path, counted: int = 0) -> str:
    """How many poses the pose log had no memory for; empty if none. `counted`: by the last heartbeat."""
    by_result = read_result(run_dir, "tracker").summary.get(POSES_NOT_LOGGED, 0)
    count = max(counted, by_result)
    return f"{count} are missing in the trajectories, as the memory was full: lost" if count else ""


def lost_fragments(run_dir: Path) -> str:
    """Which fragments of all map epochs have neither joined nor a file, and why; empty if none."""
    results = [read_result(run_dir, name).summary for name in ("trajectory_saver", "tracker")]
    begun, why = {}, {}
    for section in (read_summary(run_dir), *results):
        begun |= section.get("fragments", {})
        why |= {str(n): text for n, text in section.get(FRAGMENTS_NOT_SAVED, {}).items()}
    lost = {n: "" for n, each in begun.items() if not each["joined"] and "map" not in each} | why
    if not lost:
        return ""
    each = (f"fragment {n}: {text or 'its tracker ended before'}" for n, text in lost.items())
    return f"{'; '.join(each)}: lost"


def unfinished_log(run_dir: Path, recorder_error: str = "", failures: int = 0) -> str:
    """Why the log is not complete, by the recorder's result, its failure and the failures that it and its
    predecessors counted; empty if it is complete."""
    log = read_result(run_dir, "recorder").summary.get("log", {})
    if recorder_error:
        why = recorder_error
    elif not log:
        why = "not finished"
    elif error := log.get("sync_error"):
        why = f"the disk could not be written ({error}), and some messages may be lost"
    elif lost := log.get("lost"):
        each = ", ".join(f"{count} of {topic}" for topic, count in lost.items())
        why = f"messages are lost, as the recorder was too slow or was away: {each}"
    elif not log["complete"] or failures:
        why = "the disk was full or could not be written, and some messages are lost"
    else:
        return ""
    helps = f"; run hsslam-log recover {run_dir} to make the written part readable"
    return why + helps if any(run_dir.glob("run*.mcap")) else why
