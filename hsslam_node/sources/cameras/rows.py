"""Rows of the plugins of this package; apart from their drivers, which are imported on use."""

from hsslam_node.sources.source_row import SourceRow

ORBBEC = SourceRow(
    kind="orbbec",
    examples=("orbbec", "orbbec:SERIAL"),
    brief="an Orbbec camera on USB (not tried)",
    about="[an Orbbec camera](#orbbec-and-oak-d), not tried on hardware",
    opener="hsslam_node.sources.cameras.orbbec:OrbbecSource",
    camera_options=(),
    is_live=True,
    check="hsslam_node.sources.cameras.orbbec:check_orbbec",
)
OAK = SourceRow(
    kind="oak",
    examples=("oak", "oak:ID"),
    brief="a Luxonis OAK-D camera (not tried)",
    about="[an OAK-D camera](#orbbec-and-oak-d), not tried on hardware",
    opener="hsslam_node.sources.cameras.oak:OakSource",
    camera_options=(),
    is_live=True,
    check="hsslam_node.sources.cameras.oak:check_oak",
)
