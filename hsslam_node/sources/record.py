"""Plain folders of images, `record:FOLDER`, in a module of its own as each source."""

from hsslam_node.sources.files.camera_file import read_record_camera
from hsslam_node.sources.files.image_pairs import ImagePairSource, first_size_px
from hsslam_node.sources.files.record_folder import RecordFolder
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Reports


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
        size = first_size_px(f"record:{name}", pairs)
        given = options.camera.given()
        camera, units = read_record_camera(folder.path / "camera.json", given, size)
        masks = folder.path / "mask"
        super().__init__(f"record:{name}", pairs, camera, units, options, masks)
