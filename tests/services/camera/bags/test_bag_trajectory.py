"""A recording as a bag has the trajectory that it has as a folder, bit for bit."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import format_stamp
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import Source
from hsslam_services.camera.open_source import open_any_source
from tests.services.camera.bags.room_bags import opened
from tests.services.camera.bags.ros_bags import KINDS, written
from tests.small_room import SMALL, room_frames

_FRAMES = 15
_QUICK = replace(SMALL, mapper=replace(SMALL.mapper, first_iterations=10, iterations=2))


def _write_folder(folder: Path, frames: tuple[Frame, ...]) -> None:
    """The frames in TUM layout."""
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    for frame in frames:
        stamp = format_stamp(frame.stamp_ns)
        for kind, pixels in (("rgb", frame.color[..., ::-1]), ("depth", frame.depth_raw)):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(folder / kind / f"{stamp}.png"), pixels)
            lists[kind].append(f"{stamp} {kind}/{stamp}.png\n")
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text("".join(lines))
    camera, units_per_m = frames[0].camera, frames[0].depth_units_per_m
    size = {"width": camera.width_px, "height": camera.height_px}
    lens = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    fields = {**size, **lens, "distortion": [], "depth_scale": units_per_m}
    (folder / "camera.json").write_text(json.dumps(fields))


def _tracked(source: Source) -> tuple[bytes, bytes, bytes]:
    """Stamps, the poses as they were told, and the final poses."""
    slam = Slam(_QUICK, seed=0)
    results = list(slam.run(source.frames()))
    assert [result.status for result in results] == ["initial"] + ["tracked"] * (_FRAMES - 1)
    assert sum(result.is_keyframe for result in results) >= 3
    told = b"".join(result.T_world_cam.tobytes() for result in results)
    final = slam.trajectory()
    return final.stamps_ns.tobytes(), told, final.T_world_cam.tobytes()


@pytest.fixture(scope="module")
def of_folder(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("recording") / "room"
    _write_folder(folder, room_frames()[:_FRAMES])
    return _tracked(open_any_source(f"tum:{folder}", SourceOptions()))


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_has_the_trajectory_of_the_folder(kind: str, of_folder, tmp_path: Path):
    frames = room_frames()[:_FRAMES]
    bag = opened(written(tmp_path, kind, frames), frames[0].depth_units_per_m)
    assert _tracked(bag) == of_folder
