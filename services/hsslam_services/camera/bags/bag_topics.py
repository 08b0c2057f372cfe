"""Finds the topics of a bag with colour, depth and intrinsics of the camera."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.depth_registration import DepthMounting
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.options.topics import BagOptions, info_beside
from hsslam_node.sources.reports import Reports
from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_services.camera.bags import realsense_recording
from hsslam_services.camera.bags.bag_file import BagFile, BagMessage, BagTopic
from hsslam_services.camera.depth_mounting import (
    ShownImages,
    both_cameras,
    depth_mounting,
    is_named_registered,
    is_named_unregistered,
    names_other_frame,
    report_other_frame,
)
from hsslam_services.camera.ros2_messages import (
    COMPRESSED,
    IMAGE,
    INFO,
    is_rectified,
    report_one_rectified,
)
from hsslam_services.camera.ros_frames import MOST_BROKEN


@dataclass(frozen=True)
class BagCamera:
    """The topics of one camera, its intrinsics and its first images."""

    color: str
    depth: str
    info: str
    camera: Camera  # of colour, with its distortion
    first: tuple[RawImage, RawImage]  # colour, depth
    mounting: DepthMounting | None  # None if depth is registered to colour
    depth_units_per_m: float | None  # None: those of the encoding


def find_camera(bag: BagFile, options: BagOptions, reports: Reports) -> BagCamera:
    """Find the topics of the camera: those that the options name, else the only ones that fit.

    Prefers depth topics with "aligned" or "registered" in their names, and colour images to grey ones.
    Depth that is not registered to colour needs its own `camera_info`, and the mounting of its camera.
    Reports if only one of colour and depth is rectified by its name, and the camera has a lens.

    Raises:
        UserError: no or several topics fit, or depth cannot be registered to colour; names all topics.
    """
    firsts = _first_messages(bag)
    images = _images(bag, firsts)
    colors = [name for name, image in images.items() if image.content == "color"]
    greys = [name for name, image in images.items() if image.content == "grey"]
    depths = [name for name, image in images.items() if image.content == "depth"]
    named = [name for name in depths if is_named_registered(name)]
    registered = named or [name for name in depths if not is_named_unregistered(name)]
    color = chosen_topic(bag, "color", options.color, colors or greys, images)
    depth = chosen_topic(bag, "depth", options.depth, registered or depths, images)
    infos = [name for name, message in firsts.items() if message.type_name == INFO]
    beside = _info_beside(color, infos) or infos
    info = chosen_topic(bag, "info", options.info, beside, infos)
    camera = camera_of(bag, firsts[info], color)
    mounting, depth_infos = None, _info_beside(depth, infos)
    if not depth_infos:
        report_other_frame(depth, images[color].frame_id, images[depth].frame_id, reports)
    for depth_info in depth_infos:
        _, color_K = _both_cameras(bag, firsts[info], color)
        depth_camera, depth_K = _both_cameras(bag, firsts[depth_info], depth)
        shown = (
            ShownImages(color, color_K, images[color].frame_id),
            ShownImages(depth, depth_K, images[depth].frame_id),
        )
        T_color_depth = _T_color_depth(bag, *shown, reports)
        mounting = depth_mounting(bag.name, *shown, depth_camera, T_color_depth, reports)
    if mounting is None and bag.decode.has_lens(firsts[info].payload):
        report_one_rectified(color, depth, "--bag", reports)
    with _named(bag, depth, "unit"):
        units = realsense_recording.depth_units_per_m(bag, depth)
    first = images[color], images[depth]
    return BagCamera(color, depth, info, camera, first, mounting, units)


def _first_messages(bag: BagFile) -> dict[str, BagMessage]:
    """The first whole message of each topic with images or intrinsics, else the first; sorted by topic."""
    missing = {
        topic.name: MOST_BROKEN
        for topic in bag.topics
        if topic.type_name in (IMAGE, COMPRESSED, INFO) and topic.message_count
    }
    found: dict[str, BagMessage] = {}
    with contextlib.closing(bag.messages(tuple(missing))) as messages:
        for message in messages:
            topic = message.topic
            if topic not in missing:
                continue
            found.setdefault(topic, message)
            missing[topic] -= 1
            if _is_whole(bag, message):
                found[topic] = message
                missing[topic] = 0
            if not missing[topic]:
                del missing[topic]
            if not missing:
                break
    return dict(sorted(found.items()))


def _is_whole(bag: BagFile, message: BagMessage) -> bool:
    """Whether it can be decoded, without its image; of intrinsics also whether they can be used."""
    try:
        if message.type_name == INFO:
            bag.decode.camera(message.payload, message.type_name, is_rectified=False)
        else:
            bag.decode.image(message.payload, message.type_name)
    except (BadImageError, UserError):
        return False
    return True


def _images(bag: BagFile, firsts: dict[str, BagMessage]) -> dict[str, RawImage]:
    """The first image of each topic whose first message is an image.

    Raises:
        UserError: none of several can be decoded.
    """
    images, errors = {}, []
    for name, message in firsts.items():
        if message.type_name == INFO:
            continue
        try:
            images[name] = bag.decode.image(message.payload, message.type_name)
        except BadImageError as error:
            errors.append(f"{name}: {error}")
    if errors and not images:
        raise UserError(
            f"source {bag.name}: {errors[0]}: expected images; of a bag whose messages are compressed, name "
            "the folder with metadata.yaml"
        )
    return images


def chosen_topic(
    bag: BagFile,
    option: str,
    asked: str,
    fitting: Sequence[str],
    known: Sequence[str] | dict[str, RawImage],
) -> str:
    """The topic `asked`, if it is one of `known`; if `asked` is empty, the only fitting topic.

    option: that of `--bag` that names the topic.

    Raises:
        UserError: there is no such topic, or none or several fit; names all topics.
    """
    if asked:
        found = [name for name in known if name.strip("/") == asked.strip("/")]
        problem = f"--bag.{option} {asked}: no such topic"
    else:
        found = list(fitting)
        names = f" ({', '.join(found)})" if found else ""
        problem = f"{len(found) or 'no'} topics for {option}{names}"
    if len(found) == 1:
        return found[0]
    images = known if isinstance(known, dict) else {}
    topics = ", ".join(_described(topic, images) for topic in bag.topics) or "none"
    raise UserError(
        f"source {bag.name}: {problem}: expected one, or its name as --bag.{option} TOPIC; topics: {topics}"
    )


def _described(topic: BagTopic, images: dict[str, RawImage]) -> str:
    """Name and type of a topic, and the encoding of images that show neither colour nor depth."""
    image = images.get(topic.name)
    if image is None or image.content != "unknown":
        return str(topic)
    return f"{topic}, encoding {image.encoding!r}, which is not supported"


def _info_beside(topic: str, infos: Sequence[str]) -> list[str]:
    """The camera_info of an image topic: its neighbour in ROS; in recordings of the RealSense SDK
    `.../info/camera_info` for `.../image/data`."""
    beside = info_beside(topic)
    folder = beside.removesuffix("/camera_info").removesuffix("/image")
    names = (beside, f"{folder}/info/camera_info")
    return [name for name in names if name in infos][:1]


def camera_of(bag: BagFile, message: BagMessage, color: str) -> Camera:
    """The camera of a `CameraInfo`, for the images of the topic `color`.

    Raises:
        UserError: the message cannot be used.
    """
    try:
        return bag.decode.camera(message.payload, message.type_name, is_rectified(color))
    except (BadImageError, UserError) as error:
        raise UserError(f"source {bag.name}: {message.topic}: {error}") from None


def _both_cameras(bag: BagFile, info: BagMessage, topic: str) -> tuple[Camera, Camera]:
    """As `both_cameras`, of a `camera_info` and the topic of its images."""
    return both_cameras(lambda topic: camera_of(bag, info, topic), topic)


def _T_color_depth(
    bag: BagFile, color: ShownImages, depth: ShownImages, reports: Reports
) -> np.ndarray | None:
    """The pose of the depth camera in the colour camera, [4, 4]; None if the bag has none."""
    if is_named_registered(depth.topic):
        return None
    with _named(bag, depth.topic, "mounting of the camera"):
        found = realsense_recording.mounted_at(bag, color.topic, depth.topic)
    if found is None and names_other_frame(color.frame_id, depth.frame_id):
        found = bag.static_transforms(reports).between(color.frame_id, depth.frame_id)
    return found


@contextlib.contextmanager
def _named(bag: BagFile, topic: str, what: str) -> Iterator[None]:
    """Name the bag, a topic and what of it cannot be read, in an error about other messages."""
    try:
        yield
    except (BadImageError, UserError) as error:
        raise UserError(f"source {bag.name}: {topic}: {what}: {error}") from None
