"""The place of the camera as clients name it."""

import threading

from hsslam_proto.request_messages import Locate, Located, Refusal
from hsslam_services.arena.asked_place import AskedPlace
from hsslam_services.arena.map_state import MapState
from tests.small_room import SMALL, mapped_room


def test_a_question_that_waits_for_frames_is_answered_when_the_tracker_ends(tmp_path):
    mode = MapState.create(tmp_path, localise_only=False)
    asked = AskedPlace(mapped_room().arrays, SMALL, mode, ())
    told: list[Located | Refusal] = []
    client = threading.Thread(target=lambda: told.append(asked.answer(Locate(x=0, y=0, yaw_deg=0))))
    client.start()
    while asked.near is None:
        assert client.is_alive(), told
    asked.close()
    client.join(timeout=5)
    text = "locate: the run ends: expected one that goes on"
    assert told == [Refusal(reason="not_now", text=text)]
    assert asked.answer(Locate(x=0, y=0, yaw_deg=0)) == told[0]
