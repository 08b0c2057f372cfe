"""Table of topics; the bus, recorder, viewer, docs and contract tests iterate over it."""

from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from hsslam_proto import messages as m
from hsslam_proto import run_messages
from hsslam_proto.distance.messages import Esdf, EsdfBlocks, Grid
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.message import Message

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class Topic(Generic[M]):
    """One row: the messages under `hsslam/<robot>/<name>`.

    qos "latest": never blocks the publisher, the newest message wins. qos "keep": no message is lost while
    the link lives. The publisher caches the last `history` messages for later subscribers. If `keeps_state`,
    it answers a `get` on the key with messages that hold the whole current state.
    """

    name: str
    message: type[M]
    publisher: str
    rate: str
    qos: Literal["latest", "keep"]
    size_limit_bytes: int
    history: int = 0
    logged: bool = True
    drawn: bool = False
    keeps_state: bool = False

    @property
    def schema(self) -> str:
        """Schema name with its major version, as in the encoding: `hsslam.Frame.v1`."""
        return schema_of(self.message)

    def key(self, robot: str) -> str:
        """The zenoh key of this topic for one robot."""
        return f"hsslam/{robot}/{self.name}"


def schema_of(message: type[Message]) -> str:
    """Schema name of a message type with its major version."""
    return f"hsslam.{message.__name__}.v{message.MAJOR}"


_KIB, _MIB = 2**10, 2**20

FRAME = Topic("in/frame", m.Frame, "camera", "30 Hz", "latest", 64 * _MIB, drawn=True)
ODOMETRY = Topic(
    *("in/odometry", m.RobotOdometry, "outside", "10 to 200 Hz", "latest", 8 * _KIB), logged=False
)
IMU = Topic(
    *("in/imu", m.ImuSamples, "outside", "30 to 1000 Hz", "latest", 128 * _KIB), logged=False
)
SOURCE_END = Topic("in/end", run_messages.SourceEnd, "camera", "once", "keep", 8 * _KIB, history=1)
POSE = Topic("out/pose", m.Pose, "tracker", "30 Hz", "latest", 64 * _KIB, history=600, drawn=True)
KEYFRAME = Topic(
    "out/keyframe", m.Keyframe, "tracker", "up to 8 Hz", "keep", 8 * _KIB, history=4096, drawn=True
)
MAP = Topic("out/map", m.MapVersion, "mapper", "1 to 10 Hz", "keep", 8 * _KIB, 16, drawn=True)
CORRECTION = Topic(
    *("out/correction", m.Correction, "mapper, global_ba", "about 1 Hz", "keep", 4 * _MIB, 16),
    drawn=True,
)
MESH = Topic(
    "out/mesh", mesh_messages.Mesh, "mesh_saver", "at the end", "keep", 256 * _MIB, 1, drawn=True
)
MESH_BLOCKS = Topic(
    *("out/mesh_blocks", MeshBlocks, "mesher", "below 4 Hz", "keep", 64 * _MIB),
    drawn=True,
    keeps_state=True,
)
VIEW = Topic("out/view", m.View, "mesher", "0.4 Hz", "latest", _MIB, drawn=True)
GRID = Topic("out/grid", Grid, "distances", "2 to 10 Hz", "latest", _MIB, history=1)
ESDF = Topic("out/esdf", Esdf, "distances", "2 to 10 Hz", "latest", _MIB, logged=False)
ESDF_BLOCKS = Topic(
    *("out/esdf_blocks", EsdfBlocks, "distances", "2 to 10 Hz", "keep", 4 * _MIB),
    logged=False,
    keeps_state=True,
)
STEP = Topic(
    "sys/step", run_messages.Step, "mapper, global_ba, recorder", "lockstep; end", "keep", 8 * _KIB
)
HEALTH = Topic(
    "sys/health", run_messages.Health, "all", "2 Hz each", "latest", 64 * _KIB, drawn=True
)
EVENT = Topic("sys/event", run_messages.Event, "all", "rare", "keep", 16 * _KIB, 256, drawn=True)
HOLD = Topic("sys/hold", run_messages.Hold, "supervisor", "rare", "keep", 8 * _KIB, history=1)
STOP = Topic("sys/stop", run_messages.Stop, "supervisor", "once", "keep", 8 * _KIB, history=1)

TOPICS: tuple[Topic, ...] = (
    FRAME,
    ODOMETRY,
    IMU,
    SOURCE_END,
    POSE,
    KEYFRAME,
    MAP,
    CORRECTION,
    MESH,
    MESH_BLOCKS,
    VIEW,
    GRID,
    ESDF,
    ESDF_BLOCKS,
    STEP,
    HEALTH,
    EVENT,
    HOLD,
    STOP,
)
