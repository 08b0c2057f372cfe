"""Stamps as they were recorded, of colour and of depth."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.sources.tum_folder import MAX_DT_NS, TumFolder


@dataclass(frozen=True)
class RecordedStamps:
    """Stamps [N], [M] int64 ns in the order of the recording; `depth_ns` is None where both share one."""

    color_ns: np.ndarray
    depth_ns: np.ndarray | None = None
    max_dt_ns: int = MAX_DT_NS  # further apart, colour and depth are not put together


def recorded_stamps(spec: str) -> RecordedStamps | None:
    """All stamps of a sequence in TUM layout, from its lists; None of a source that has no lists.

    Raises:
        UserError: the folder or its lists are missing or malformed.
    """
    kind, _, name = spec.partition(":")
    if kind != "tum" or not name:
        return None
    folder = TumFolder.find(name)
    return RecordedStamps(
        folder.listed_stamps("rgb.txt"), folder.listed_stamps("depth.txt"), MAX_DT_NS
    )
