"""Rows of the gain of a texture in an exported mesh, all measured only by name."""

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import finished
from hsslam_bench.runs.session import Session

_SEQUENCES = ("livingroom", "kitchen")
_HELD = "livingroom"
_GAIN_DB, _SECONDS = 3.0, 60.0
_MODULE = "hsslam_bench.scripts.texture_quality"


def texture_checks() -> list[Check]:
    """One check for each sequence."""
    return [_texture_check(sequence) for sequence in _SEQUENCES]


def _texture_check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        run = finished(session.mapped(sequence))
        found = session.figures(_MODULE, str(run.folder), session.source(sequence))
        gain_db = found["texture_db"] - found["vertices_db"]
        met = gain_db >= _GAIN_DB and found["seconds"] <= _SECONDS
        return Measured(
            f"{found['texture_db']:.1f} dB, {found['vertices_db']:.1f} dB with colours of vertices, "
            f"{found['views']} views; {found['seconds']:.0f} s, {found['triangles']} triangles, "
            f"{found['megabytes']:.1f} MB",
            met if sequence == _HELD else None,
            found,
            gain_db,
            "higher",
        )

    what = (
        f"{sequence}, lockstep: hsslam-map export --format glb --texture: PSNR of every eighth frame that is "
        "no keyframe, drawn from the mesh at the run's pose where it has the frame's depth to 3 cm, its "
        "brightness fitted by one factor; the same without --texture; time of the command"
    )
    bound = f"{_GAIN_DB:g} dB more; {_SECONDS:g} s" if sequence == _HELD else ""
    return Check(f"texture:{sequence}", what, bound, measure, by_name_only=True)
