"""Plain folders of images, `record:FOLDER`; a source is a file of its own."""

from hsslam_node.errors import UserError
from hsslam_node.sources.files.camera_file import read_record_camera
from hsslam_node.sources.files.image_files import BadImageError, read_any_color, read_any_depth
from hsslam_node.sources.files.image_pairs import ImagePairSource
from hsslam_node.sources.files.record_folder import RecordFolder
from hsslam_node.sources.options import SourceOptions


class RecordSource(ImagePairSource):
    """Colour from `color/` or `rgb/`, depth registered to it from `depth/`, the camera from `camera.json`
    or the options, masks of frames, if there are any, from `mask/`.

    Raises:
        UserError: images or camera are missing, or colour and depth do not belong together.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = RecordFolder.find(name, options.record)
        pairs = folder.pairs
        _, color_file, depth_file = pairs[0]
        try:
            height, width = read_any_color(color_file).shape[:2]
            depth_height, depth_width = read_any_depth(depth_file).shape
        except BadImageError as error:
            raise UserError(f"source record:{name}: first frame: {error}") from None
        if (depth_width, depth_height) != (width, height):
            raise UserError(
                f"{depth_file}: {depth_width}x{depth_height} pixels, colour has {width}x{height}: "
                "expected depth registered to colour (most cameras' software can: 'align to colour')"
            )
        given = options.camera.given()
        camera, units = read_record_camera(folder.path / "camera.json", given, (width, height))
        masks = folder.path / "mask"
        super().__init__(f"record:{name}", pairs, camera, units, options, masks)
