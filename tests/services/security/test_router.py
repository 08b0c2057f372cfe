"""Who is let in, and who may do what, with real sessions at a real router."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import zenoh

from hsslam_node.errors import UserError
from hsslam_proto import run_messages, topics
from hsslam_proto.message import Message
from hsslam_proto.point_codec import question_message
from hsslam_proto.request_messages import Ask, QueryMap, Refusal
from hsslam_proto.requests import PAUSE, QUERY, REQUESTS
from hsslam_services.bus.ask import NoServiceError, ask
from hsslam_services.bus.bus import Bus, free_endpoint
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.commands.certs import make_certificates
from hsslam_services.run.options import ServeOptions
from hsslam_services.security.access import ROLES
from hsslam_services.security.credentials import client_settings
from hsslam_services.supervisor.router import exposure, open_run_router
from tests.services.wire_samples import frame, keyframe, pose
from tests.until import until

_REFUSED = "expected a router that accepts this certificate"


@pytest.mark.parametrize("role", [role.name for role in ROLES])
def test_a_certificate_of_our_ca_is_let_in(secure_router, role):
    with Bus(secure_router.outside, "r", "outside", str(secure_router.certs / role)) as bus:
        assert bus.is_connected()


def test_old_and_renewed_certificates_accept_each_other(secure_router, tmp_path):
    old, renewed = secure_router.certs, tmp_path / "renewed"
    make_certificates(renewed, (), 7, old / "ca")
    port = int(free_endpoint().rpartition(":")[2])
    options = ServeOptions(zenoh_port=port, robot="r", security=str(renewed / "router"))
    with open_run_router(options, renewed).session:
        for outside in (f"tls/127.0.0.1:{port}", secure_router.outside):
            for certs in (old, renewed):
                with Bus(outside, "r", "outside", str(certs / "operator")) as bus:
                    assert bus.is_connected()


def test_a_key_that_other_users_may_read_gets_a_warning(certs, tmp_path):
    folder = shutil.copytree(certs / "router", tmp_path / "router")
    port = int(free_endpoint().rpartition(":")[2])
    options = ServeOptions(zenoh_port=port, robot="r", security=str(folder))
    warnings = {}
    for mode in (0o600, 0o640):
        (folder / "key.pem").chmod(mode)
        (arena := tmp_path / f"{mode:o}").mkdir()
        router = open_run_router(options, arena)
        router.session.close()
        warnings[mode] = [text for text, level in router.notices if level == "warning"]
    assert warnings[0o600] == []
    (text,) = warnings[0o640]
    assert text == (
        f"--security {folder}: key.pem has mode 640: other users may read the private key: "
        "expected mode 600"
    )


def test_strangers_are_not_let_in(secure_router, other_certs):
    outside, ours = secure_router.outside, secure_router.certs / "operator"
    theirs = client_settings(outside, str(other_certs / "operator"))
    anonymous = {"transport/link/tls/root_ca_certificate": str(ours / "ca.pem")}
    mixed = {**theirs, **anonymous}  # trusts our router, and shows the certificate of another CA
    for settings in (mixed, theirs, anonymous):
        with pytest.raises(UserError, match=_REFUSED):
            open_client(outside, 0.5, settings)
    with pytest.raises(UserError, match="expected a router"):
        open_client(outside.replace("tls/", "tcp/"), 0.5)
    with pytest.raises(UserError, match="expected --security DIR"):
        Bus(outside, "r", "outside")


def test_a_camera_publishes_frames_and_nothing_else(secure_router):
    outside, security = secure_router.outside, str(secure_router.certs / "camera")
    with Bus(secure_router.inside, "r", "tracker") as service:
        frames, poses = service.subscribe(topics.FRAME, 8), service.subscribe(topics.POSE, 8)
        ends, stops = service.subscribe(topics.SOURCE_END), service.subscribe(topics.STOP)
        plain = open_client(outside, 3.0, client_settings(outside, security))
        with Bus(outside, "r", "outside-camera", security) as camera, plain:
            sent = camera.publisher(topics.FRAME)
            until(lambda: (sent.put(frame(0)), frames.wait(0.1))[1])
            camera.publisher(topics.POSE).put(pose(0))
            camera.publisher(topics.STOP).put(run_messages.Stop(reason="faked"))
            for key in ("hsslam/r/**", "hsslam/r/*/*", "hsslam/r/out/pose", "hsslam/r/sys/stop"):
                plain.put(key, b"by any means")
            camera.publisher(topics.SOURCE_END).put(
                run_messages.SourceEnd(frame_count=1, reason="end")
            )
            assert ends.wait(3.0) is not None
            assert "tracker" in {live.process for live in camera.live_processes()}
            assert {live.process for live in service.live_processes()} == {"tracker"}
        with open_client(secure_router.inside) as worker:  # the same is taken from within
            worker.put("hsslam/r/out/pose", b"by any means")
            until(lambda: poses.received == 1)
        assert (poses.received, stops.received, frames.rejected) == (1, 0, 0)


def test_no_client_feeds_or_ends_a_run_that_has_a_camera_process(tmp_path):
    port = int(free_endpoint().rpartition(":")[2])
    options = ServeOptions("synth:room", zenoh_port=port, robot="r")
    router = open_run_router(options, tmp_path)
    with (
        router.session,
        Bus(router.endpoint, "r", "supervisor") as inside,
        Bus(f"tcp/127.0.0.1:{port}", "r", "outside-camera") as outside,
        open_client(f"tcp/127.0.0.1:{port}") as plain,
    ):
        inputs = [topic for topic in topics.TOPICS if topic.name.startswith("in/")]
        heard = {topic: inside.subscribe(topic, 8) for topic in inputs}
        frames, odometry = outside.publisher(topics.FRAME), outside.publisher(topics.ODOMETRY)
        until(odometry.has_subscribers)
        assert not frames.has_subscribers()
        frames.put(frame(0))
        outside.publisher(topics.SOURCE_END).put(run_messages.SourceEnd(frame_count=1))
        for key in ("hsslam/r/in/frame", "hsslam/r/in/end", "hsslam/r/in/**", "hsslam/r/in/*"):
            plain.put(key, b"by any means")
        for sender in (odometry, outside.publisher(topics.IMU)):
            sender.put_payload(b"")
        plain.put("hsslam/r/in/odometry", b"")
        until(lambda: heard[topics.ODOMETRY].rejected == 2 and heard[topics.IMU].rejected)
        own = inside.publisher(topics.FRAME)
        until(lambda: (own.put(frame(1)), heard[topics.FRAME].pending())[1])
        assert {taken.index for taken in heard[topics.FRAME].drain()} == {1}
        assert heard[topics.FRAME].rejected == heard[topics.SOURCE_END].received == 0


def test_a_camera_hears_steps_and_poses_but_no_images(secure_router):
    security = str(secure_router.certs / "camera")
    with (
        Bus(secure_router.inside, "r", "mapper") as service,
        Bus(secure_router.outside, "r", "outside-camera", security) as camera,
    ):
        steps, meshes = camera.subscribe(topics.STEP, 8), camera.subscribe(topics.FRAME, 8)
        until(lambda: _told(service, topics.STEP, run_messages.Step(stage="done", index=1), steps))
        service.publisher(topics.FRAME).put(frame(0))
        assert meshes.wait(0.3) is None


@pytest.mark.parametrize("role", ["viewer", "operator"])
def test_who_looks_on_hears_all_and_what_was_before(secure_router, role):
    security = str(secure_router.certs / role)
    with Bus(secure_router.inside, "r", "tracker") as service:
        kept = service.publisher(topics.KEYFRAME)
        for index in range(3):
            kept.put(keyframe(index))
        with Bus(secure_router.outside, "r", "dashboard", security) as looker:
            keyframes = looker.subscribe(topics.KEYFRAME, 16)
            until(lambda: keyframes.pending() == 3)
            frames = looker.subscribe(topics.FRAME, 8)
            until(lambda: _told(service, topics.FRAME, frame(0), frames))
            images = service.subscribe(topics.FRAME, 8)
            looker.publisher(topics.FRAME).put(frame(1))
            assert images.wait(0.3) is None


def test_requests_by_role(secure_router):
    answered = {role.name: set() for role in ROLES}
    with _answering(secure_router.inside):
        for role in ROLES:
            security = str(secure_router.certs / role.name)
            settings = client_settings(secure_router.outside, security)
            with open_client(secure_router.outside, 3.0, settings) as client:
                for request in REQUESTS:
                    replies = client.get(request.key("r"), timeout=1.0)
                    if any(reply.ok for reply in replies):
                        answered[role.name].add(request.name)
                assert not any(reply.ok for reply in client.get("hsslam/r/rpc/**", timeout=0.3))
    assert answered["camera"] == set()
    assert answered["viewer"] == {"status", "mesh", "trajectory", "query"}
    assert answered["operator"] == {request.name for request in REQUESTS}


def test_a_request_that_is_not_allowed_says_so(secure_router):
    with _answering(secure_router.inside), pytest.raises(NoServiceError, match="certificate"):
        ask(secure_router.outside, "r", PAUSE, Ask(), security=str(secure_router.certs / "viewer"))


@pytest.mark.parametrize("bind", ["0.0.0.0", "10.0.0.7", "::", "robot.local"])
def test_an_open_port_is_warned_of(bind):
    assert f"--bind {bind} without --security" in exposure(bind)


@pytest.mark.parametrize("bind", ["127.0.0.1", "::1", "localhost", "127.0.0.2"])
def test_loopback_is_nobody_s_business(bind):
    assert exposure(bind) == ""


def _told(service: Bus, topic: topics.Topic, message: Message, heard) -> bool:
    publisher = service.publisher(topic)
    publisher.put(message)
    return heard.wait(0.1) is not None


@contextmanager
def _answering(endpoint: str) -> Iterator[None]:
    """A service that says "done" to all requests."""
    with open_client(endpoint) as service:

        def answer(query: zenoh.Query) -> None:
            query.reply(query.key_expr, b"done")

        queryable = service.declare_queryable("hsslam/r/rpc/**", answer)
        time.sleep(0.2)
        yield
        queryable.undeclare()


def test_no_client_asks_the_process_that_a_request_is_passed_on_to(secure_router):
    outside, security = secure_router.outside, str(secure_router.certs / "operator")
    question, answered = question_message(np.zeros((1, 3))), []

    def answer(asked: QueryMap) -> Refusal:
        answered.append(asked)
        return Refusal(reason="not_now", text="heard")

    with Bus(secure_router.inside, "r", "mesher") as mesher:
        mesher.answer(QUERY, answer)
        with Bus(secure_router.inside, "r", "supervisor") as supervisor:
            until(lambda: [supervisor.pass_on(QUERY, question), *answered][1:])
        heard = len(answered)
        with Bus(outside, "r", "outside", security) as operator:
            refused = operator.pass_on(QUERY, question)
            assert isinstance(refused, Refusal) and "is not running" in refused.text
        assert len(answered) == heard
