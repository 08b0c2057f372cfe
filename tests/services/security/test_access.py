"""The table of roles: its keys are those of the bus, and the docs say the same."""

import zenoh

from hsslam_proto.requests import REQUESTS
from hsslam_proto.topics import FRAME, IMU, ODOMETRY, POSE, SOURCE_END, TOPICS
from hsslam_services.security.access import ROLES, access_control
from tests.repository import ROOT

_DOCS = ROOT / "docs/security.md"


def _includes(keys: tuple[str, ...], name: str) -> bool:
    return any(zenoh.KeyExpr(key).includes(zenoh.KeyExpr(name)) for key in keys)


def test_who_looks_on_hears_every_topic_and_only_a_camera_publishes():
    camera, viewer, operator = ROLES
    assert [topic for topic in TOPICS if _includes(camera.publishes, topic.name)] == [
        FRAME,
        ODOMETRY,
        IMU,
        SOURCE_END,
    ]
    assert not viewer.publishes and not operator.publishes
    assert _includes(camera.hears, POSE.name) and not _includes(camera.hears, FRAME.name)
    for topic in TOPICS:
        assert _includes(viewer.hears, topic.name) and _includes(operator.hears, topic.name)
    names = {request.name for request in REQUESTS}
    assert set(viewer.asks) < set(operator.asks) == names


def test_what_is_not_listed_is_denied_and_all_three_parts_name_each_other():
    access = access_control("r", has_certificates=True)
    assert access["enabled"] and access["default_permission"] == "deny"
    rules, subjects = ({row["id"] for row in access[part]} for part in ("rules", "subjects"))
    named = {rule for policy in access["policies"] for rule in policy["rules"]}
    assert named == rules and len(access["rules"]) == len(rules)
    assert {s for policy in access["policies"] for s in policy["subjects"]} == subjects
    assert all(subject["link_protocols"] for subject in access["subjects"])


def test_the_docs_have_the_same_table():
    lines = _DOCS.read_text().splitlines()
    for role in ROLES:
        (row,) = [line for line in lines if line.startswith(f"| {role.name} | ")]
        publishes, hears, asks = (cell.strip() for cell in row.split("|")[2:5])
        assert publishes == (", ".join(f"`{key}`" for key in role.publishes) or "-")
        assert hears == (", ".join(f"`{key}`" for key in role.hears) or "-")
        everything = len(role.asks) == len(REQUESTS)
        assert asks == ("everything" if everything else ", ".join(role.asks) or "-")
