"""Sequences in TUM layout."""

from hsslam_node.sources.image_pairs import ImagePairSource
from hsslam_node.sources.source import SourceOptions
from hsslam_node.sources.tum_folder import TumFolder


class TumSource(ImagePairSource):
    """A TUM sequence: colour and depth associated within 20 ms, both undistorted.

    Stamps are those of the colour images.

    Raises:
        UserError: the folder, its lists or its camera are missing or wrong.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = TumFolder.find(name)
        super().__init__(f"tum:{name}", folder.pairs, *folder.camera(), options)
