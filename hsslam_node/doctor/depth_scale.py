"""Whether depth is in metres, told by the sensor's own quantisation."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.depth_step import find_depth_step
from hsslam_node.doctor.finding import Finding
from hsslam_node.geometry.camera import Camera

# Kinect, Xtion and their kin: eighths of a pixel, 580 pixels focal length, 7.5 cm between projector and
# camera: 1 / (8 * 580 * 0.075 m) (Khoshelham and Elberink, Sensors 2012).
_KINECT_STEP_PER_M = 0.00287
_TOLERANCE = 1.3  # the Structure sensor has 1.17 of that
_KINECT_FOCAL_PER_WIDTH = (0.76, 0.94)
_KINECT_ASPECT = 4 / 3
_USUAL_UNITS = (1000.0, 4000.0, 5000.0, 6553.5, 10000.0)
_NAME = "depth scale"
_EXPECTED = "steps of inverse depth of 0.0029 per metre, as a Kinect has, or none"


def check_depth_scale(
    depths_raw: Sequence[np.ndarray], units_per_m: float, camera: Camera
) -> Finding:
    """Factor by which depth is too large; depths [H, W] uint16 (0 = none) of `units_per_m`.

    Without truth a scale can be told only by something of known size. Sensors of the Kinect's kind have
    one: inverse depth comes in steps that are the same in all of them. Found are factors from 1.3 to 12
    either way, of raw or registered depth that was not smoothed; other sensors and rendered depth have
    no such steps, and then only `depth_range` has a say.
    """
    step = find_depth_step(depths_raw, units_per_m)
    if step is None:
        seen = (
            "depth shows no steps of a Kinect-like sensor: its scale cannot be told from the images"
        )
        return Finding(_NAME, "ok", None, "x", seen, _EXPECTED)
    factor = _KINECT_STEP_PER_M / step.step_per_m
    seen = f"inverse depth comes in steps of {step.step_per_m:.5f} per metre"
    if 1 / _TOLERANCE < factor < _TOLERANCE:
        return Finding(_NAME, "ok", factor, "x", f"{seen}, as a Kinect's does", _EXPECTED)
    size = f"{factor:.2g} times too large" if factor > 1 else f"{1 / factor:.2g} times too small"
    advice = (
        f"the depth scale is {units_per_m:g} units per metre: expected about "
        f"{_usual(units_per_m * factor):g}"
    )
    if _like_a_kinect(camera):
        seen += f": for a Kinect-like sensor depth is {size}"
        return Finding(_NAME, "fault", factor, "x", seen, _EXPECTED, advice)
    seen += f": depth is {size} if this is a Kinect-like sensor, but its lens is another"
    return Finding(_NAME, "note", factor, "x", seen, _EXPECTED, f"if it is: {advice}")


def _like_a_kinect(camera: Camera) -> bool:
    low, high = _KINECT_FOCAL_PER_WIDTH
    aspect = camera.width_px / camera.height_px
    return low < camera.fx / camera.width_px < high and abs(aspect - _KINECT_ASPECT) < 0.03


def _usual(units_per_m: float) -> float:
    """The usual scale within 15 %, or else the number itself to two digits."""
    near = min(_USUAL_UNITS, key=lambda usual: abs(np.log(usual / units_per_m)))
    return near if abs(np.log(near / units_per_m)) < 0.15 else float(f"{units_per_m:.2g}")
