"""Logged frames that a service shall track again."""

import time

import msgspec

from hsslam_node.proto.messages import Frame


def restamped(frame: Frame) -> Frame:
    """The frame as if the sensor took it now, so that latencies are those of the replay; the stamp of
    the source, which goes into trajectories, stays."""
    return msgspec.structs.replace(frame, stamp_ns=time.time_ns())
