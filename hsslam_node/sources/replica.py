"""Sequences in Replica layout."""

from collections.abc import Iterator

from hsslam_node.frame import Frame
from hsslam_node.sources.image_files import BadImageError, read_color, read_depth
from hsslam_node.sources.replica_folder import RATE_HZ, ReplicaFolder
from hsslam_node.sources.source import BadFrame, SourceOptions


class ReplicaSource:
    """A Replica sequence; the layout has no stamps, so frame n is stamped n / 30 s.

    Raises:
        UserError: the folder, its images or its camera are missing or wrong.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = ReplicaFolder.find(name)
        self.camera, self.depth_units_per_m = folder.camera()
        self._pairs = [folder.pairs[i] for i in options.selected(len(folder.pairs))]
        self.name = f"replica:{name}"
        self.rate_hz = RATE_HZ / options.stride
        self.frame_count: int | None = len(self._pairs)

    def frames(self) -> Iterator[Frame | BadFrame]:
        """Every frame number there is; one that cannot be read comes as a `BadFrame`."""
        for index, (stamp_ns, color_file, depth_file) in enumerate(self._pairs):
            try:
                color = read_color(color_file, self.camera)
                depth = read_depth(depth_file, self.camera)
            except BadImageError as error:
                yield BadFrame(index, stamp_ns, str(error))
                continue
            yield Frame(index, stamp_ns, self.camera, color, depth, self.depth_units_per_m)
