"""Plain folders of images, `record:FOLDER`."""

from collections.abc import Sequence

from hsslam_node.errors import UserError
from hsslam_node.sources.files.camera_file import read_record_camera
from hsslam_node.sources.files.image_files import BadImageError, read_any_color, read_any_depth
from hsslam_node.sources.files.image_pairs import ImagePair, ImagePairSource
from hsslam_node.sources.files.record_folder import RecordFolder
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Reports

_MOST_BROKEN = 30  # pairs before the first that can be used


class RecordSource(ImagePairSource):
    """Colour from `color/` or `rgb/`, depth registered to it from `depth/`, the camera from `camera.json`
    or the options, masks of frames, if there are any, from `mask/`.

    Raises:
        UserError: images or camera are missing, or colour and depth do not belong together.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = RecordFolder.find(name, options.record)
        pairs = folder.pairs
        self.reports = Reports()
        folder.report_pairs(self.reports)
        size = _size_px(f"record:{name}", pairs)
        given = options.camera.given()
        camera, units = read_record_camera(folder.path / "camera.json", given, size)
        masks = folder.path / "mask"
        super().__init__(f"record:{name}", pairs, camera, units, options, masks)


def _size_px(source: str, pairs: Sequence[ImagePair]) -> tuple[int, int]:
    """Width and height of the first usable pair; without one, raises the fault of the first pair."""
    problem: UserError | None = None
    for _, color_file, depth_file in pairs[:_MOST_BROKEN]:
        try:
            height, width = read_any_color(color_file).shape[:2]
            depth_height, depth_width = read_any_depth(depth_file).shape
        except BadImageError as error:
            problem = problem or UserError(f"source {source}: first frame: {error}")
            continue
        if (depth_width, depth_height) == (width, height):
            return width, height
        problem = problem or UserError(
            f"{depth_file}: {depth_width}x{depth_height} pixels, colour has {width}x{height}: "
            "expected depth registered to colour (most cameras' software can: 'align to colour')"
        )
    assert problem is not None, "a folder has one pair at least"
    raise problem
