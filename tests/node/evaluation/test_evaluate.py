"""An evaluation draws frames that the map was not made of; it takes no more memory for a long run."""

from collections.abc import Iterator
from weakref import ref

import numpy as np
import pytest

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.evaluation.evaluate import Evaluator, Subject, Wanted
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.sources.options.source import SourceOptions
from tests.small_room import OPTIONS, SMALL, mapped_room, room_frames, room_poses

_COUNT = 30


class _LongSource:
    """Thirty frames, as every tenth of a long run; it knows how many of them were in memory at once."""

    name, rate_hz, depth_units_per_m = "long", 3.0, 1000.0
    camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)

    def __init__(self) -> None:
        self.frame_count: int | None = _COUNT
        self.most_alive = 0

    def frames(self, first: int = 0) -> Iterator[Frame]:
        made = []
        grey, wall = np.full((48, 64, 3), 99, np.uint8), np.full((48, 64), 2000, np.uint16)
        for n in range(first, _COUNT):
            frame = Frame(n, n, self.camera, grey, wall, self.depth_units_per_m)
            made.append(ref(frame))
            self.most_alive = max(self.most_alive, sum(one() is not None for one in made))
            yield frame


def test_consistency_keeps_no_more_frames_than_the_largest_gap_needs():
    source = _LongSource()
    trajectory = Trajectory(np.arange(_COUNT), np.tile(np.eye(4), (_COUNT, 1, 1)))
    subject = Subject("long", SourceOptions(), {"final": trajectory}, open_it=lambda *_: source)
    found = Evaluator(subject, Wanted()).evaluate().figures["consistency"]["estimated"]
    assert [gap.pairs for gap in found] == [_COUNT - 1, _COUNT - 3, _COUNT - 10]
    assert source.most_alive <= 13  # eleven, and those that are handed on


@pytest.mark.parametrize(
    ("retired", "images"), [((), 6), ((10, 30), 4), ((*range(0, 40, 5), 17), 5)]
)
def test_images_are_of_frames_that_were_never_keyframes(tmp_path, retired, images):
    """Every fifth of forty, or those between if all of them were keyframes; the map has every fourth."""
    room, path = mapped_room(), tmp_path / "map.safetensors"
    save_checkpoint(path, map_snapshot(room.store, room.parameters, SMALL))
    final = Trajectory(np.array([f.stamp_ns for f in room_frames()]), room_poses())
    rows = sorted({*range(0, 40, 4), *retired})
    keyframes = Trajectory(final.stamps_ns[rows], final.T_world_cam[rows])
    trajectories = {"final": final, "keyframes": keyframes}
    subject = Subject("synth:room", OPTIONS, trajectories, map=path, slam=SMALL)
    found = Evaluator(subject, Wanted(views=True, consistency=False)).evaluate().figures
    assert found["rendering"].images == found["views"].images == images
    assert found["rendering"].psnr_db > 15 and found["views"].psnr_db > 15
    alone = Evaluator(subject, Wanted(consistency=False)).evaluate().figures
    assert alone["rendering"] == found["rendering"] and "views" not in alone
