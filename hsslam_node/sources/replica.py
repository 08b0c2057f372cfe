"""Sequences in Replica layout."""

from hsslam_node.sources.image_pairs import ImagePairSource
from hsslam_node.sources.replica_folder import RATE_HZ, ReplicaFolder
from hsslam_node.sources.source import SourceOptions


class ReplicaSource(ImagePairSource):
    """A Replica sequence; the layout has no stamps, so frame n is stamped n / 30 s.

    Raises:
        UserError: the folder, its images or its camera are missing or wrong.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = ReplicaFolder.find(name)
        camera, units_per_m = folder.camera()
        super().__init__(f"replica:{name}", folder.pairs, camera, units_per_m, options)
        self.rate_hz = RATE_HZ / options.stride
