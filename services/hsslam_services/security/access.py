"""Access control of the router: rights of each role, and of clients without certificates. Default: deny."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import zenoh

from hsslam_proto.requests import MESH, QUERY, REQUESTS, STATUS, TRAJECTORY
from hsslam_proto.topics import TOPICS, Topic

WORKER_LINK = "unixsock-stream"  # a socket in the arena's folder: only processes of this user
# what clients publish if the run has a camera process
_BESIDE_OWN_CAMERA = ("in/odometry", "in/imu")
_PUBLISHER_KEYS = "/@adv/**"  # caches and heartbeats of topics with history; ** matches no @
_LIVE = "hsslam/*/sys/live/*/*"
_MESSAGES = (
    *("put", "delete", "declare_subscriber", "query", "declare_queryable", "reply"),
    *("liveliness_token", "declare_liveliness_subscriber", "liveliness_query"),
)


@dataclass(frozen=True)
class Role:
    """One row: the common name of a certificate, and its keys below `hsslam/<robot>/`.

    A key here must include the key of the client: a role that hears `out/**` may subscribe to
    `out/pose` and to `out/**`, not to `**`.
    """

    name: str
    purpose: str
    publishes: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()


ROLES: tuple[Role, ...] = (
    Role("camera", "publishes frames", ("in/**",), ("sys/*", "out/pose", "out/map")),
    Role(
        "viewer",
        "reads images, poses, meshes, distances, status",
        hears=("in/**", "out/**", "sys/*"),
        asks=tuple(request.name for request in (STATUS, MESH, TRAJECTORY, QUERY)),
    ),
    Role(
        "operator",
        "reads everything and controls the run",
        hears=("in/**", "out/**", "sys/*"),
        asks=tuple(request.name for request in REQUESTS),
    ),
)

NO_CERTIFICATE = Role(
    "outside",
    "a port without certificates: publishes frames, reads everything and controls the run",
    publishes=("in/**",),
    hears=("in/**", "out/**", "sys/*"),
    asks=tuple(request.name for request in REQUESTS),
)


def access_control(
    robot: str,
    has_certificates: bool,
    ros_domain: int | None = None,
    has_camera_process: bool = False,
) -> dict[str, Any]:
    """Access control of a zenoh router: processes of the run may do everything, clients what their role may.

    Clients may publish and send requests only for `robot`; they may subscribe to any robot.
    `ros_domain`: domain of the ROS nodes that may use this router. `has_camera_process`: the run has a camera
    of its own, so clients may publish neither frames nor their end.
    """
    ros_keys = () if ros_domain is None else _ros_keys(ros_domain)
    every_key = ("**", f"**{_PUBLISHER_KEYS}", *ros_keys)
    both = ("ingress", "egress")
    rules = [_rule("workers", both, _MESSAGES, every_key)]
    subjects: list[dict[str, Any]] = [{"id": "workers", "link_protocols": [WORKER_LINK]}]
    policies: list[dict[str, Any]] = [{"rules": ["workers"], "subjects": ["workers"]}]
    for role in ROLES if has_certificates else (NO_CERTIFICATE,):
        if has_camera_process and role.publishes:
            role = replace(role, publishes=_BESIDE_OWN_CAMERA)
        of_role = _rules(role, robot)
        if ros_keys:
            of_role.append(_rule(f"{role.name} in ROS", both, _MESSAGES, ros_keys))
        rules += of_role
        who = {"cert_common_names": [role.name]} if has_certificates else {}
        protocol = "tls" if has_certificates else "tcp"
        subjects.append({"id": role.name, "link_protocols": [protocol], **who})
        policies.append({"rules": [rule["id"] for rule in of_role], "subjects": [role.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _ros_keys(domain: int) -> tuple[str, ...]:
    """Keys of rmw_zenoh: topics and services of a domain, their caches, and the tokens of all nodes."""
    return f"{domain}/**", f"{domain}/**{_PUBLISHER_KEYS}", "@ros2_lv/**"


def _rules(role: Role, robot: str) -> list[dict[str, Any]]:
    """Rules of one role. Ingress: from the client to the router; egress: from the router to it.

    Messages in one direction need declarations in the other: a publisher that sees no subscriber sends
    nothing.
    """
    heard = [f"hsslam/*/{key}" for key in role.hears]
    caches = [f"{key}{_PUBLISHER_KEYS}" for key in heard]
    rules = [
        _rule(f"{role.name} hears", ("ingress",), ("declare_subscriber",), heard + caches),
        _rule(f"{role.name} receives", ("egress",), ("put", "reply"), heard + caches),
        _rule(
            f"{role.name} asks for history",
            ("ingress",),
            ("query", "declare_liveliness_subscriber", "liveliness_query"),
            caches,
        ),
        _rule(f"{role.name} sees caches", ("egress",), ("liveliness_token",), caches),
        _rule(
            f"{role.name} asks for liveliness",
            ("ingress",),
            ("liveliness_query", "declare_liveliness_subscriber"),
            [_LIVE],
        ),
        _rule(f"{role.name} sees liveliness", ("egress",), ("liveliness_token",), [_LIVE]),
    ]
    states = [key for key in heard for topic in TOPICS if topic.keeps_state and _names(key, topic)]
    if states:
        rules += [
            _rule(f"{role.name} asks for the state", ("ingress",), ("query",), states),
            _rule(f"{role.name} sees the state", ("egress",), ("declare_queryable",), states),
        ]
    if role.publishes:
        sent = [f"hsslam/{robot}/{key}" for key in role.publishes]
        own = [f"{key}{_PUBLISHER_KEYS}" for key in sent]
        rules += [
            _rule(f"{role.name} publishes", ("ingress",), ("put", "reply"), sent + own),
            _rule(
                f"{role.name} keeps history",
                ("ingress",),
                ("declare_queryable", "liveliness_token"),
                own,
            ),
            _rule(f"{role.name} is heard", ("egress",), ("declare_subscriber",), sent + own),
            _rule(
                f"{role.name} is asked for history",
                ("egress",),
                ("query", "declare_liveliness_subscriber"),
                own,
            ),
        ]
    if role.asks:
        asked = [f"hsslam/{robot}/rpc/{name}" for name in role.asks]
        every = [f"hsslam/{robot}/rpc/**"]  # the key that the service declares
        rules += [
            _rule(f"{role.name} asks", ("ingress",), ("query",), asked),
            _rule(f"{role.name} is answered", ("egress",), ("reply",), asked),
            _rule(f"{role.name} finds the service", ("egress",), ("declare_queryable",), every),
        ]
    return rules


def _names(key: str, topic: Topic) -> bool:
    return zenoh.KeyExpr(key).includes(zenoh.KeyExpr(topic.key("robot")))


def _rule(
    name: str, flows: Sequence[str], messages: Iterable[str], keys: Iterable[str]
) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(keys),
    }
