"""The default layout of the viewer (rerun 0.41)."""

import rerun.blueprint as rrb


def blueprint() -> rrb.Blueprint:
    """Default layout: the map in 3D, beside it the camera and the plots."""
    world = rrb.Spatial3DView(
        origin="/world",
        name="Map",
        background=[25, 25, 30],
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(  # behind and above the first camera, looking its way
            position=(1.2, -2.2, -3.2), look_target=(0.0, 0.2, 1.5), eye_up=(0.0, -1.0, 0.0)
        ),
    )
    plots = [
        rrb.TimeSeriesView(origin="/plots", contents=[f"/plots/{name}"], name=title)
        for name, title in (
            ("latency_ms", "Latency, ms"),
            ("fps", "Frames per second"),
            ("quality", "Quality"),
            ("loss", "Loss"),
        )
    ]
    side = rrb.Vertical(
        rrb.Horizontal(
            rrb.Spatial2DView(origin="/world/camera/image", name="Camera"),
            rrb.Spatial2DView(origin="/model", name="Rendered map"),
        ),
        rrb.Tabs(*plots, active_tab=0),
        rrb.TextLogView(origin="/events", name="Events"),
        row_shares=[3, 2.5, 1.5],
    )
    return rrb.Blueprint(
        rrb.Horizontal(world, side, column_shares=[5, 4]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
