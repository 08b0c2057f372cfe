"""The search for a fragment's place in the map, while its keyframes come one by one."""

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.join_search import JoinSearch
from hsslam_node.geometry.se3 import inverse
from hsslam_node.tracking.places.relocalisation import Relocalisation
from tests.small_room import SMALL, pose_error
from tests.two_sessions import FIRST, SECOND, session, walk

_STEPS = 8  # from one comparison to the next


def test_a_place_that_is_found_between_two_steps_stays_known():
    """As with a lost frame, which waits for the comparison, and is no step."""
    (store, _), (second, _) = session(FIRST), session(SECOND)
    fragment = Fragment(SMALL, second.frame(0), 0, 1, 16)
    places = Relocalisation(SMALL.tracker, store, 0)
    search = JoinSearch(store, places, fragment)
    place = None
    for k in range(second.count):
        fragment.store.append(second.frame(k), second.pose(k))
        for _ in range(_STEPS):
            search.step()
        place = search.collect()
        if place is not None:
            break
    assert place is not None and search.step() is place and search.collect() is place
    _, poses = walk()
    off_m, off_deg = pose_error(place.T_map_fragment, inverse(poses[0]) @ poses[1])
    assert off_m < 0.05 and off_deg < 0.5
