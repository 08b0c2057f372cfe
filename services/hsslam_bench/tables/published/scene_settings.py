"""Settings for a data set or a scene from the files of ESLAM and Co-SLAM that differ from their presets.

HS-SLAM has published no files: preset `paper` uses ESLAM's rates and Co-SLAM's boxes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from hsslam_bench.tables.paper_tables import Override
from hsslam_node.presets import PresetName

DataSet = Literal["Replica", "TUM RGB-D", "ScanNet", "none of the paper's"]
Overrides = Mapping[str, Override]


@dataclass(frozen=True)
class SceneSettings:
    """The changes of a preset for a sequence."""

    data_set: DataSet
    overrides: Overrides = field(default_factory=dict)  # "group.field": value
    box: tuple[float, ...] = ()  # in the truth's world, m: low x y z, then high x y z

    @property
    def protocol(self) -> str:
        """The changes in words, to add to the protocol of the options."""
        values = f"; values of {self.data_set}" if self.overrides else ""
        return f"{values}; a box by hand" if self.box else values


# Cell of the meshes, m: "resolution" and "voxel_final" of the files.
_FINE: Final = {"mesher.final_voxel_m": 0.01}
_MIDDLE: Final = {"mesher.final_voxel_m": 0.02}
_COARSE: Final = {"mesher.final_voxel_m": 0.03}

# The originals crop the images, shrink them for TUM, then ignore a border. The border here is the sum:
# 75 + 10 of 640, and (20 + 8) x 1.25 of 640. Rotation rates of the files are for quaternions; here they are
# doubled, for rotation vectors.
_ESLAM_SCANNET: Final = {
    "rendering_tracker.iterations": 30,
    "rendering_tracker.translation_rate": 5e-4,
    "rendering_tracker.rotation_rate": 5e-3,
    "rendering_tracker.border": 85 / 640,
    "mapper.iterations": 30,
    "sampling.free_samples": 48,
    **_MIDDLE,
}
_ESLAM_TUM: Final = {
    "rendering_tracker.translation_rate": 1e-2,
    "rendering_tracker.rotation_rate": 4e-3,
    "rendering_tracker.border": 35 / 640,
    "sampling.free_samples": 48,
    **_FINE,
}

# Weights of SDF and free space as in preset `co-slam`: Co-SLAM takes means over all samples, we take means
# over subsets. TUM: 2 and 3 of 85 samples are in the middle and the tail, 30 in free space; ScanNet: 4, 7
# and 31 of 117.
_CO_SLAM_TUM: Final = {
    "mapper.iterations": 16,
    "ba.iterations": 4,
    "mapper.first_iterations": 1000,
    "rendering_tracker.translation_rate": 1e-2,
    "rendering_tracker.rotation_rate": 1e-2,
    "rendering_tracker.border": 35 / 640,
    "rendering_tracker.color": 1.0,
    "rendering_tracker.sdf_middle": 101.0,
    "rendering_tracker.sdf_tail": 151.0,
    "rendering_tracker.free_space": 0.5,
    "sampling.free_samples": 64,
    "sampling.surface_samples": 21,
    "sampling.surface_reach": 5.0,
    "field.truncation_m": 0.05,
    "weights.color": 1.0,
    "weights.sdf_middle": 101.0,
    "weights.sdf_tail": 151.0,
    "weights.free_space": 0.5,
    "weights.smoothness": 1e-8,
    "mapper.smoothness_vertices": 64,
    "mapper.smoothness_cell_m": 0.04,
    **_COARSE,
}
_CO_SLAM_SCANNET: Final = {
    "mapper.first_iterations": 500,
    "rendering_tracker.border": 30 / 640,
    "rendering_tracker.sdf_middle": 25.0,
    "rendering_tracker.sdf_tail": 44.0,
    "rendering_tracker.free_space": 0.7,
    "sampling.free_samples": 96,
    "sampling.surface_samples": 21,
    "sampling.surface_reach": 2.5,
    "field.hash_finest_cell_m": 0.04,
    "field.hash_table_log2": 14,
    "weights.sdf_middle": 25.0,
    "weights.sdf_tail": 44.0,
    "weights.free_space": 0.7,
    "weights.blind_color": 0.0,
    "weights.smoothness": 1e-3,
    "mapper.smoothness_vertices": 64,
    **_COARSE,
}
_CO_SLAM_TABLES: Final = {"scene0000_00": 16, "scene0059_00": 12, "scene0169_00": 16}  # log2
_SETTINGS: Final[Mapping[PresetName, Mapping[DataSet, Overrides]]] = {
    "realtime": {},
    "paper": {
        "Replica": _FINE,
        "TUM RGB-D": {
            **_ESLAM_TUM,
            "rendering_tracker.iterations": 20,
            "mapper.iterations": 20,
            "weights.smoothness": 1e-8,
        },
        "ScanNet": {**_ESLAM_SCANNET, "weights.smoothness": 1e-3},
        "none of the paper's": _FINE,
    },
    "eslam": {
        "Replica": _FINE,
        "TUM RGB-D": {
            **_ESLAM_TUM,
            "rendering_tracker.iterations": 200,
            "rendering_tracker.pixels": 5000,
            "keyframes.every_frames": 1,
            "mapper.iterations": 60,
            "mapper.rays": 5000,
        },
        "ScanNet": _ESLAM_SCANNET,
        "none of the paper's": _FINE,
    },
    "co-slam": {
        "Replica": _MIDDLE,
        "TUM RGB-D": _CO_SLAM_TUM,
        "ScanNet": _CO_SLAM_SCANNET,
        "none of the paper's": _MIDDLE,
    },
}

# Co-SLAM's boxes, for all presets of publications; ESLAM's are larger. The box of house, by us, is the space
# that its camera sees.
_BOXES: Final[Mapping[str, tuple[float, ...]]] = {
    "room0": (-1.0, -1.3, -1.7, 7.0, 3.7, 1.4),
    "room1": (-5.6, -3.2, -1.6, 1.4, 2.8, 1.8),
    "room2": (-1.0, -3.4, -3.1, 6.1, 1.9, 0.8),
    "office0": (-3.0, -4.0, -2.0, 3.0, 2.5, 2.5),
    "office1": (-2.0, -1.7, -1.2, 3.2, 2.7, 2.0),
    "office2": (-3.6, -3.0, -1.4, 3.2, 5.5, 1.7),
    "office3": (-5.3, -6.1, -1.4, 3.7, 3.4, 2.0),
    "office4": (-1.4, -2.5, -1.4, 5.5, 4.4, 1.8),
    "fr1/desk": (-3.5, -3.0, -3.0, 3.0, 3.0, 3.0),
    "fr2/xyz": (-0.5, -3.5, -0.3, 8.0, 3.0, 3.0),
    "fr3/office": (-6.0, -5.0, -1.0, 6.0, 6.0, 3.0),
    "scene0000_00": (-0.1, -0.1, -0.3, 8.6, 8.9, 3.3),
    "scene0059_00": (-0.3, -0.3, -0.3, 7.4, 9.0, 3.0),
    "scene0106_00": (-0.3, -0.3, -0.3, 9.6, 9.4, 3.5),
    "scene0169_00": (0.5, -0.3, -0.3, 9.1, 7.8, 2.7),
    "scene0181_00": (-0.3, -0.3, -0.3, 8.2, 7.3, 2.8),
    "scene0207_00": (1.0, -0.3, -0.4, 9.3, 7.3, 3.1),
    "house": (-9.6, -5.8, -0.1, 9.6, 3.3, 3.1),
}


def settings_of(preset: PresetName, sequence: str) -> SceneSettings:
    """The changes of `preset` for a sequence, such as room0, fr1/desk, scene0000_00 or house."""
    data_set = _data_set(sequence)
    if preset == "realtime":
        return SceneSettings(data_set)
    overrides = dict(_SETTINGS[preset][data_set])
    if preset == "co-slam" and sequence in _CO_SLAM_TABLES:
        overrides["field.hash_table_log2"] = _CO_SLAM_TABLES[sequence]
    return SceneSettings(data_set, overrides, _BOXES.get(sequence, ()))


def _data_set(sequence: str) -> DataSet:
    if sequence.startswith("scene"):
        return "ScanNet"
    if sequence.startswith("fr") and "/" in sequence:
        return "TUM RGB-D"
    is_replica = sequence[:-1] in ("room", "office") and sequence[-1].isdigit()
    return "Replica" if is_replica else "none of the paper's"
