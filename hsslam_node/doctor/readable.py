"""Whether images can be read, and are of the camera's size."""

from collections.abc import Sequence

from hsslam_node.doctor.finding import Finding

_FAULT_SHARE = 0.05
_NAME, _EXPECTED = "images", "every image whole and of the camera's size, depth of 16 bit"


def check_readable(read: int, reasons: Sequence[str]) -> Finding:
    """`read`: frames that could be read; `reasons`: one line for each that could not."""
    looked_at = read + len(reasons)
    if not reasons:
        seen = f"all of {looked_at} frames could be read"
        return Finding(_NAME, "ok", 0.0, "%", seen, _EXPECTED)
    share = len(reasons) / looked_at
    seen = f"{len(reasons)} of {looked_at} frames cannot be read; the first: {reasons[0]}"
    severity = "fault" if share > _FAULT_SHARE else "note"
    advice = (
        "frames that cannot be read are skipped: copy or export them again; where all are of another "
        "size, correct width, height and the intrinsics in the camera file"
    )
    return Finding(_NAME, severity, 100 * share, "%", seen, _EXPECTED, advice)
