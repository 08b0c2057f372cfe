"""The built-in source `synth:room`."""

from hsslam_node.errors import UserError
from hsslam_node.sources.source import SourceOptions


class SynthRoom:
    """A procedural room."""

    def __init__(self, options: SourceOptions) -> None:
        raise UserError("source synth:room: not built yet")


def synth_room_truth(options: SourceOptions):
    """Exact trajectory and mesh."""
    raise UserError("source synth:room: not built yet")
