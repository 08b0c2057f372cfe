import numpy as np

from hsslam_proto import topics
from hsslam_proto.codec import decode, encode, encoding_of
from hsslam_proto.mesh.assembled import AssembledMesh, PendingBlocks
from hsslam_proto.mesh.codec import BlockLattice, Triangles, block_triangles, blocks_message
from hsslam_proto.mesh.messages import MeshBlocks


def _wall(i: int, z: float = 0.5) -> Triangles:
    """Two triangles across block (i, 0, 0) of 1 m."""
    vertices = np.array([[i, 0, z], [i + 1, 0, z], [i + 1, 1, z], [i, 1, z]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    return Triangles(vertices, faces, np.full((4, 3), 10 * abs(i), np.uint8))


def _message(revision: int, *blocks, series: int = 1, map_epoch: int = 0) -> MeshBlocks:
    message = blocks_message(
        [((i, 0, 0), mesh) for i, mesh in blocks],
        BlockLattice(0.5, 1.0),
        series=series,
        revision=revision,
        map_version=revision,
        map_epoch=map_epoch,
    )
    topic = topics.MESH_BLOCKS
    back = decode(topic, encode(topic, message), encoding_of(topic))
    assert isinstance(back, MeshBlocks)
    return back


def test_blocks_come_back_as_they_were():
    back = block_triangles(_message(1, (0, _wall(0)), (3, None), (-2, _wall(-2))))
    assert list(back) == [(0, 0, 0), (3, 0, 0), (-2, 0, 0)] and back[3, 0, 0] is None
    for sent, found in zip(_wall(-2), back[-2, 0, 0] or (), strict=True):
        np.testing.assert_array_equal(sent, found)


def test_neighbours_join_and_blocks_that_went_are_gone():
    mesh = AssembledMesh()
    mesh.add(_message(1, (0, _wall(0)), (1, _wall(1)), (2, _wall(2))))
    mesh.add(_message(2, (2, None)))
    whole = mesh.whole()
    assert whole is not None
    assert len(whole.vertices) == 6 and len(whole.faces) == 4 and mesh.map_version == 2


def test_an_older_answer_does_not_undo_what_came_before_it():
    mesh = AssembledMesh()
    mesh.add(_message(5, (0, _wall(0, z=0.75))))
    mesh.add(_message(4, (0, _wall(0, z=0.25)), (1, _wall(1))))  # asked for, answered late
    whole = mesh.whole()
    assert whole is not None
    assert sorted(set(whole.vertices[:, 2].tolist())) == [0.5, 0.75]


def test_a_mesher_that_starts_again_begins_anew():
    mesh = AssembledMesh()
    mesh.add(_message(9, (0, _wall(0)), (1, _wall(1))))
    mesh.add(_message(1, (1, _wall(1)), series=2))
    mesh.add(_message(10, (0, _wall(0))))  # of the old one
    whole = mesh.whole()
    assert whole is not None and len(whole.faces) == 2


def test_what_waits_to_be_drawn_is_each_block_once():
    pending = PendingBlocks()
    assert not pending
    for revision in range(100):
        pending.add(_message(revision, (0, _wall(0)), (1, None)))
    news = pending.take()
    assert not news.anew and news.blocks.keys() == {(0, 0, 0), (1, 0, 0)}
    assert not pending
    pending.add(_message(0, (2, _wall(2)), series=2))
    news = pending.take()
    assert news.anew and news.blocks.keys() == {(2, 0, 0)}


def test_the_oldest_are_taken_first_if_not_all_are():
    pending = PendingBlocks()
    pending.add(_message(0, *((k, _wall(k)) for k in range(5))))
    taken = [pending.take(2).blocks.keys() for _ in range(3)]
    assert taken == [{(0, 0, 0), (1, 0, 0)}, {(2, 0, 0), (3, 0, 0)}, {(4, 0, 0)}]
    assert not pending


def test_blocks_of_a_map_that_was_thrown_away_are_not_drawn():
    pending = PendingBlocks()
    pending.add(_message(1, (0, _wall(0))))
    pending.forget_before(1)
    pending.add(_message(2, (0, _wall(0))))
    assert not pending
    pending.add(_message(1, (0, _wall(0)), series=2, map_epoch=1))
    assert pending.take().blocks
