"""How a source's camera differs from that of a saved map; apart, as the map loader and the camera ask."""

from hsslam_node.geometry.camera import HasCamera, same_depth_scale


def difference_from_map(name: str, source: HasCamera, keyframes: HasCamera) -> str:
    """The difference between the source of this name and the keyframes of a map, for users; empty: none."""
    if difference := source.camera.differs_in(keyframes.camera):
        field, value, expected = difference
        what = f"source {name} has {value}"
        if field != "size":
            what = f"{field} of source {name} is {value} px"
        return f"{what}: expected {expected}, as in the map"
    units_per_m, expected_units = source.depth_units_per_m, keyframes.depth_units_per_m
    if not same_depth_scale(units_per_m, expected_units):
        told = f"source {name} has {units_per_m:.9g} depth units per metre"
        return f"{told}: expected {expected_units:.9g}, as in the map"
    return ""
