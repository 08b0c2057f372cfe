"""Whether a motion that nobody expected is borne out by the two frames that it lies between."""

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.place_recognition.dense_agreement import dense_agreement
from hsslam_node.tracking.tracked_frame import TrackedFrame

_EXPECTED_M, _EXPECTED_RAD = 0.05, 0.05  # from the prediction
_OVERLAP, _CONSISTENCY, _SIMILARITY = 0.25, 0.9, 0.8
_SIMILARITY_AFTER_GAP = 0.9  # without a prediction; poses 10 to 14 cm off reached 0.81 to 0.89


def is_borne_out(
    T_world_cam: np.ndarray, prediction: np.ndarray | None, frame: Frame, last: TrackedFrame,
    T_world_last: np.ndarray,
) -> bool:  # fmt: skip
    """Whether the pose [4, 4] is as predicted, or else agrees with the last good frame as a whole.

    A camera that was carried away, or seen again after a gap, sees surfaces that can be laid on those of
    the map a few centimetres from where it was; the whole images then contradict each other. None: there
    is no prediction that could be trusted.
    """
    if prediction is not None and _is_near(T_world_cam, prediction):
        return True
    least = _SIMILARITY_AFTER_GAP if prediction is None else _SIMILARITY
    agreement = dense_agreement(last.frame, frame, inverse(T_world_last) @ T_world_cam)
    return (
        agreement.overlap >= _OVERLAP
        and agreement.consistency >= _CONSISTENCY
        and agreement.similarity >= least
    )


def _is_near(T_world_cam: np.ndarray, prediction: np.ndarray) -> bool:
    step = inverse(prediction) @ T_world_cam
    turn_rad = np.linalg.norm(so3_log(step[:3, :3]))
    return bool(np.linalg.norm(step[:3, 3]) < _EXPECTED_M and turn_rad < _EXPECTED_RAD)
