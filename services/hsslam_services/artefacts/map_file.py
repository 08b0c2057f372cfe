"""Writes the final map, map.safetensors; apart as final map saver and rescue share it."""

from pathlib import Path
from typing import Any

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_services.run.options import ServeOptions


def save_map(
    run_dir: Path, store: KeyframeStore, parameters: FieldParameters, options: ServeOptions
) -> dict[str, Any]:
    """Write the newest published map, unless it is still the loaded map; returns its section of the summary.

    Raises:
        UserError: the file cannot be written.
    """
    if has_changed(store, parameters):
        checkpoint = map_snapshot(store, parameters, options.slam)
        save_checkpoint(run_dir / "map.safetensors", checkpoint)
    return {
        "keyframes": store.count,
        "keyframes_kept": len(store.kept()),
        "model_bytes": parameters.layout.size_bytes_by_part(),
        "map": {"adam_steps": parameters.step},
    }


def has_changed(store: KeyframeStore, parameters: FieldParameters) -> bool:
    """Whether the map is another than the one that was loaded."""
    return store.count > store.inherited or parameters.version > 1
