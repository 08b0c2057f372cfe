"""What the viewer shows of each message: entity tree and default layout (rerun 0.41)."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from hsslam_node.geometry.se3 import rotation_from_quaternion
from hsslam_proto import messages
from hsslam_proto.map_epoch import EpochOrder
from hsslam_proto.mesh_codec import mesh_arrays
from hsslam_services.log.frame_compression import jpeg
from hsslam_services.viewer.path import RerunPoses

_BLOCK_KEYFRAMES = 32  # per entity; a keyframe re-logs its block only
_FRUSTUM_DEPTH_M = 0.06
_IMAGE_PLANE_M = 0.2
_KEYFRAMES, _LOOPS = (190, 140, 50), (110, 255, 120)
_OF_MAP = (
    "world/trajectory",
    "world/lost",
    "world/keyframes",
    "world/loops",
    "world/mesh",
    "model",
)
_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


class RerunScene:
    """Draws messages into one recording stream.

    world (static view coordinates), world/camera, world/camera/image, world/trajectory/<segment>,
    world/lost/<stretch>, world/keyframes/<block>, world/loops, world/mesh, model, plots/*, events.
    Poses are drawn together, every `poses_every_s`. When the map is thrown away all of it but the
    camera, plots and events is cleared.
    """

    def __init__(self, stream: rr.RecordingStream, poses_every_s: float) -> None:
        self._stream = stream
        self._poses = RerunPoses(stream, poses_every_s)
        self._worlds = EpochOrder()
        self._loops: set[tuple[int, int]] = set()
        self._keyframes: dict[int, tuple[messages.Vector, messages.Quaternion]] = {}
        self._frustum: np.ndarray | None = None
        self._intrinsics: tuple[float, ...] = ()
        self._time: tuple[int, int] | None = None
        stream.log("world", rr.ViewCoordinates.RDF, static=True)
        for name in ("latency_ms", "fps", "quality", "loss"):
            stream.log(f"plots/{name}", rr.SeriesLines(names=name), static=True)

    def draw(self, message: messages.Message) -> None:
        """Log one message at its own time; what has no sensor stamp goes to the newest one."""
        if self._worlds.begins_with(message):
            self._clear()
        elif self._worlds.is_past(message):
            return
        match message:
            case messages.Frame():
                self._set_time(message.index, message.stamp_ns)
                self._draw_frame(message)
            case messages.Pose():
                self._set_time(message.index, message.stamp_ns)
                self._poses.add(message)
            case messages.Keyframe():
                self._keyframes[message.id] = (message.t, message.q)
                self._draw_keyframes([message.id])
            case messages.Correction():
                moved = zip(message.keyframes, message.t, message.q, strict=True)
                self._keyframes.update((k, (t, q)) for k, t, q in moved)
                self._draw_keyframes(message.keyframes)
                self._loops.update(message.loops)
                self._draw_loops()
            case messages.MapVersion():
                self._plot("loss", message.loss)
            case messages.Mesh():
                self._draw_mesh(message)
            case messages.View():
                self._draw_view(message)
            case messages.Health():
                self._plot(f"memory_mb/{message.process}", message.rss_bytes / 1e6)
            case messages.Event():
                text = f"{message.process}: {message.text}"
                self._stream.log("events", rr.TextLog(text, level=_LEVELS[message.level]))
        if self._poses.is_due():
            self._poses.draw()
            self._restore_time()

    def finish(self) -> None:
        """Draw the poses that wait."""
        self._poses.draw()

    def _clear(self) -> None:
        """Nothing of the old map remains: its coordinates say nothing in the new one."""
        self._poses.begin_path()
        self._restore_time()
        for entity in _OF_MAP:
            self._stream.log(entity, rr.Clear(recursive=True))
        self._loops.clear()
        self._keyframes.clear()

    def _set_time(self, index: int, stamp_ns: int) -> None:
        """Time comes before logging: what is logged earlier is absent from the timeline."""
        if self._time is None or stamp_ns >= self._time[1]:
            self._time = (index, stamp_ns)
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", timestamp=np.datetime64(stamp_ns, "ns"))

    def _draw_frame(self, frame: messages.Frame) -> None:
        size = (frame.width_px, frame.height_px)
        intrinsics = (frame.fx, frame.fy, frame.cx, frame.cy, *size)
        if intrinsics != self._intrinsics:
            self._intrinsics = intrinsics
            pinhole = rr.Pinhole(
                focal_length=(frame.fx, frame.fy),
                principal_point=(frame.cx, frame.cy),
                resolution=size,
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=_IMAGE_PLANE_M,
            )
            self._stream.log("world/camera/image", pinhole)
        image = rr.EncodedImage(contents=jpeg(frame), media_type="image/jpeg")
        self._stream.log("world/camera/image", image)
        if self._frustum is None:
            self._frustum = _frustum(frame)
            self._draw_keyframes(list(self._keyframes))

    def _draw_keyframes(self, changed: Sequence[int]) -> None:
        if self._frustum is None:
            return
        self._restore_time()
        for block in sorted({k // _BLOCK_KEYFRAMES for k in changed}):
            strips = [
                self._frustum @ rotation_from_quaternion(np.array(q)).T + np.array(t)
                for k, (t, q) in self._keyframes.items()
                if k // _BLOCK_KEYFRAMES == block
            ]
            self._stream.log(
                f"world/keyframes/{block}",
                rr.LineStrips3D(strips, colors=[_KEYFRAMES], radii=rr.Radius.ui_points(0.5)),
            )

    def _draw_loops(self) -> None:
        """A line between the keyframes that each loop has brought together."""
        places = {k: t for k, (t, _) in self._keyframes.items()}
        lines = [[places[a], places[b]] for a, b in self._loops if a in places and b in places]
        if lines:
            self._restore_time()
            self._stream.log(
                "world/loops",
                rr.LineStrips3D(lines, colors=[_LOOPS], radii=rr.Radius.ui_points(1.2)),
            )

    def _draw_mesh(self, mesh: messages.Mesh) -> None:
        self._restore_time()
        vertices, faces, colors = mesh_arrays(mesh)
        self._stream.log(
            "world/mesh",
            rr.Mesh3D(
                vertex_positions=vertices,
                triangle_indices=faces,
                vertex_normals=_vertex_normals(vertices, faces),
                vertex_colors=colors,
                # one looks into a room through the back of its walls
                face_rendering=rr.components.MeshFaceRendering.Front,
            ),
        )

    def _draw_view(self, view: messages.View) -> None:
        self._restore_time()
        shape = (view.height_px, view.width_px, 3)
        self._stream.log("model", rr.Image(np.frombuffer(view.color, np.uint8).reshape(shape)))

    def _plot(self, name: str, value: float) -> None:
        self._restore_time()
        self._stream.log(f"plots/{name}", rr.Scalars([value]))

    def _restore_time(self) -> None:
        if self._time is not None:
            self._set_time(*self._time)


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
            rrb.Spatial2DView(origin="/model", name="Map as seen from there"),
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


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals [V, 3] float32, faces weighted by area; the viewer shades only with them."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face_normals = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for axis in range(3):
        weights = np.repeat(face_normals[:, axis], 3)
        normals[:, axis] = np.bincount(faces.ravel(), weights, minlength=len(vertices))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)


def _frustum(frame: messages.Frame) -> np.ndarray:
    """One line strip through apex and corners of the image, [10, 3] m, camera axes."""
    u = np.array([-0.5, frame.width_px - 0.5, frame.width_px - 0.5, -0.5])
    v = np.array([-0.5, -0.5, frame.height_px - 0.5, frame.height_px - 0.5])
    corners = np.column_stack([(u - frame.cx) / frame.fx, (v - frame.cy) / frame.fy, np.ones(4)])
    points = np.vstack([np.zeros(3), corners * _FRUSTUM_DEPTH_M])
    return points[[0, 1, 2, 0, 3, 4, 0, 1, 4]].astype(np.float32)
