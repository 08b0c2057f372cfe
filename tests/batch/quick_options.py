"""Options of hsslam-serve for a run that takes seconds; apart, as several tests share them."""

QUICK = (
    *("--slam.mapper.first-iterations", "40", "--slam.mapper.rays", "256"),
    *("--slam.ba.rays", "256", "--slam.mesher.final-voxel-m", "0.08"),
)
