"""The row that every command reads; a separate module, so that `--help` imports no driver."""

from hsslam_node.sources.source_row import SourceRow, has_files

ROW = SourceRow(
    kind="npz",
    examples=("npz:FOLDER",),
    brief="frames saved with NumPy",
    about="frames saved with NumPy, one `.npz` each, with `camera.json`",
    opener="hsslam_npz.source:NpzSource",
    looks_like=has_files("*.npz"),
)
