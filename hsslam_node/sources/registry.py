"""The sources that the library opens: one row a kind. A new source is a module and a row."""

from hsslam_node.sources.source_row import SourceRow, either, has_names, has_suffix

SOURCES = (
    SourceRow(
        kind="synth",
        examples=(
            *("synth:room", "synth:apartment", "synth:corridor", "synth:person", "synth:chair"),
            "synth:lookalike",
        ),
        brief="built-in scenes",
        about="built-in [scenes](#built-in-scenes), rendered on the fly with exact depth, poses and mesh",
        opener="hsslam_node.sources.synth:SynthSource",
        camera_options=(),
        only_examples=True,
        ground_truth="hsslam_node.sources.synth:synth_truth",
    ),
    SourceRow(
        kind="tum",
        examples=("tum:fr1/desk", "tum:fr2/xyz", "tum:fr3/office", "tum:FOLDER"),
        brief="TUM RGB-D sequences, downloaded if not on disk",
        about="a [TUM RGB-D](#tum-rgb-d-sequences) sequence, downloaded if it is not on disk, or your own "
        "recording in its layout with a `camera.json`",
        opener="hsslam_node.sources.tum:TumSource",
        camera_options=(),
        looks_like=has_names(("rgb.txt", "depth.txt")),
        ground_truth="hsslam_node.sources.tum:tum_truth",
        stamps="hsslam_node.sources.tum:tum_stamps",
    ),
    SourceRow(
        kind="replica",
        examples=("replica:FOLDER",),
        brief="Replica scenes",
        about="Replica, from NICE-SLAM (`cam_params.json`, `results/`) or from vMAP (`room_0/imap/00`)",
        opener="hsslam_node.sources.replica:ReplicaSource",
        camera_options=(),
        looks_like=has_names(("traj.txt", "results"), ("traj_w_c.txt", "rgb", "depth")),
        beside=("cam_params.json", "{name}_mesh.ply"),
        ground_truth="hsslam_node.sources.replica:replica_truth",
    ),
    SourceRow(
        kind="scannet",
        examples=("scannet:FOLDER", "scannet:FILE.sens"),
        brief="ScanNet scenes",
        about="a ScanNet scene, exported (`color/`, `depth/`, `pose/`, `intrinsic/`) or as recorded; the "
        "`.sens` file, or the only one in FOLDER, is read frame by frame",
        opener="hsslam_node.sources.scannet:ScanNetSource",
        camera_options=(),
        looks_like=either(has_names(("color", "depth", "intrinsic")), has_suffix(".sens")),
        beside=("{stem}_vh_clean.ply", "{stem}_vh_clean_2.ply"),
        ground_truth="hsslam_node.sources.scannet:scannet_truth",
    ),
    SourceRow(
        kind="7scenes",
        examples=("7scenes:FOLDER",),
        brief="a sequence of 7-Scenes",
        about="a sequence of [7-Scenes](#7-scenes), such as `redkitchen/seq-01` (`frame-000000.color.png`, "
        "`.depth.png`, `.pose.txt`)",
        opener="hsslam_node.sources.seven_scenes:SevenScenesSource",
        looks_like=has_names(("frame-000000.color.png", "frame-000000.depth.png")),
        ground_truth="hsslam_node.sources.seven_scenes:seven_scenes_truth",
    ),
    SourceRow(
        kind="record",
        examples=("record:FOLDER",),
        brief="images in color/ and depth/",
        about="[two plain folders of images](#a-plain-folder-of-images)",
        opener="hsslam_node.sources.record:RecordSource",
        looks_like=has_names(("color", "depth"), ("rgb", "depth")),
    ),
    SourceRow(
        kind="realsense",
        examples=("realsense",),
        brief="an Intel RealSense camera on USB",
        about="[an Intel RealSense](#intel-realsense) on USB",
        opener="hsslam_node.sources.cameras.realsense:open_realsense",
        camera_options=(),
        only_examples=True,
        is_live=True,
        check="hsslam_node.sources.cameras.realsense:check_realsense",
    ),
)
