"""The figures of an evaluation as printed tables: cm, mm, degrees, %, dB."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table

_PROTOCOLS = {"mesh": "exact", "mesh_literature": "lit."}


def eval_table(figures: Mapping[str, Any]) -> list[Table]:
    """One table for each group of figures present; `figures` as in the JSON file."""
    made = (_trajectories(figures), _meshes(figures), _rendering(figures), _consistency(figures))
    return [table for table in made if table is not None]


def _trajectories(figures: Mapping[str, Any]) -> Table | None:
    if "ate" not in figures:
        return None
    table = Table(title=f"trajectory: {_origin(figures)}", title_justify="left")
    for name in ("", "ATE", "mean", "max", "scored", "RPE frame", "RPE 1 s", "RPE 1 m"):
        table.add_column(name, justify="right" if name else "left", no_wrap="RPE" not in name)
    for label, ate in figures["ate"].items():
        rpe = figures["rpe"][label]
        table.add_row(
            label,
            *(_number(ate[key], 100, 2) for key in ("rmse_m", "mean_m", "max_m")),
            f"{ate['scored']}/{ate['expected']}",
            *(
                f"{_number(rpe[step]['translation_rmse_m'], 100, 2)} / "
                f"{_number(rpe[step]['rotation_rmse_deg'], 1, 3)}"
                for step in ("frame", "second", "metre")
            ),
        )
    lost = figures.get("frames", {}).get("lost")
    units = "ATE: RMSE, cm; RPE: RMSE, cm / degrees"
    table.caption = units if lost is None else f"{units}; {lost} frames lost"
    return table


def _meshes(figures: Mapping[str, Any]) -> Table | None:
    """A row for each mesh and protocol; the rows of the exact protocol have the depth error, too."""
    scored = {"ours": figures, **figures.get("tsdf", {})}
    lines = [
        (name, protocol, found[key], found.get("depth_l1", {}) if key == "mesh" else {})
        for name, found in scored.items()
        for key, protocol in _PROTOCOLS.items()
        if key in found
    ]
    if not lines:
        return None
    table = Table(title="mesh", title_justify="left")
    for name in ("", "by"):
        table.add_column(name, no_wrap=True)
    for name in (
        *("accuracy mean / median, cm", "< 5 cm, %", "completion mean / median, cm"),
        *("< 5 cm, %", "depth L1, cm", "holes, %"),
    ):
        table.add_column(name, justify="right")
    table.caption = "exact: our protocol; lit.: that of the literature (--help)"
    for name, protocol, mesh, depth in lines:
        accuracy, completion = (
            f"{_number(mesh[f'{kind}_mean_m'], 100, 2)} / "
            f"{_number(mesh[f'{kind}_median_m'], 100, 2)}"
            for kind in ("accuracy", "completion")
        )
        table.add_row(
            name,
            protocol,
            accuracy,
            _number(mesh["accuracy_ratio_5cm"], 100, 2),
            completion,
            _number(mesh["completion_ratio_5cm"], 100, 2),
            _number(depth.get("mean_m"), 100, 2),
            _number(depth.get("hole_ratio"), 100, 2),
        )
    return table


def _rendering(figures: Mapping[str, Any]) -> Table | None:
    ways = {"field alone": figures.get("rendering"), "hsslam-render": figures.get("views")}
    if not any(ways.values()):
        return None
    names = ("", "PSNR, dB", "SSIM", "pixels rendered, %", "images")
    table = Table(*names, title="rendering of frames that are not keyframes", title_justify="left")
    for way, found in ways.items():
        if found:
            table.add_row(
                way,
                _number(found["psnr_db"], 1, 2),
                _number(found["ssim"], 1, 3),
                _number(found["pixels_ratio"], 100, 1),
                str(found["images"]),
            )
    return table


def _consistency(figures: Mapping[str, Any]) -> Table | None:
    found = figures.get("consistency")
    if not found:
        return None
    table = Table(
        "frames apart", title="consistency between frames: depth, grey", title_justify="left"
    )
    for whose in found:
        table.add_column(f"{whose}: mm", justify="right")
        table.add_column("1 - NCC", justify="right")
        table.add_column("pairs", justify="right")
    table.caption = "pairs: scored / possible; frames with the worst poses form no pairs"
    for row in zip(*found.values(), strict=True):
        cells = [str(row[0]["gap_frames"])]
        for one in row:
            cells += [_number(one["depth_median_m"], 1000, 1), _number(one["one_minus_ncc"], 1, 3)]
            cells.append(f"{one['pairs']}/{one['possible']}")
        table.add_row(*cells)
    return table


def _origin(figures: Mapping[str, Any]) -> str:
    """Source, preset, seed and commit, as far as they are known."""
    parts = [str(figures.get("source", ""))]
    if figures.get("noise") not in (None, "none"):
        parts.append(f"{figures['noise']} noise")
    known = [key for key in ("preset", "seed", "commit") if figures.get(key, "") != ""]
    parts += [f"{key} {figures[key]}" for key in known]
    return ", ".join(parts)


def _number(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"
