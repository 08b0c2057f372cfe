"""Events and counters of tracking: lost and found, fragments, a full keyframe store, gravity by the IMU."""

import math

import numpy as np

from hsslam_node.doctor.depth import FILL_HOLES, LEAST_WHOLE
from hsslam_node.errors import UserError
from hsslam_node.map.pose_log import Status
from hsslam_node.sources.reports import Report
from hsslam_node.tracking.tracked_frame import TrackResult, whole_share
from hsslam_proto.frame_order import Place
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker

_MUCH = 0.2  # of the pixels with depth
_REPORTED_ROWS = tuple(10**k for k in range(1, 9))  # unusable frames without a usable one between


class TrackingEvents:
    """Counts results, and reports each change once."""

    def __init__(self, worker: Worker, link: SharedMap) -> None:
        self._worker = worker
        self._link = link
        self._last_status: Status = "initial"
        self._fragment = self._waiting = 0  # newest fragment reported
        self._knows_up = False  # reported
        self._warned: set[str] = set()  # of sensors
        self._heard = -1, -1  # publisher and source_stamp_ns of the frame before
        self._refused = 0  # frames since the last usable one
        self._gone: set[int] = set()  # publishers before that one

    def heard(self, place: Place, source_ns: int) -> None:
        """Check a new frame: it must be of one camera, and its source stamp must grow, as the tracker
        predicts motion by it."""
        before, self._heard = self._heard, (place.publisher, source_ns)
        if before[0] != place.publisher:
            self._gone.add(before[0])
            if place.publisher in self._gone:
                text = (
                    f"frame {place.index} of camera {place.publisher} follows one of camera {before[0]}: "
                    "two cameras send at once: expected one for each --robot"
                )
                self._worker.warn_once(Report("frames of another camera in turn", text))
        elif source_ns <= before[1]:
            text = (
                f"frame {place.index}: source_stamp_ns {source_ns} after {before[1]}: expected a later one; "
                "without it the tracker predicts no motion"
            )
            self._worker.warn_once(Report("frames whose source_stamp_ns did not grow", text))

    def refused(self, index: int, error: UserError) -> None:
        """Report an unusable frame: the first, and the 10th, 100th, ... in a row without a usable one."""
        self._worker.warn_once(Report("unusable frames", f"frame {index} dropped: {error}"))
        self._refused += 1
        if self._refused in _REPORTED_ROWS:
            text = f"{self._refused} frames in a row dropped; the last, frame {index}: {error}"
            self._worker.event("warning", text)

    def take(self, result: TrackResult, depth_raw: np.ndarray) -> None:
        """Count and report the result of a frame; depth_raw [H, W] uint16 of it."""
        self._refused = 0
        self._count(result)
        self._report_fragment(result)
        self._report_status(result, depth_raw)
        self._report_room()
        self._report_wait(result)
        self._report_odometry(result)
        self._report_imu(result)

    def _count(self, result: TrackResult) -> None:
        is_reckoned = result.status == "dead_reckoned"
        self._worker.count("tracked" if is_reckoned else result.status)
        if is_reckoned:
            self._worker.count("by odometry alone")
        self._worker.count("points outside the bound", result.outside)

    def _report_fragment(self, result: TrackResult) -> None:
        if result.fragment > self._fragment:
            self._fragment = result.fragment
            self._worker.count("fragments begun")
            text = f"a new map, fragment {result.fragment}, begins at frame {result.frame_index}"
            self._worker.event("info", text)

    def _report_status(self, result: TrackResult, depth_raw: np.ndarray) -> None:
        before, self._last_status = self._last_status, result.status
        if before == result.status:
            return
        frame = f"frame {result.frame_index}"
        if result.status == "lost":
            self._worker.event("warning", f"lost at {frame}{_holes(depth_raw)}")
        elif result.status == "dead_reckoned":
            self._worker.event(
                "warning", f"{frame} cannot be aligned: from it on, poses come from odometry alone"
            )
        elif before in ("lost", "dead_reckoned"):
            self._worker.event("info", f"tracking again at {frame}")

    def _report_room(self) -> None:
        """Report once that the store is full and tracking goes on with the keyframes so far."""
        store = self._link.store()
        refused = store.room.refused if store is not None else 0
        if refused and not self._worker.counters.get("keyframes without room", 0):
            self._worker.event(
                "warning",
                "no memory for a new keyframe (--memory-gb): tracking continues without it",
            )
        if refused:
            self._worker.counters["keyframes without room"] = refused

    def _report_wait(self, result: TrackResult) -> None:
        """Report once for each fragment that has met the map that it waits for room."""
        store = self._link.store()
        if store is None or not store.room.wanted or result.fragment <= self._waiting:
            return
        self._waiting = result.fragment
        text = (
            f"fragment {result.fragment} waits until the map has room for {store.room.wanted} keyframes: "
            "the mapper removes redundant ones"
        )
        self._worker.event("info", text)

    def _report_odometry(self, result: TrackResult) -> None:
        if result.odometry_disagrees:
            text = (
                "odometry moves unlike the camera, by more than half of its motion: it is not used until it "
                "agrees; check --base-T-camera, its unit and its clock"
            )
            self._warn_of("odometry", text)

    def _report_imu(self, result: TrackResult) -> None:
        """Report once the direction up, and that the IMU or its accelerations are not used."""
        if result.imu_disagrees:
            text = (
                "the IMU is not used: its rotation differs from the camera's; check --camera-T-imu"
            )
            self._warn_of("rotation", text)
        if result.implausible_gravity is not None:
            text = (
                "gravity of the IMU is not used: its mean acceleration is "
                f"{result.implausible_gravity:.2f} m/s^2 (below 0: downwards): expected about 9.81; "
                "check its unit and sign, and that its driver does not remove gravity; for a camera "
                "upside down set --base-T-camera"
            )
            self._warn_of("gravity", text)
        store = self._link.store()
        gravity = store.world_frame.gravity if store is not None and not self._knows_up else None
        if gravity is not None:
            self._knows_up = True
            up = " ".join(f"{part + 0.0:.3f}" for part in gravity.up)
            doubt = f"standard deviation {math.degrees(gravity.sigma_rad):.2f} degrees"
            self._worker.event("info", f"direction up by the IMU: {up}, {doubt}")

    def _warn_of(self, fault: str, text: str) -> None:
        if fault not in self._warned:
            self._warned.add(fault)
            self._worker.event("warning", text)


def _holes(depth_raw: np.ndarray) -> str:
    """Why a lost frame has no depth points although it has depth; "" if it has points, or no depth."""
    known, whole = np.count_nonzero(depth_raw) / depth_raw.size, whole_share(depth_raw)
    if known < _MUCH or whole >= LEAST_WHOLE:
        return ""
    return (
        f": {100 * known:.0f} % of its pixels have depth, but only {100 * whole:.0f} % have depth around "
        f"them: expected {100 * LEAST_WHOLE:.0f} %: {FILL_HOLES}"
    )
