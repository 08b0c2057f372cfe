"""Map a source, then query the map: distances to surfaces, hits of rays, and whether a body fits.

    python examples/ask_distances.py [synth:room [60 [map.safetensors]]]

The arguments are source, number of frames, and a file for the map. `SavedMap.open` of this file gives the
same answers.
"""

import sys

import numpy as np

from hsslam_node.dense_map.shapes import Boxes, Spheres
from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions


def main(spec: str = "synth:room", frames: str = "60", out: str = "") -> None:
    """Map the first frames, and print the answers of the map along the camera's view."""
    if not (frames.isdecimal() and int(frames)):
        raise UserError(f"{frames}: expected a number of frames, 1 or more")
    slam = Slam(PRESETS["realtime"])
    for _ in slam.run(open_source(spec, SourceOptions(frames=int(frames))).frames()):
        pass
    slam.finish()
    ask(slam)
    if out:
        slam.save(out)
        print(f"{out}: {len(slam.map.keyframes)} keyframes")


def ask(slam: Slam) -> None:
    """Query points and rays along the optical axis of the last camera."""
    trajectory = slam.trajectory()
    if not len(trajectory):
        raise UserError("no frame was tracked: expected a source whose frames have depth")
    eye, ahead = trajectory.T_world_cam[-1, :3, 3], trajectory.T_world_cam[-1, :3, 2]

    hits = slam.raycast(eye[None], ahead[None], max_m=8.0)
    print(f"ahead there is a surface after {hits.distance_m[0]:.2f} m")

    along_m = np.linspace(0.2, 1.0, 5) * min(hits.distance_m[0], 8.0)
    points = eye + along_m[:, None] * ahead
    distance_m, gradient, known, certainty = slam.query(points)
    for k, metres in enumerate(along_m):
        if known[k]:
            away = " ".join(f"{part:+.2f}" for part in gradient[k])
            found = f"{distance_m[k]:.3f} m to the nearest surface, away from it {away}"
            print(f"  at {metres:.2f} m: {found}, certainty {certainty[k]:.2f}")
        else:
            print(f"  at {metres:.2f} m: no keyframe saw this place")

    balls = slam.is_free(Spheres(points, radius_m=0.1))
    crates = slam.is_free(Boxes.between(points - 0.15, points + 0.15))
    print(f"a ball of 20 cm fits at {along_m[balls].round(2)} m")
    print(f"a crate of 30 cm fits at {along_m[crates].round(2)} m")


if __name__ == "__main__":
    if len(sys.argv) > 4 or sys.argv[1:] == ["--help"]:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except UserError as error:
        sys.exit(f"error: {error}")
